"""The version, for those who print it and must not import the package's face."""

VERSION = "0.1.0"
