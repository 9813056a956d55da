"""Reading recordings: CSV with our header, text with a column map, HDF5; all with or without a window."""

from __future__ import annotations

import glob
import hashlib
import math
import os
import re
from collections.abc import Iterable
from dataclasses import replace

from phaselead.errors import BadInput
from phaselead.record.axis_record import AxisRecord, Samples
from phaselead.record.columns import ColumnMap, axes_of
from phaselead.record.hdf5 import SIGNATURE, read_hdf5
from phaselead.record.journal import STILL_WRITTEN, is_being_written, is_journal
from phaselead.record.recording import Recording
from phaselead.record.text import own_columns, read_text

Window = tuple[float, float]
"""From, to in absolute seconds, half-open; infinite where left out."""

EDGE_STEPS = 1e-3
"""A time this close to the edge of a window, in sampling steps, is on it: printed times are rounded."""

HEADING_BYTES = 1 << 16
"""In which a header is looked for."""

_WINDOW = re.compile(r"([^:]*):([^:]*)")


def read_recording(
    argument: str | os.PathLike[str], *, columns: ColumnMap | None = None, rate_Hz: float | None = None
) -> Recording:
    """Read ``path`` or ``path@from:to`` (absolute seconds, half-open, either end may be left out).

    With a window, rows before it are kept to warm the model's memory but are not in ``scored``; rows at or
    after its end are cut off. ``columns`` maps names to 1-based columns and factors, for text without our
    header (``{"u_V": (1, 1.0), "x_um": (3, 1e6)}``); ``rate_Hz`` stands in for times. Raises BadInput, one
    line.
    """
    path, window = split_argument(os.fspath(argument))
    sha256, content = _digest_and_text(path)
    if content is None:
        if columns is not None or rate_Hz is not None:
            raise BadInput(f"{path}: is HDF5, which names its columns and times itself; leave --map and --rate out")
        recording = read_hdf5(path, whole=False).recording
    else:
        table = read_text(content, path, columns, rate_Hz)
        times = table.pop("t_s")
        recording = Recording(t_s=times, axes=axes_of(table, path))
    recording = replace(recording, source=os.fspath(argument), sha256=sha256)
    return recording if window is None else windowed(recording, window)


def refuse_map_of_some(arguments: Iterable[str], columns: ColumnMap | None) -> None:
    """Refuse a map where some files need it and others name their columns otherwise: it would read these alike, in
    another unit.

    Raises BadInput, one line. Files that cannot be read are left to ``read_recording``.
    """
    if columns is None:
        return
    found = {path: _beginning(path) for path in dict.fromkeys(split_argument(one)[0] for one in arguments)}
    nameless = [path for path, begins in found.items() if _needs_map(begins)]
    otherwise = [path for path, begins in found.items() if _names_otherwise(begins, columns)]
    if nameless and otherwise:
        raise BadInput(
            f"{otherwise[0]}: names its columns in V and um, {nameless[0]} does not, and --map would be for both; let "
            "`phaselead log import` convert those that do not (with their map), and leave --map out"
        )


def _beginning(path: str) -> bytes:
    """How a file begins; nothing where it cannot be read."""
    try:
        with open(path, "rb") as file:
            return file.read(HEADING_BYTES)
    except (OSError, ValueError):
        return b""


def _needs_map(begins: bytes) -> bool:
    """Whether a file is text that does not name its columns in our units."""
    return not begins.startswith(SIGNATURE) and own_columns(begins) == {}


def _names_otherwise(begins: bytes, columns: ColumnMap) -> bool:
    """Whether a file names its columns in our units, and not as the map has them; HDF5 takes no map at all."""
    if begins.startswith(SIGNATURE):
        return True
    own = own_columns(begins) or {}
    return any(columns.get(name) != where for name, where in own.items())


def split_argument(argument: str) -> tuple[str, Window | None]:
    """The path and the window of a recording argument. A file of exactly this name has no window."""
    path, at, text = argument.rpartition("@")
    if not at or not path or _exists(argument):
        return argument, None
    match = _WINDOW.fullmatch(text)
    if not match:
        if _exists(path):
            raise BadInput(f"{argument}: the window {text!r} is not FROM:TO in seconds, as in {path}@5:7")
        return argument, None
    try:
        start, stop = _second(match[1], -math.inf), _second(match[2], math.inf)
    except ValueError:
        raise BadInput(f"{argument}: the window {text!r} is not FROM:TO in seconds, as in {path}@5:7") from None
    if start >= stop:
        raise BadInput(f"{argument}: the window is empty; FROM must be before TO")
    return path, (start, stop)


def _second(text: str, missing: float) -> float:
    if not text.strip():
        return missing
    value = float(text)
    if not math.isfinite(value):
        raise ValueError
    return value


def _exists(path: str) -> bool:
    try:
        return os.path.exists(path)
    except ValueError:  # a NUL in the name
        return False


def _digest_and_text(path: str) -> tuple[str, bytes | None]:
    """Hash of the file, and its bytes unless it is HDF5."""
    try:
        with open(path, "rb") as file:
            if file.read(len(SIGNATURE)) == SIGNATURE:
                file.seek(0)
                return hashlib.file_digest(file, "sha256").hexdigest(), None
            file.seek(0)
            content = file.read()
    except OSError as error:
        pattern = isinstance(error, FileNotFoundError) and glob.has_magic(path)
        mend = "no file is of this pattern, or it stands in quotes" if pattern else "give a recording (.csv or .h5)"
        raise BadInput(f"{path}: cannot be read ({error.strerror}); {mend}") from None
    except ValueError:  # a NUL in the name
        raise BadInput(f"{path!r}: is no file name; give a recording (.csv or .h5)") from None
    if is_journal(content):
        what = (
            STILL_WRITTEN if is_being_written(path) else "it was never finished; finish it with phaselead log recover"
        )
        raise BadInput(f"{path}: is the journal of a capture; {what}")
    return hashlib.sha256(content).hexdigest(), content


def windowed(recording: Recording, window: Window) -> Recording:
    """The recording with ``scored`` set to a window and what follows it cut off."""
    start_s, stop_s = window
    slack = EDGE_STEPS / recording.rate_Hz
    t = recording.t_s
    first = int(t.searchsorted(start_s - slack))
    stop = int(t.searchsorted(stop_s - slack))
    if stop - first < 2:
        raise BadInput(
            f"{recording.source}: {max(stop - first, 0)} rows lie in the window; "
            f"the recording runs from {t[0]:g} to {t[-1]:g} s, choose FROM:TO inside"
        )
    return replace(_cut(recording, slice(0, stop)), scored=slice(first, stop))


def scored_alone(recording: Recording) -> Recording:
    """The scored rows without those before them, as an export of a window has them."""
    return replace(_cut(recording, recording.scored), scored=slice(None))


def _cut(recording: Recording, rows: slice) -> Recording:
    def part(values: Samples | None) -> Samples | None:
        return None if values is None else values[rows]

    axes = {name: AxisRecord(part(a.u_V), part(a.x_um), part(a.r_um)) for name, a in recording.axes.items()}
    trigger = None if recording.trigger is None else recording.trigger[rows]
    return replace(recording, t_s=recording.t_s[rows], axes=axes, trigger=trigger)
