"""The modes that all axes of a stage share, fitted to its training records, and how they soften with the level."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from phaselead.gap.search import Progress
from phaselead.gap.several_axes.joint_records import Entries, JointRecord, effect_of, level_groups, response_groups
from phaselead.identify import (
    Drive,
    Drives,
    ModalFit,
    ModalModel,
    Shaping,
    common_poles,
    fit_modes,
    frequency_response,
)
from phaselead.model import Complex, Entry
from phaselead.record import Samples

SAME_POLE = 0.03
"""Poles at two levels that differ by less than this share belong to one mode."""
MOST_ADDED_DAMPING = 0.1
"""Largest damping ratio of a mode that only records of a weaker level show."""
TAUS_s = (0.1, 0.3, 1.0, 3.0)
"""Memories of the level that are tried."""
FIRST_TAU_s = 0.3
KAPPA_STEP = 1e-3
STEPS, SOFT_STEPS, LAST_STEPS = 10, 20, 6
"""Most steps of a fit of the modes, of one with softening, and of a last refinement."""


@dataclass(frozen=True)
class CommonModes:
    """The fitted modes and, by axis, the effects in front of them."""

    fit: ModalFit
    entries: Entries
    split: Samples
    """(m, axes): share of each actuator's level in moving a pole."""
    taus_s: tuple[float, float] | None = None
    """Interval in which the memory of the level may lie; None without softening."""

    @property
    def model(self) -> ModalModel:
        """The modes, all together."""
        return self.fit.model

    def answer(self, record: JointRecord) -> Samples:
        """Predicted displacement from rest (n + 1, axes) in um."""
        return self.model.answer(record.drive(self.entries))


def no_shaping(records: Sequence[JointRecord], entries: Entries) -> Shaping:
    """The drives of records for a fit that leaves them as they are."""
    none = np.zeros(0)
    drives = [record.drive(entries) for record in records]
    return Shaping(lambda _: drives, none, none, none, none)


def fit_linear(train: Sequence[JointRecord], report: Progress) -> tuple[CommonModes, CommonModes]:
    """Modes fitted to the records of the strongest level, and the same modes fitted to all records.

    Raises BadInput where the records cannot tell the inputs apart.
    """
    groups = response_groups(train)
    poles = _poles_of_all(groups, lambda share: report(0.5 * share))
    own = fit_modes(poles, no_shaping(groups[0], {}), most_steps=STEPS, report=lambda s: report(0.5 + 0.25 * s))
    strongest = CommonModes(own, {}, own.model.participation())
    if len(level_groups(train)) == 1:
        return strongest, strongest
    common = fit_modes(
        own.model.poles, no_shaping(train, {}), most_steps=LAST_STEPS, report=lambda s: report(0.75 + 0.25 * s)
    )
    return strongest, CommonModes(common, {}, common.model.participation())


def _poles_of_all(groups: Sequence[Sequence[JointRecord]], report: Progress) -> Complex:
    """Poles of the records of the strongest level, and lightly damped ones that only weaker records show."""
    found: Complex | None = None
    for i, group in enumerate(groups):
        poles = common_poles(
            frequency_response([s.experiment for s in group]),
            lambda share, done=i: report((done + share) / len(groups)),  # type: ignore[misc]
            0 if found is None else len(found),
        )
        if found is None:
            found = np.asarray(poles, dtype=complex)
            continue
        far = [
            q for q in poles if np.min(np.abs(found - q)) > SAME_POLE * abs(q) and -q.real < MOST_ADDED_DAMPING * abs(q)
        ]
        inside = [q for q in far if found[0].imag < q.imag < np.max(found.imag)]
        found = np.concatenate([found, np.array(inside, dtype=complex)])
    assert found is not None
    return found


def softening_entries(axes: Sequence[str], kappa: Sequence[float], tau_s: float) -> dict[str, list[Entry]]:
    """Softening of each actuator: gain ``kappa`` and memory ``tau_s``. How the modes move is left to their fit."""
    softening = effect_of("level")
    return {
        a: [(softening, {"kappa": float(k), "tau_s": tau_s, "about_mean": 0.0})]
        for a, k in zip(axes, kappa, strict=True)
    }


def _softening_drives(records: Sequence[JointRecord], tau_s: float) -> Drives:
    """Drives of records as a function of the gains (axes,); the last two results are kept."""
    axes = records[0].axes
    known: dict[bytes, list[Drive]] = {}

    def drives(kappa: Samples) -> Sequence[Drive]:
        key = kappa.tobytes()
        if key not in known:
            while len(known) > 1:
                del known[next(iter(known))]
            known[key] = [s.drive(softening_entries(axes, kappa.tolist(), tau_s)) for s in records]
        return known[key]

    return drives


def fit_softening(train: Sequence[JointRecord], start: CommonModes, report: Progress) -> CommonModes:
    """The modes of ``start``, with poles and gains that follow the level of the actuators."""
    axes = train[0].axes
    count = len(axes)
    shift = np.zeros(len(start.model.poles), dtype=complex)
    bound = np.full(count, float(effect_of("level").parameter("kappa").high))

    def fitted(begin: ModalFit, from_shift: Complex, kappa: Samples, tau_s: float, steps: int) -> ModalFit:
        shaping = Shaping(_softening_drives(train, tau_s), kappa, np.full(count, KAPPA_STEP), -bound, bound)
        return fit_modes(
            begin.model.poles,
            shaping,
            shift=from_shift,
            split=start.split,
            most_steps=steps,
            report=(lambda s: report(0.7 * s)) if steps == SOFT_STEPS else None,
        )

    best = fitted(start.fit, shift, np.zeros(count), FIRST_TAU_s, SOFT_STEPS)
    assert best.shift is not None
    tried = {t: _squares_left(train, best, t) for t in TAUS_s}
    tau_s = min(tried, key=lambda t: tried[t])
    if tau_s != FIRST_TAU_s:
        best = fitted(best, best.shift, best.values, tau_s, LAST_STEPS)
    report(1.0)
    entries = softening_entries(axes, best.values.tolist(), tau_s)
    return CommonModes(best, entries, start.split, _between(tried))


def _squares_left(train: Sequence[JointRecord], fit: ModalFit, tau_s: float) -> float:
    """Weighted squares of the residual with this memory of the level and everything else as fitted."""
    drives = _softening_drives(train, tau_s)(fit.values)
    total = 0.0
    for drive, weight in zip(drives, fit.weights, strict=True):
        error = (drive.x_um - fit.model.answer(drive))[drive.rows]
        total += weight * float(np.sum((error - error.mean(axis=0)) ** 2))
    return total


def _between(left: Mapping[float, float]) -> tuple[float, float]:
    """Interval of the memories that leave at most 1 % more than the best: all that can be said of something so slow."""
    least = min(left.values())
    allowed = [t for t, value in left.items() if value < 1.01 * least]
    low, high = min(allowed), max(allowed)
    bounds = effect_of("level").parameter("tau_s")
    return (low if low > min(left) else bounds.low, high if high < max(left) else bounds.high)
