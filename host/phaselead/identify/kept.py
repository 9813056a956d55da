"""The records of an experiment on disk, each as soon as it is there: what was measured outlives what ends the rest."""

from __future__ import annotations

import math
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from phaselead.device import TICK_HZ, Capture, Device, read_capture, write_run
from phaselead.errors import BadInput, PhaseleadError
from phaselead.identify.plan import HOLD_S, WAIT_S, Experiment, name_of_hold, plan_seconds
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

    def path(self, name: str) -> Path:
        """Of the record of this experiment."""
        return self.folder / f"{name}.h5"

    def is_resumed(self, plan: Sequence[Experiment], holds: Sequence[str]) -> bool:
        """Whether some of these records are there, and some are not."""
        there = [self.path(name).exists() for name in names_of(plan, holds)]
        return any(there) and not all(there)

    def is_empty(self, plan: Sequence[Experiment], holds: Sequence[str]) -> bool:
        """Whether none of these records is there."""
        return not any(self.path(name).exists() for name in names_of(plan, holds))

    def ahead(self, plan: Sequence[Experiment], holds: Sequence[str]) -> str:
        """What is still to be measured and how long that takes, in words."""
        sines = [e for e in plan if not self.path(e.name).exists()]
        held = [axis for axis in holds if not self.path(name_of_hold(axis)).exists()]
        seconds = plan_seconds(sines, held) + (WAIT_S if holds and self.is_resumed(plan, holds) else 0)
        parts = [f"{len(sines)} sine{'s' if len(sines) != 1 else ''}"] * bool(sines)
        parts += [f"{len(held)} hold{'s' if len(held) != 1 else ''} for creep"] * bool(held)
        if not parts:
            return "every record is there"
        return f"{' and '.join(parts)} to be measured take {_minutes(seconds)} of the device's time"

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
        path = self.path(recording.source)
        path.parent.mkdir(exist_ok=True)
        write_run(path, capture, recording)
        self.names.append(recording.source)

    def discard(self) -> None:
        """Removes what was kept, and the folder if nothing else is in it."""
        paths = [self.path(name) for name in self.names]
        for path in paths:
            path.unlink(missing_ok=True)
        for folder in sorted({self.folder, *(path.parent for path in paths)}, reverse=True):
            with suppress(OSError):
                folder.rmdir()


def _minutes(seconds: float) -> str:
    whole = math.ceil(seconds)
    return f"{whole // 60} min {whole % 60} s" if whole >= 60 else f"{whole} s"


@contextmanager
def keeping(
    folder: str | os.PathLike[str],
    plan: Sequence[Experiment],
    holds: Sequence[str] = (),
    *,
    resume: bool = False,
    overwrite: bool = False,
    only_until_done: bool = False,
) -> Iterator[Kept]:
    """A folder for the records of a plan and of the ``holds`` of these axes, made if it is not there. An error or
    Ctrl-C names it and how to go on; ``only_until_done`` removes the records once everything after them has worked.

    Raises BadInput, before anything is driven, where the folder cannot be written to or lacks space, and where it holds
    records of these names without ``resume``, which takes them, or ``overwrite``, which measures again.
    """
    kept = Kept(_writable(Path(folder)))
    _refuse_without_space(kept.folder, plan, holds)
    names = names_of(plan, holds)
    there = [path for path in map(kept.path, names) if path.exists()]
    if overwrite and not resume:
        for path in there:
            path.unlink()
    elif there and not resume:
        raise BadInput(
            f"{kept.folder}: holds {len(there)} of the {len(names)} records of this experiment; go on with --resume, "
            "measure again with --overwrite, or give another folder"
        )
    try:
        yield kept
    except (PhaseleadError, KeyboardInterrupt, OSError) as error:
        if (there_now := sum(kept.path(name).exists() for name in names)) > 0:
            _add(error, _how_to_go_on(error, there_now, len(names), kept.folder))
        else:
            kept.discard()
        raise
    if only_until_done:
        kept.discard()


def _how_to_go_on(error: BaseException, there: int, wanted: int, folder: Path) -> str:
    """What is on disk and what to do: where every record is there and one was refused, --resume reads the same one."""
    if there == wanted and isinstance(error, BadInput):
        return (
            f"all {there} records are kept in {folder}, and --resume reads them as they are: a record that was refused "
            "is measured again once its file is deleted, all with --overwrite"
        )
    return f"{there} of {wanted} records are kept in {folder}: go on with --resume"


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


def names_of(plan: Sequence[Experiment], holds: Sequence[str]) -> list[str]:
    """Of the records of the plan and of the holds of these axes."""
    return [*(e.name for e in plan), *map(name_of_hold, holds)]


def needed_bytes(plan: Sequence[Experiment], holds: Sequence[str] = ()) -> int:
    """At most, of all records of a plan and of the holds of these axes."""
    axes = len({e.axis for e in plan})
    driven_s = sum(e.seconds - e.rest_s for e in plan)
    rows = driven_s * TICK_HZ * BYTES_A_TICK[1 if axes == 1 else 3] + len(holds) * HOLD_S * TICK_HZ * BYTES_A_TICK[1]
    return round(rows) + len(names_of(plan, holds)) * BYTES_A_RECORD


def _refuse_without_space(folder: Path, plan: Sequence[Experiment], holds: Sequence[str]) -> None:
    needed, free = needed_bytes(plan, holds), shutil.disk_usage(folder).free
    if free < needed:
        raise BadInput(
            f"{folder}: the records need up to {needed / 1e6:.0f} MB, {free / 1e6:.0f} MB are free; make room, or give "
            "another folder with --save"
        )
