"""What was learned of a path: the points to play in its place, for which model and mode, and how the trials went."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from phaselead.control.learning.moved_modes import stage_with_modes_at
from phaselead.control.true_position import FOLLOWS, Follows
from phaselead.errors import BadInput
from phaselead.model import Gains, Stage
from phaselead.record import Samples, Source, atomic_path, require_walkable
from phaselead.result import Result, Table
from phaselead.waveforms import POINTS, Replaced, Waveform

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMAT, VERSION = "phaselead-learned", 2
READ = (1, VERSION)
"""Before version 2 the inverse always had the modes of the model."""
SAME_um = 1e-4
"""Paths that differ by less are one: a fortieth of a converter's code."""


UNKNOWN = Source("", "")
"""Of a table that was written before trials told of their recordings."""


@dataclass(frozen=True)
class Trial:
    """One drive along the path. ``kept``: the error was smaller than in every trial before it."""

    number: int
    kept: bool
    learned_lines: dict[str, int]
    probed_lines: dict[str, int]
    max_um: dict[str, float]
    rms_um: dict[str, float]
    true_max_um: dict[str, float] | None = None
    """Of the true position, where a virtual stage tells it."""
    judged_pct: float | None = None
    """What trials are compared by: rms of the error against the path that was asked for, from where the trial has
    settled on, in per cent of the swing, over all axes."""
    source: Source = UNKNOWN
    """Its recording: the file where it was kept, and the SHA-256 of that, else of its samples."""


@dataclass(frozen=True)
class LearnedPath:
    """Of one axis: one period as asked and as played, um, shape (1024,)."""

    f_Hz: float
    wanted_um: Samples
    played_um: Samples
    lag_s: float
    trial_s: float
    gains: Gains | None
    modes: float = 1.0
    """Those of the inverse, as times the frequencies in the model that was given."""


