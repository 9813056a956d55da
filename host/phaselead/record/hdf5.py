"""Recordings as HDF5, the native finished form.

    /                   attributes: format, version, rate_Hz, axis ("x", "xyz"), and Recording.meta
                        (stage file text, device, gaps)
    /t_s /u_V /x_um ... float64, one dimension, named like the CSV columns, attribute ``units``
    /trigger            uint8, what the device's triggers did, of a recording that has it
    /device             raw integers of the device, as given
    /replay             everything a replay needs, as given

Attributes that HDF5 has no plain type for (lists, tables, nothing) are JSON text under ``NAME.json``.
Datasets are compressed, which carries a checksum: a flipped bit is told and not measured.

h5py is imported where it is used: it is slow to load, and most commands touch no file.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phaselead.errors import BadInput, PhaseleadError
from phaselead.record.atomic import atomic_path
from phaselead.record.axis_record import Samples
from phaselead.record.bounded import require_walkable
from phaselead.record.checks import require_measured, require_rate, require_uniform
from phaselead.record.columns import UNITS, axes_of, columns_of
from phaselead.record.deferred import new_hdf5
from phaselead.record.recording import Recording

SIGNATURE = b"\x89HDF\r\n\x1a\n"
FORMAT, VERSION = "phaselead-recording", 1
TRIGGER = "trigger"
RESERVED = ("format", "version", "rate_Hz", "axis")
LARGEST_RATIO = 1100
"""gzip packs at most 1032 to 1: a file that claims more is broken."""


@dataclass(frozen=True)
class Hdf5Recording:
    """A file in full: the recording and, if it came from a device, its raw numbers and what replay needs."""

    recording: Recording
    device: dict[str, Any] | None
    replay: dict[str, Any] | None


def write_hdf5(
    path: str | os.PathLike[str],
    recording: Recording,
    device: Mapping[str, Any] | None = None,
    replay: Mapping[str, Any] | None = None,
    *,
    overwrite: bool = True,
) -> None:
    """Write a recording, whole or not at all.

    ``device`` and ``replay`` are trees of dicts; leaves may be numeric arrays, bytes, lists of bytes, text,
    numbers, and anything JSON can say. ``read_hdf5`` gives them back equal.
    """
    with atomic_path(os.fspath(path), overwrite=overwrite) as temporary, new_hdf5(temporary) as (file, _):
        write_head(file, recording.rate_Hz, "".join(sorted(recording.axes)), recording.meta)
        for name, samples in columns_of(recording.t_s, recording.axes).items():
            _write_array(file, name, np.asarray(samples, dtype=np.float64)).attrs["units"] = UNITS[name]
        if recording.trigger is not None:
            _write_array(file, TRIGGER, recording.trigger).attrs["units"] = "bits"
        for name, tree in (("device", device), ("replay", replay)):
            if tree is not None:
                write_tree(file.create_group(name), tree)


def write_head(file: Any, rate_Hz: float, axes: str, meta: Mapping[str, Any]) -> None:
    """The attributes of a recording's file."""
    head = {"format": FORMAT, "version": VERSION, "rate_Hz": rate_Hz, "axis": axes}
    for name, value in (head | {name: value for name, value in meta.items() if name not in RESERVED}).items():
        _write_attribute(file, name, value)


def _write_array(group: Any, name: str, values: np.ndarray) -> Any:
    packed = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
    return group.create_dataset(name, data=values, **(packed if values.ndim and values.size else {}))


def _write_attribute(owner: Any, name: str, value: Any) -> None:
    if isinstance(value, np.generic):
        value = value.item()
    plain = isinstance(value, (bool, float)) or (isinstance(value, int) and -(2**63) <= value < 2**63)
    if plain or (isinstance(value, str) and _encodable(value)):
        owner.attrs[name] = value
    else:
        owner.attrs[f"{name}.json"] = json.dumps(value, default=_as_list)


