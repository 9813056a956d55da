"""Common modes of a stage from its training records, and whether the records show that they soften."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from phaselead.gap.multi_axis_records import Entries, Stand, level_groups, response_groups
from phaselead.identify import (
    Complex,
    Drive,
    Drives,
    ModalFit,
    ModalModel,
    Shaping,
    common_poles,
    fit_modes,
    frequency_response,
)
from phaselead.model import Entry, effect
from phaselead.record import Samples

Report = Callable[[float], None]

NEAR = 0.03
"""Modes of two levels whose poles differ by less than this share are the same one."""
RINGS = 0.1
"""Largest damping ratio of a mode that is taken over from the records of another level."""
TAUS_s = (0.1, 0.3, 1.0, 3.0)
FIRST_TAU_s = 0.3
KAPPA_STEP = 1e-3
STEPS, SOFT_STEPS, LAST_STEPS = 10, 20, 6


@dataclass(frozen=True)
class SharedFit:
    """Modes and, per axis, the effects in front of them, as fitted."""

    fit: ModalFit
    entries: Entries
    split: Samples
    """(m, axes): whose level moves a pole."""
    taus_s: tuple[float, float] | None = None
    """Between which the memory of the level may lie."""

    @property
    def model(self) -> ModalModel:
        """Of all modes."""
        return self.fit.model

    def answer(self, stand: Stand) -> Samples:
        """(n + 1, axes) um from rest."""
        return self.model.answer(stand.drive(self.entries))


def no_shaping(records: Sequence[Stand], entries: Entries) -> Shaping:
    """Pushes as they are."""
    none = np.zeros(0)
    drives = [stand.drive(entries) for stand in records]
    return Shaping(lambda _: drives, none, none, none, none)


def fit_linear(train: Sequence[Stand], report: Report) -> tuple[SharedFit, SharedFit]:
    """Modes of the strongest records, and the same modes fitted to all. Raises BadInput where the records cannot tell
    the inputs apart."""
    groups = response_groups(train)
    poles = _poles_of_all(groups, lambda share: report(0.5 * share))
    own = fit_modes(poles, no_shaping(groups[0], {}), most_steps=STEPS, report=lambda s: report(0.5 + 0.25 * s))
    strongest = SharedFit(own, {}, own.model.participation())
    if len(level_groups(train)) == 1:
        return strongest, strongest
    common = fit_modes(
        own.model.poles, no_shaping(train, {}), most_steps=LAST_STEPS, report=lambda s: report(0.75 + 0.25 * s)
    )
    return strongest, SharedFit(common, {}, common.model.participation())


def _poles_of_all(groups: Sequence[Sequence[Stand]], report: Report) -> Complex:
    """Those of the strongest records, and lightly damped ones that only weaker records show."""
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
        far = [q for q in poles if np.min(np.abs(found - q)) > NEAR * abs(q) and -q.real < RINGS * abs(q)]
        inside = [q for q in far if found[0].imag < q.imag < np.max(found.imag)]
        found = np.concatenate([found, np.array(inside, dtype=complex)])
    assert found is not None
    return found


def softening_entries(axes: Sequence[str], kappa: Sequence[float], tau_s: float) -> dict[str, list[Entry]]:
    """One entry per axis; what it does to the modes is the fit's."""
    soft = effect("softening")
    return {
        a: [(soft, {"kappa": float(k), "tau_s": tau_s, "about_mean": 0.0})] for a, k in zip(axes, kappa, strict=True)
    }


def _softening_drives(records: Sequence[Stand], tau_s: float) -> Drives:
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


def fit_softening(train: Sequence[Stand], start: SharedFit, report: Report) -> SharedFit:
    """The modes of ``start`` with poles and gains that follow the level of the actuators."""
    axes = train[0].axes
    count = len(axes)
    shift = np.zeros(len(start.model.poles), dtype=complex)
    bound = np.full(count, float(effect("softening").parameter("kappa").high))

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
    tried = {t: left_by(train, best, start.split, t) for t in TAUS_s}
    tau_s = min(tried, key=lambda t: tried[t])
    if tau_s != FIRST_TAU_s:
        best = fitted(best, best.shift, best.values, tau_s, LAST_STEPS)
    report(1.0)
    entries = softening_entries(axes, best.values.tolist(), tau_s)
    return SharedFit(best, entries, start.split, _between(tried))


def left_by(train: Sequence[Stand], fit: ModalFit, split: Samples, tau_s: float) -> float:
    """Weighted squares that the softening leaves with another memory of the level and everything else as it is."""
    drives = _softening_drives(train, tau_s)(fit.values)
    total = 0.0
    for drive, weight in zip(drives, fit.weights, strict=True):
        error = (drive.x_um - fit.model.answer(drive))[drive.rows]
        total += weight * float(np.sum((error - error.mean(axis=0)) ** 2))
    return total


def _between(left: Mapping[float, float]) -> tuple[float, float]:
    """Memories that leave hardly more than the best (1 %): all that can be said of something so slow."""
    least = min(left.values())
    allowed = [t for t, value in left.items() if value < 1.01 * least]
    low, high = min(allowed), max(allowed)
    bounds = effect("softening").parameter("tau_s")
    return (low if low > min(left) else bounds.low, high if high < max(left) else bounds.high)
