"""A recording file that is written part by part, so that it may be larger than the memory."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phaselead import interrupt
from phaselead.record.atomic import atomic_path
from phaselead.record.columns import UNITS, columns_of
from phaselead.record.deferred import DeferredErrors, new_hdf5
from phaselead.record.hdf5 import TRIGGER, write_head, write_tree
from phaselead.record.recording import Recording

ROWS = 1 << 16
"""Of one piece of a data set in the file."""


class Hdf5Parts:
    """The file under construction; ``hdf5_in_parts`` opens one."""

    def __init__(self, file: Any, through: DeferredErrors) -> None:
        self._file, self._through = file, through
        self._waiting: dict[str, list[NDArray[Any]]] = {}
        self._rows: dict[str, int] = {}
        """That wait, by data set."""

    def append(self, name: str, values: NDArray[Any], units: str | None = None) -> None:
        """Adds rows, shape (n,), to the data set of this name (``device/x/adc``), which the first ones make."""
        if name not in self._waiting:
            packed = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
            made = self._file.create_dataset(
                name, shape=(0,), maxshape=(None,), chunks=(ROWS,), dtype=values.dtype, **packed
            )
            if units is not None:
                made.attrs["units"] = units
            self._waiting[name], self._rows[name] = [], 0
        self._waiting[name].append(values)
        self._rows[name] += len(values)
        if self._rows[name] >= ROWS:
            self._write(name)

    def append_frame(self, name: str, frame: bytes) -> None:
        """Adds one to a list of frames, which ``read_hdf5`` gives as such."""
        self.append(f"{name}/data", np.frombuffer(frame, np.uint8))
        self.append(f"{name}/lengths", np.array([len(frame)], np.uint32))
        self._file[name].attrs["content"] = "frames"

    def _write(self, name: str) -> None:
        data, rows = self._file[name], self._rows[name]
        data.resize(len(data) + rows, axis=0)
        data[len(data) - rows :] = np.concatenate(self._waiting[name])
        self._waiting[name], self._rows[name] = [], 0
        self._through.raise_error()
        interrupt.raise_if_held()

    def append_rows(self, part: Recording) -> None:
        """Adds the columns of a recording, time and all."""
        for name, values in columns_of(part.t_s, part.axes).items():
            self.append(name, np.asarray(values, np.float64), UNITS[name])
        if part.trigger is not None:
            self.append(TRIGGER, part.trigger, "bits")

    def finish(self, rate_Hz: float, axes: str, meta: Mapping[str, Any], replay: Mapping[str, Any] | None) -> None:
        """Writes what is known at the end: the attributes, and what a replay needs besides the frames."""
        for name in [name for name, rows in self._rows.items() if rows]:
            self._write(name)
        write_head(self._file, rate_Hz, axes, meta)
        if replay is not None:
            write_tree(self._file.require_group("replay"), replay)


@contextmanager
def hdf5_in_parts(path: str | os.PathLike[str], *, overwrite: bool = True) -> Iterator[Hdf5Parts]:
    """A file that appears under its name once the block ends without an error, whole; raises as ``write_hdf5``."""
    with atomic_path(os.fspath(path), overwrite=overwrite) as temporary, new_hdf5(temporary) as (file, through):
        yield Hdf5Parts(file, through)