def _encodable(text: str) -> bool:
    """Whether HDF5 can hold it as text: no lone surrogates, no NUL."""
    return "\0" not in text and text.encode("utf-8", "ignore").decode("utf-8") == text


def _as_list(value: object) -> object:
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be stored in a recording")


def write_tree(group: Any, tree: Mapping[str, Any]) -> None:
    """A tree of dicts into a group, as ``write_hdf5`` says."""
    for name, value in tree.items():
        if isinstance(value, Mapping):
            write_tree(group.create_group(name), value)
        elif isinstance(value, np.ndarray):
            _write_array(group, name, value)
        elif isinstance(value, (bytes, bytearray)):
            _write_array(group, name, np.frombuffer(value, dtype=np.uint8)).attrs["content"] = "bytes"
        elif _is_frames(value):
            frames = group.create_group(name)
            frames.attrs["content"] = "frames"
            _write_array(frames, "data", np.frombuffer(b"".join(value), dtype=np.uint8))
            _write_array(frames, "lengths", np.array([len(frame) for frame in value], dtype=np.uint32))
        else:
            _write_attribute(group, name, value)


def _is_frames(value: object) -> bool:
    return isinstance(value, (list, tuple)) and bool(value) and all(isinstance(item, bytes) for item in value)


def read_hdf5(path: str | os.PathLike[str], *, whole: bool = True) -> Hdf5Recording:
    """Read a recording with everything in it, or without ``device`` and ``replay`` unless ``whole``.

    Raises BadInput, one line, for anything else.
    """
    import h5py

    path = os.fspath(path)
    refuse_foreign(path)
    require_walkable(path)
    try:
        with h5py.File(path, "r", locking=False) as file:
            return _read_file(file, path, os.path.getsize(path), whole)
    except PhaseleadError:
        raise
    except Exception as error:  # whatever the library meets in a broken file
        reason = " ".join(str(error).split())[:120]
        what = f"is no whole HDF5 file ({reason})"
        if "truncated" in reason:
            what = f"is cut off after {os.path.getsize(path)} bytes"
        raise BadInput(
            f"{path}: {what}; copy it again, or make it anew from its journal (phaselead log recover)"
        ) from None


def refuse_foreign(path: str) -> None:
    """Refuse what is no file, or no HDF5 from its first bytes on."""
    try:
        with open(path, "rb") as file:
            signature = file.read(len(SIGNATURE))
    except FileNotFoundError:
        raise BadInput(f"{path}: does not exist; check the path") from None
    except OSError as error:
        raise BadInput(f"{path}: cannot be read ({error.strerror}); give a recording (.h5)") from None
    except ValueError:  # a NUL in the name
        raise BadInput(f"{path!r}: is no file name; give a recording (.h5)") from None
    if signature != SIGNATURE:
        raise BadInput(f"{path}: is no HDF5 file; give a run as track -o or log record -o wrote it (.h5)")


def _read_file(file: Any, path: str, size: int, whole: bool) -> Hdf5Recording:
    import h5py

    attributes = _attributes(file)
    names = [name for name in UNITS if isinstance(file.get(name, getlink=True), h5py.HardLink)]
    if attributes.get("format") != FORMAT and "t_s" not in names:
        raise BadInput(f"{path}: is HDF5 but no recording: it has no dataset t_s; export it as CSV with a header")
    version = attributes.get("version", VERSION)
    if isinstance(version, int) and version > VERSION:
        raise BadInput(f"{path}: was written by a newer phaselead (version {version}); update phaselead")
    table = {name: _samples(file[name], name, path, size) for name in names}
    if "t_s" not in table:
        raise BadInput(f"{path}: has no dataset t_s; the file is broken")
    trigger = _trigger(file, path, size)
    lengths = {len(values) for values in table.values()} | (set() if trigger is None else {len(trigger)})
    if len(lengths) > 1:
        raise BadInput(f"{path}: its datasets differ in length ({min(lengths)}..{max(lengths)}); the file is broken")
    times = table.pop("t_s")
    meta = {name: value for name, value in attributes.items() if name not in RESERVED}
    read = _tree if whole else _tree_of_gaps
    device, replay = (read(file[name], size) if name in file else None for name in ("device", "replay"))
    gaps = meta.get("gaps") or (replay or {}).get("gaps") or _missing_ticks(device)
    require_uniform(times, _row, path, gapped=bool(gaps))
    if not gaps:
        require_rate(attributes.get("rate_Hz"), times, path)
    axes = axes_of(table, path)
    if gaps:
        meta["gaps"] = gaps
    recording = Recording(t_s=times, axes=axes, source=path, trigger=trigger, meta=meta)
    return Hdf5Recording(recording, device, replay) if whole else Hdf5Recording(recording, None, None)