@dataclass(frozen=True, repr=False)
class Learned(Result):
    """The outcome of ``phaselead learn``: of all trials the best.

    It is for one model (``stage_sha256``), mode and path, and ``waveforms`` refuses every other.

    >>> import phaselead as pl
    >>> with pl.connect() as dev:
    ...     uploaded = dev.upload(pl.fit(dev.record("sine:5V@5Hz", duration=1)))
    ...     learned = dev.learn("sine:40um@5Hz", trials=2)
    ...     run = dev.track("sine:40um@5Hz", learned=learned)
    >>> learned.best.rms_um["x"] < learned.trials[0].rms_um["x"], run.mode
    (True, 'inverse+pid')
    """

    stage_sha256: str
    mode: str
    follows: Follows
    paths: dict[str, LearnedPath]
    trials: tuple[Trial, ...]
    reason: str
    """Why it ended."""
    wave: str = ""
    """The path as it was written, where that is known."""
    in_fault: bool = False
    """Whether the device ended it in a fault, which it latched then; what was learned before is kept. Of a table that
    was read from a file it is not known, and false."""

    @property
    def best(self) -> Trial:
        """The trial whose points these are."""
        return [trial for trial in self.trials if trial.kept][-1]

    def gains(self) -> dict[str, Gains]:
        """Those it was learned with, by axis; empty without feedback."""
        return {axis: path.gains for axis, path in self.paths.items() if path.gains is not None}

    def model_played(self, stage: Stage | None) -> Stage | None:
        """The model whose inverse the table is for: the given one, with its modes where they were found to be.

        Raises BadInput for a model that only the device holds, which does not tell its modes.
        """
        factors = {axis: path.modes for axis, path in self.paths.items()}
        if stage is None and set(factors.values()) != {1.0}:
            raise BadInput(
                "the learned table is for the model with its modes moved, and the device does not tell the modes of "
                "the one it holds; give that with --model STAGE.toml"
            )
        return None if stage is None else stage_with_modes_at(stage, factors)

    def waveforms(
        self,
        wanted: Mapping[str, Waveform],
        stage_sha256: str | None,
        mode: str,
        gains: Mapping[str, Gains],
        follows: Follows | None = None,
    ) -> dict[str, Waveform]:
        """The paths with what was learned in place of them; ``follows`` None is as it was learned.

        Raises BadInput where it was learned for another model, mode, gains, axis, path or position that follows.
        """
        if stage_sha256 is None:
            raise BadInput("a learned table needs the model it was learned with: --model STAGE.toml")
        if stage_sha256 != self.stage_sha256:
            raise BadInput(
                f"the learned table is for another model ({self.stage_sha256[:12]}, this one is {stage_sha256[:12]}); "
                "learn again with this one (phaselead learn), or give the model it was learned with"
            )
        if mode != self.mode:
            raise BadInput(f"the learned table is for mode {self.mode}, not {mode}; give --mode {self.mode}")
        if follows not in (None, self.follows):
            raise BadInput(
                f"the learned table is for the {self.follows} position, not the {follows} one; leave out --track, or "
                "learn again"
            )
        for axis, own in self.gains().items():
            if axis in gains and gains[axis].model_dump(exclude={"origin"}) != own.model_dump(exclude={"origin"}):
                written = f"{own.kp_V_per_um:g},{own.ki_V_per_um_s:g},{own.kd_V_s_per_um:g}"
                raise BadInput(f"{axis}: the learned table is for the gains {written}; leave out gains, or learn again")
        if set(wanted) != set(self.paths):
            has, asked = ("".join(sorted(axes)) for axes in (self.paths, wanted))
            raise BadInput(f"the learned table is for {has}, the path for {asked}; learn the path that is to be driven")
        return {axis: self._replaced(axis, waveform) for axis, waveform in wanted.items()}

    def _replaced(self, axis: str, wanted: Waveform) -> Replaced:
        known = self.paths[axis]
        same = wanted.periodic and wanted.unit == "um" and math.isclose(wanted.f_Hz, known.f_Hz, rel_tol=1e-9)
        if not same or np.abs(one_period(wanted) - known.wanted_um).max() > SAME_um:
            swing = float(np.ptp(known.wanted_um))
            raise BadInput(
                f"{axis}: the learned table is for another path ({swing:.4g} um at {known.f_Hz:.6g} Hz); "
                "learn this one (phaselead learn), or drive that one"
            )
        return Replaced.of(wanted, known.played_um, lag_s=known.lag_s, trial_s=known.trial_s)

    def as_dict(self) -> dict[str, Any]:
        """The figures that ``phaselead learn`` prints."""
        best = _trial_dict(self.best)
        return {
            "mode": self.mode,
            "follows": self.follows,
            "reason": self.reason,
            "in_fault": self.in_fault,
            "best": best,
            "trials": [_trial_dict(trial) for trial in self.trials],
            "modes": {axis: path.modes for axis, path in self.paths.items()},
            "swing_um": {axis: float(np.ptp(path.wanted_um)) for axis, path in self.paths.items()},
        }

    @property
    def columns(self) -> dict[str, list[Any]]:
        """One row a trial and axis."""
        rows = [(trial, axis) for trial in self.trials for axis in self.paths]
        return {
            "trial": [trial.number for trial, _ in rows],
            "axis": [axis for _, axis in rows],
            "kept": [trial.kept for trial, _ in rows],
            "max_um": [trial.max_um[axis] for trial, axis in rows],
            "rms_um": [trial.rms_um[axis] for trial, axis in rows],
        }

    def tables(self) -> list[Table | str]:
        headings = ("trial", "axis", "max (µm)", "max (%)", "rms (µm)", "judged by (%)", "lines", "")
        rows = []
        for trial in self.trials:
            for axis, path in self.paths.items():
                largest, rms = trial.max_um[axis], trial.rms_um[axis]
                probed = trial.probed_lines[axis]
                lines = f"{trial.learned_lines[axis]}" + (f" + {probed} probed" if probed else "")
                share = 100 * largest / float(np.ptp(path.wanted_um))
                said = "" if trial.kept else "not kept"
                judged = "" if trial.judged_pct is None else f"{trial.judged_pct:.4f}"
                figures = (f"{largest:.4g}", f"{share:.3f}", f"{rms:.4g}", judged)
                rows.append((str(trial.number), axis, *figures, lines, said))
        position = "true position follows" if self.follows == "true" else "measured position follows"
        return [Table(headings, tuple(rows), f"mode {self.mode}, {position}"), *self._gained(), self.reason]

    def _gained(self) -> list[str]:
        """What the best trial is better by."""
        first, best = self.trials[0].judged_pct, self.best.judged_pct
        if first is None or best is None:
            return []
        if not self.best.number:
            return ["no trial was better than the first, which is without anything learned"]
        judged = "rms of the error once it has settled, in per cent of the swing"
        times = f", {first / best:.3g} times less" if best > 0 else ""
        return [f"trial {self.best.number} is kept: {first:.4f} -> {best:.4f} %{times} ({judged})"]

    def plot(self) -> Figure:
        """Error against trial, and what is added to the path."""
        from phaselead.control.pictures import learning_figure  # matplotlib is slow to load and is needed here only

        errors: dict[str, dict[str, Samples]] = {}
        for axis, path in self.paths.items():
            percent = 100 / float(np.ptp(path.wanted_um))
            of_axis = [("max", [t.max_um[axis] for t in self.trials]), ("rms", [t.rms_um[axis] for t in self.trials])]
            true = [t.true_max_um[axis] for t in self.trials if t.true_max_um is not None]
            shown = [*of_axis, ("max of the true position", true)] if true else of_axis
            errors[axis] = {name: percent * np.array(values) for name, values in shown}
        added = {axis: path.played_um - path.wanted_um for axis, path in self.paths.items()}
        return learning_figure(errors, self.best.number, added)

    def save(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
        """Writes the table as HDF5, whole or not at all."""
        import h5py  # slow to load, needed here only

        with atomic_path(os.fspath(path), overwrite=overwrite) as temporary, h5py.File(temporary, "w") as file:
            file.attrs.update(format=FORMAT, version=VERSION, stage_sha256=self.stage_sha256, mode=self.mode)
            file.attrs.update(follows=self.follows, reason=self.reason, wave=self.wave)
            file.attrs["trials"] = json.dumps([asdict(trial) for trial in self.trials])
            for axis, known in self.paths.items():
                group = file.create_group(axis)
                group["wanted_um"], group["played_um"] = known.wanted_um, known.played_um
                group.attrs.update(f_Hz=known.f_Hz, lag_s=known.lag_s, trial_s=known.trial_s, modes=known.modes)
                group.attrs["gains"] = "" if known.gains is None else known.gains.model_dump_json()

    def __repr__(self) -> str:
        return f"<Learned {self.mode}: {len(self.trials)} trials, axes {''.join(self.paths)}>"


def _trial_dict(trial: Trial) -> dict[str, Any]:
    return asdict(trial) | {"source": trial.source._asdict()}


def one_period(wanted: Waveform) -> Samples:
    """A periodic path at the points that the device plays, (1024,)."""
    return wanted.value(np.arange(POINTS) / POINTS / wanted.f_Hz)


def load_learned(path: str | os.PathLike[str]) -> Learned:
    """A table that ``Learned.save`` wrote. Raises BadInput for any other file."""
    import h5py  # slow to load, needed here only

    name = os.fspath(path)
    require_walkable(name)
    try:
        with h5py.File(name) as file:
            return _read(file)
    except OSError as error:
        # What h5py says itself is about its calls.
        reason = "is no HDF5 file" if error.errno is None else f"cannot be read ({os.strerror(error.errno)})"
        raise BadInput(f"{name}: {reason}; give a table that phaselead learn wrote") from None
    except (KeyError, ValueError, TypeError):
        raise BadInput(f"{name}: is no table of this version; give one that phaselead learn wrote") from None


def _read(file: Any) -> Learned:
    if file.attrs["format"] != FORMAT or file.attrs["version"] not in READ or file.attrs["follows"] not in FOLLOWS:
        raise ValueError
    paths = {}
    for axis, group in file.items():
        wanted_um, played_um = group["wanted_um"][()], group["played_um"][()]
        numbers = [float(group.attrs[name]) for name in ("f_Hz", "lag_s", "trial_s")]
        modes = float(group.attrs.get("modes", 1.0))
        fits = wanted_um.shape == played_um.shape == (POINTS,) and axis in ("x", "y", "z")
        if not fits or not np.isfinite([*wanted_um, *played_um, *numbers, modes]).all() or modes <= 0:
            raise ValueError
        gains = str(group.attrs["gains"])
        f_Hz, lag_s, trial_s = numbers
        own = Gains.model_validate_json(gains) if gains else None
        paths[axis] = LearnedPath(f_Hz, wanted_um, played_um, lag_s, trial_s, own, modes)
    trials = tuple(
        Trial(**(each | {"source": Source(*each.get("source", UNKNOWN))})) for each in json.loads(file.attrs["trials"])
    )
    stage_sha256, mode, reason = (str(file.attrs[name]) for name in ("stage_sha256", "mode", "reason"))
    if not paths or not any(trial.kept for trial in trials):
        raise ValueError
    wave = str(file.attrs.get("wave", ""))
    return Learned(stage_sha256, mode, file.attrs["follows"], paths, trials, reason, wave)
