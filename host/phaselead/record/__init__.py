"""Recordings: read, write, check, export."""

from __future__ import annotations

from phaselead.record.atomic import RUN_SUFFIXES, atomic_path, check_output, is_special, write_text, write_texts
from phaselead.record.axis_record import AxisRecord, Samples
from phaselead.record.bounded import require_walkable
from phaselead.record.checks import refuse_clipped, refuse_gapped
from phaselead.record.columns import AXES, own_header, parse_axes, parse_column_map, parse_rate
from phaselead.record.digest import Source, file_sha256, shortest_names
from phaselead.record.direction import counts_backwards, slow_gain
from phaselead.record.exporting import SUFFIXES, export, write_csv
from phaselead.record.gathering import (
    MapLike,
    RecordLike,
    RecordsLike,
    from_columns,
    gather,
    gather_one,
    gather_parts,
)
from phaselead.record.glitches import glitch_doubts
from phaselead.record.growing import Hdf5Parts, hdf5_in_parts
from phaselead.record.hdf5 import read_hdf5, write_hdf5
from phaselead.record.importing import Imported, import_files, import_names
from phaselead.record.journal import (
    Entry,
    JournalReader,
    JournalWriter,
    alone,
    is_being_written,
    read_journal,
    what_to_do,
)
from phaselead.record.overlap import same_measurement
from phaselead.record.plausible import doubts_about, seem_exchanged, times_in
from phaselead.record.read import read_recording, refuse_map_of_some, scored_alone, split_argument
from phaselead.record.recording import Recording, Recordings, facts_of
from phaselead.record.sampled import SampledResult
from phaselead.record.units import factors_moved, gains_moved, in_another_unit, unit_remedy
from phaselead.record.wall_clock import Began, began, t0_facts, t0_unix_s

__all__ = [
    "AXES",
    "RUN_SUFFIXES",
    "SUFFIXES",
    "AxisRecord",
    "Began",
    "Entry",
    "Hdf5Parts",
    "Imported",
    "JournalReader",
    "JournalWriter",
    "MapLike",
    "RecordLike",
    "Recording",
    "Recordings",
    "RecordsLike",
    "SampledResult",
    "Samples",
    "Source",
    "alone",
    "atomic_path",
    "began",
    "check_output",
    "counts_backwards",
    "doubts_about",
    "export",
    "factors_moved",
    "facts_of",
    "file_sha256",
    "from_columns",
    "gains_moved",
    "gather",
    "gather_one",
    "gather_parts",
    "glitch_doubts",
    "hdf5_in_parts",
    "import_files",
    "import_names",
    "in_another_unit",
    "is_being_written",
    "is_special",
    "own_header",
    "parse_axes",
    "parse_column_map",
    "parse_rate",
    "read_hdf5",
    "read_journal",
    "read_recording",
    "refuse_clipped",
    "refuse_gapped",
    "refuse_map_of_some",
    "require_walkable",
    "same_measurement",
    "scored_alone",
    "seem_exchanged",
    "shortest_names",
    "slow_gain",
    "split_argument",
    "t0_facts",
    "t0_unix_s",
    "times_in",
    "unit_remedy",
    "what_to_do",
    "write_csv",
    "write_hdf5",
    "write_text",
    "write_texts",
]
