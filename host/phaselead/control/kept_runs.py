"""The runs of a longer work, a learning or a tuning: a file each where they are kept, and what tells them apart."""

from __future__ import annotations

import os
from pathlib import Path

from phaselead.control.run import Run
from phaselead.errors import BadInput
from phaselead.record import Source, file_sha256


class KeptRuns:
    """A folder that takes every run as soon as it is there; None keeps none of them, and only says what they were."""

    def __init__(self, folder: str | os.PathLike[str] | None, *, overwrite: bool = False) -> None:
        """Makes nothing yet. Raises BadInput, before anything moves, for a folder that cannot be written to or made,
        and for one that holds recordings unless ``overwrite``."""
        self._folder = None if folder is None else Path(folder)
        if self._folder is not None:
            _refuse(self._folder, overwrite)

    def add(self, name: str, run: Run) -> Source:
        """What tells this run: of its file where it is kept, else of its samples. Raises BadInput where it cannot be
        written."""
        if self._folder is None:
            return Source(name, run.recording.samples_sha256)
        self._folder.mkdir(parents=True, exist_ok=True)
        path = self._folder / f"{name}.h5"
        run.save(path, overwrite=True)  # a folder that holds recordings was refused before
        return Source(str(path), file_sha256(path))


def _refuse(folder: Path, overwrite: bool) -> None:
    there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not there.is_dir() or not os.access(there, os.W_OK | os.X_OK):
        raise BadInput(f"{folder}: {there} is no folder that can be written to; give another with --save")
    found = sorted(folder.glob("*.h5"))
    if found and not overwrite:
        raise BadInput(
            f"{folder}: holds recordings already ({found[0].name}); give another folder, or write over them with "
            "--overwrite (in Python overwrite=True)"
        )
