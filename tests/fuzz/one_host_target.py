"""libFuzzer on one of host_targets, guided by the coverage of the package: one_host_target.py NAME [OPTION...]."""

import sys

import atheris

with atheris.instrument_imports(include=["phaselead", "cobs"]):
    from host_targets import TARGETS

name = sys.argv.pop(1)
atheris.Setup(sys.argv, TARGETS[name])
atheris.Fuzz()
