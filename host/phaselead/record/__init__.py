"""Recordings: read, write, check, export."""

from phaselead.record.columns import parse_column_map, parse_rate
from phaselead.record.export import export, write_csv
from phaselead.record.hdf5 import read_hdf5, write_hdf5
from phaselead.record.read import read_recording
from phaselead.record.recording import AxisRecord, Recording

__all__ = [
    "AxisRecord",
    "Recording",
    "export",
    "parse_column_map",
    "parse_rate",
    "read_hdf5",
    "read_recording",
    "write_csv",
    "write_hdf5",
]