def _missing_ticks(device: dict[str, Any] | None) -> list[list[int]]:
    """First tick and length of each gap in ``/device/tick``, whatever the file says of gaps."""
    ticks = np.asarray((device or {}).get("tick", ()))
    if ticks.ndim != 1 or ticks.dtype.kind not in "iu" or len(ticks) < 3:
        return []
    steps = np.diff(ticks.astype(np.int64))
    usual = int(np.median(steps))
    return [[int(ticks[i]) + usual, int(steps[i]) - usual] for i in np.flatnonzero(steps > usual).tolist()]


def _samples(dataset: Any, name: str, path: str, size: int) -> Samples:
    if not _is_dataset(dataset) or dataset.ndim != 1 or dataset.dtype.kind not in "iuf":
        raise BadInput(f"{path}: {name} is no one-dimensional dataset of numbers; the file is broken")
    units = dataset.attrs.get("units", UNITS[name])
    if units != UNITS[name]:
        raise BadInput(f"{path}: {name} has units {str(units)[:20]!r}, expected {UNITS[name]}; convert it")
    values = np.asarray(_array(dataset, size), dtype=np.float64)
    require_measured(name, values, _row, path)
    return values


def _trigger(file: Any, path: str, size: int) -> NDArray[np.uint8] | None:
    import h5py

    if not isinstance(file.get(TRIGGER, getlink=True), h5py.HardLink):
        return None
    dataset = file[TRIGGER]
    if not _is_dataset(dataset) or dataset.ndim != 1 or dataset.dtype != np.uint8:
        raise BadInput(f"{path}: {TRIGGER} is no one-dimensional dataset of bytes; the file is broken")
    return _array(dataset, size)


def _is_dataset(item: object) -> bool:
    import h5py

    return isinstance(item, h5py.Dataset)


def _row(row: int) -> str:
    return f"row {row + 1}"


def _array(dataset: Any, size: int) -> np.ndarray:
    if dataset.nbytes > LARGEST_RATIO * size:
        raise OSError(f"{dataset.name} claims more data than the file can hold")
    return np.asarray(dataset[()])


def _attributes(owner: Any) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in owner.attrs.items():
        if name.endswith(".json"):
            found[name.removesuffix(".json")] = json.loads(value)
        else:
            found[name] = value.item() if isinstance(value, np.generic) else value
    return found


def _tree_of_gaps(group: Any, size: int) -> dict[str, Any]:
    """As much of ``_tree`` as tells of gaps."""
    tree = {"tick": _array(group["tick"], size)} if _is_dataset(group.get("tick")) else {}
    return tree | _attributes(group)


def _tree(group: Any, size: int) -> dict[str, Any]:
    tree: dict[str, Any] = {}
    for name, item in group.items():
        content = item.attrs.get("content")
        if _is_dataset(item):
            array = _array(item, size)
            tree[name] = array.tobytes() if content == "bytes" else array
        elif content == "frames":
            data, lengths = _array(item["data"], size).tobytes(), _array(item["lengths"], size)
            ends = np.concatenate(([0], np.cumsum(lengths, dtype=np.int64))).tolist()
            tree[name] = [data[start:stop] for start, stop in pairwise(ends)]
        else:
            tree[name] = _tree(item, size)
    return tree | _attributes(group)
