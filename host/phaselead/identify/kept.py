"""The records of an experiment on disk, each as soon as it is there: what was measured outlives what ends the rest."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from phaselead.device import TICK_HZ, Capture, Device, read_capture, write_run
from phaselead.errors import BadInput, PhaseleadError
from phaselead.identify.plan import Experiment
from phaselead.record import Recording

BYTES_A_TICK = {1: 36, 3: 76}
"""By recorded axes, before compression: tick, two codes an axis, and time, voltage and position as float64."""
BYTES_A_RECORD = 65536
"""Of a file besides: model, first state, commands."""


class Kept:
    """A folder of records, one file for each experiment."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.names: list[str] = []
        """Of this session, found or added."""
        self.remedy = "go on with --resume"
        """When the session is cut short."""

    def path(self, name: str) -> Path:
        """Of the record of this experiment."""
        return self.folder / f"{name}.h5"

    def found(self, name: str, device: Device) -> Capture | None:
        """The record of an earlier session, None where there is none.

        Raises BadInput for one that was taken while a device held another model: other limits or calibration.
        """
        path = self.path(name)
        if not path.exists():
            return None
        capture = read_capture(path)
        if capture.model != device.read_model():
            raise BadInput(
                f"{path}: was recorded while the device held another model; take the same --model, or another folder"
            )
        self.names.append(name)
        return capture

    def add(self, capture: Capture, recording: Recording) -> None:
        """Keeps a record. Raises BadInput where it cannot be written."""
        write_run(self.path(recording.source), capture, recording)
        self.names.append(recording.source)

    def discard(self) -> None:
        """Removes what was kept, and the folder if nothing else is in it."""
        for name in self.names:
            self.path(name).unlink(missing_ok=True)
        with suppress(OSError):
            self.folder.rmdir()


@contextmanager
def keeping(
    folder: str | os.PathLike[str],
    plan: Sequence[Experiment],
    *,
    resume: bool = False,
    overwrite: bool = False,
    only_until_done: bool = False,
) -> Iterator[Kept]:
    """A folder for the records of a plan, made if it is not there. An error or Ctrl-C names it and how to go on;
    ``only_until_done`` removes the records once everything after them has worked.

    Raises BadInput, before anything is driven, where the folder cannot be written to or lacks space, and where it holds
    records of these names without ``resume``, which takes them, or ``overwrite``, which measures again.
    """
    kept = Kept(_writable(Path(folder)))
    _refuse_without_space(kept.folder, plan)
    there = [kept.path(e.name) for e in plan if kept.path(e.name).exists()]
    if overwrite and not resume:
        for path in there:
            path.unlink()
    elif there and not resume:
        raise BadInput(
            f"{kept.folder}: holds {len(there)} of the {len(plan)} records of this experiment; go on with --resume, "
            "measure again with --overwrite, or give another folder"
        )
    try:
        yield kept
    except (PhaseleadError, KeyboardInterrupt, OSError) as error:
        if kept.names:
            _add(error, f"{len(kept.names)} of {len(plan)} records are kept in {kept.folder}: {kept.remedy}")
        else:
            kept.discard()
        raise
    if only_until_done:
        kept.discard()


def _add(error: BaseException, line: str) -> None:
    if isinstance(error, OSError):
        error.strerror = "; ".join(part for part in (error.strerror, line) if part)
    else:
        error.args = ("; ".join(part for part in (*map(str, error.args), line) if part),)


def _writable(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"{folder}: no folder can be made there ({error.strerror}); give another with --save") from None
    if not os.access(folder, os.W_OK | os.X_OK):
        raise BadInput(f"{folder}: the folder cannot be written to; give another with --save")
    return folder


def needed_bytes(plan: Sequence[Experiment]) -> int:
    """At most, of all records of a plan."""
    axes = len({e.axis for e in plan})
    driven_s = sum(e.seconds - e.rest_s for e in plan)
    return round(driven_s * TICK_HZ * BYTES_A_TICK[1 if axes == 1 else 3]) + len(plan) * BYTES_A_RECORD


def _refuse_without_space(folder: Path, plan: Sequence[Experiment]) -> None:
    needed, free = needed_bytes(plan), shutil.disk_usage(folder).free
    if free < needed:
        raise BadInput(
            f"{folder}: the records need up to {needed / 1e6:.0f} MB, {free / 1e6:.0f} MB are free; make room, or give "
            "another folder with --save"
        )
