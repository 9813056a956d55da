"""A file for HDF5 whose disk may fill up: the first failed write is kept and told when the file has been closed.

HDF5 cannot close a file that it could not write: it tries again whenever an object is collected, and each time a
traceback is printed that nobody can catch.
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from phaselead import interrupt


class DeferredErrors(io.FileIO):
    """Behaves as if every write had worked; ``raise_error`` says whether it had."""

    error: OSError | None = None

    def write(self, data: Any, /) -> int:
        view = memoryview(data).cast("B")
        done = 0
        try:
            while self.error is None and done < len(view):
                done += super().write(view[done:])
        except OSError as error:
            self.error = error
        self.seek(len(view) - done, os.SEEK_CUR)
        return len(view)

    def truncate(self, size: int | None = None, /) -> int:
        try:
            return super().truncate(size)
        except OSError as error:
            self.error = self.error or error
            return size or 0

    def readinto(self, buffer: Any, /) -> int:
        view = memoryview(buffer).cast("B")
        got = super().readinto(view) or 0
        view[got:] = bytes(len(view) - got)  # what was not written
        return len(view)

    def raise_error(self) -> None:
        """Raises OSError when a write has failed."""
        if self.error is not None:
            raise self.error


@contextmanager
def new_hdf5(path: str | os.PathLike[str]) -> Iterator[tuple[Any, DeferredErrors]]:
    """A new file of h5py over the one at ``path``, and what it is written through.

    An interrupt waits until it is closed: raised while HDF5 writes, it would be swallowed there and leave a file that
    lacks rows.

    Raises:
        OSError: it could not be written whole, once it is closed.
    """
    import h5py

    with interrupt.held(), DeferredErrors(path, "r+") as through:
        with h5py.File(through, "w") as file:
            yield file, through
        through.raise_error()
