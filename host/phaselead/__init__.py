"""phaselead: identify, drive and understand piezo stages."""

__version__ = "0.1.0"
