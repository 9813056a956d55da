"""The modes that all axes of a stage share, fitted to its training records, and how they soften with the level."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phaselead.gap.effect_search import Progress
from phaselead.gap.several_axes.in_front import FIRST_TAU_s, InFront, no_shaping
from phaselead.gap.several_axes.joint_records import Entries, JointRecord, effect_of, level_groups, response_groups
from phaselead.identify import (
    ModalFit,
    ModalModel,
    common_poles,
    fit_modes,
    frequency_response,
)
from phaselead.model import Complex, Effect, Parameter
from phaselead.record import Samples

SAME_POLE = 0.03
"""Poles at two levels that differ by less than this share belong to one mode."""
MOST_ADDED_DAMPING = 0.1
"""Largest damping ratio of a mode that only records of a weaker level show."""
TAUS_s = (0.1, 0.3, 1.0, 3.0)
"""Memories of the level that are tried."""
EXPONENTS = (0.5, 2.0)
"""Powers of the level that are tried beside Rayleigh's 1."""
LEVELS_OF_A_POWER = 3
"""Fewest levels that determine the power: a pole and its shift have two values, which follow two levels under any."""
STEPS, SOFT_STEPS, LAST_STEPS, EXPONENT_STEPS = 10, 20, 6, 12
"""Most steps of a fit of the modes, of one with softening, of a last refinement, and under another exponent."""


@dataclass(frozen=True)
class CommonModes:
    """The fitted modes and, by axis, the effects in front of them."""

    fit: ModalFit
    entries: Entries
    split: Samples
    """(m, axes): share of each actuator's level in moving a pole."""
    taus_s: tuple[float, float] | None = None
    """Interval in which the memory of the level may lie; None without softening."""
    exponents: tuple[float, float] | None = None
    """Interval in which the power of the level may lie; None without softening."""
    given: Entries = field(default_factory=dict)
    """By axis: the first of the ``entries``, which the base has and no fit changes."""
    front: InFront | None = None
    """What was fitted in front of the modes; None without anything."""
    other_powers: tuple[CommonModes, ...] = ()
    """The same under the least and the largest power of the level that were tried."""
    modes_kept: bool = False
    """Whether the modes are those of the base, as it has them."""

    @property
    def model(self) -> ModalModel:
        """The modes, all together."""
        return self.fit.model

    @property
    def held(self) -> ModalModel | None:
        """The modes that a further fit keeps; None where it may move them."""
        return self.model if self.modes_kept else None

    def answer(self, record: JointRecord) -> Samples:
        """Predicted displacement from rest (n + 1, axes) in um."""
        return self.model.answer(record.drive(self.entries))


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


def fit_softening(
    train: Sequence[JointRecord], start: CommonModes, others: Sequence[Effect], report: Progress
) -> CommonModes:
    """The modes of ``start``, with poles and gains that follow the level of the actuators, and with the effects
    ``others`` in front of them. Modes that are kept stay as they are, and so does softening that they have."""
    front = InFront(train[0].axes, tuple(others), softens=not start.given, given=start.given)
    if start.given:
        return _fit_others(train, start, front, report)
    values = front.first_values
    shift = np.zeros(len(start.model.poles), dtype=complex)

    def fitted(
        front: InFront, poles: Complex, shift: Complex, values: Samples, steps: int, weights: Samples | None = None
    ) -> ModalFit:
        return fit_modes(
            poles,
            front.shaping(train, values),
            shift=shift,
            split=start.split,
            most_steps=steps,
            weights=weights,
            held=start.held,
            report=(lambda s: report(0.6 * s)) if steps == SOFT_STEPS else None,
        )

    best = fitted(front, start.fit.model.poles, shift, values, SOFT_STEPS)
    assert best.shift is not None
    tried = {t: _squares_left(train, best, replace(front, tau_s=t)) for t in TAUS_s}
    front = replace(front, tau_s=min(tried, key=lambda t: tried[t]))
    if front.tau_s != FIRST_TAU_s:
        best = fitted(front, best.model.poles, best.shift, best.values, LAST_STEPS)
    report(0.75)
    powers = {front.exponent: best}
    for exponent in EXPONENTS:
        begin = _with_exponent(train, front, best, start.split, exponent, start.modes_kept)
        powers[exponent] = fitted(replace(front, exponent=exponent), *begin, EXPONENT_STEPS, best.weights)
    left = {exponent: _squares_left(train, fit, replace(front, exponent=exponent)) for exponent, fit in powers.items()}
    exponents = _exponents(left, train)
    if (exponents[0], exponents[1]) != (min(left), max(left)):
        front = replace(front, exponent=_best_at_rest(left, powers))
        exponents = (min(exponents[0], front.exponent), max(exponents[1], front.exponent))
    report(1.0)
    fit = powers[front.exponent]
    entries = front.entries(fit.values.tolist())
    taus_s = _between(tried, effect_of("level").parameter("tau_s"))
    found = replace(start, fit=fit, front=front, entries=entries, taus_s=taus_s, exponents=exponents)
    return replace(found, other_powers=tuple(_under_power(found, front, powers[p], p) for p in EXPONENTS))


def _best_at_rest(left: Mapping[float, float], powers: Mapping[float, ModalFit]) -> float:
    """The power that leaves least, of those whose modes are damped at rest too: between the levels of the records
    others may fit as well, but a model must hold wherever it is asked."""
    damped = [power for power, fit in powers.items() if (fit.model.zeta > 0).all()]
    return min(damped or left, key=lambda power: left[power])


def _under_power(found: CommonModes, front: InFront, fit: ModalFit, exponent: float) -> CommonModes:
    """The softened modes as they were fitted under another power of the level."""
    other = replace(front, exponent=exponent)
    return replace(found, fit=fit, front=other, entries=other.entries(fit.values.tolist()))


def _fit_others(train: Sequence[JointRecord], start: CommonModes, front: InFront, report: Progress) -> CommonModes:
    """Modes that are kept with softening of their own, and what is fitted beside it."""
    shaping = front.shaping(train, front.first_values)
    fit = fit_modes(
        start.model.poles, shaping, split=start.split, most_steps=SOFT_STEPS, held=start.model, report=report
    )
    return replace(start, fit=fit, front=front, entries=front.entries(fit.values.tolist()))


def _with_exponent(
    train: Sequence[JointRecord], front: InFront, fit: ModalFit, split: Samples, exponent: float, modes_kept: bool
) -> tuple[Complex, Complex, Samples]:
    """Poles, shifts and values that at the weakest and at the strongest level are the same under another exponent;
    where poles are kept (``modes_kept``) at the strongest alone."""
    assert fit.shift is not None
    own = np.eye(len(front.axes))
    of_shift, of_gain = (
        [_extreme_levels(train, f, fit, of) for f in (front, replace(front, exponent=exponent))] for of in (split, own)
    )
    base, rise = _matched(of_shift[0], of_shift[1], -fit.shift, modes_kept)
    values = fit.values.copy()
    _, values[: len(own)] = _matched(of_gain[0], of_gain[1], values[: len(own)], modes_kept)
    return fit.model.poles * base, -rise, values


def _extreme_levels(
    train: Sequence[JointRecord], front: InFront, fit: ModalFit, split: Samples
) -> tuple[Samples, Samples]:
    """Mean levels (k,) of the weakest record and of the strongest, of which each counts ``split`` (k, axes)."""
    drives = front.shaping(train, fit.values).drives(fit.values)
    ranked = sorted((d.mean_level(split) for d in drives), key=lambda level: float(level.mean()))
    return ranked[0], ranked[-1]


def _matched(
    was: tuple[Samples, Samples], now: tuple[Samples, Samples], rise: NDArray[Any], modes_kept: bool
) -> tuple[NDArray[Any], NDArray[Any]]:
    """``base`` and its relative rise per level for which base (1 + rise level) is what 1 + ``rise`` level was, at the
    levels ``was`` and ``now``; where the base is kept (``modes_kept``), 1, at the higher level alone."""
    if modes_kept:
        return np.ones(len(rise)), rise * was[1] / now[1]
    at_low, at_high = 1 + rise * was[0], 1 + rise * was[1]
    slope = (at_high - at_low) / (now[1] - now[0])
    base = at_low - slope * now[0]
    return base, slope / base


def _squares_left(train: Sequence[JointRecord], fit: ModalFit, front: InFront) -> float:
    """Weighted squares of the residual with these shapes of the level and everything else as fitted."""
    total = 0.0
    for drive, weight in zip(front.shaping(train, fit.values).drives(fit.values), fit.weights, strict=True):
        error = (drive.x_um - fit.model.answer(drive))[drive.rows]
        total += weight * float(np.sum((error - error.mean(axis=0)) ** 2))
    return total


def _exponents(left: Mapping[float, float], train: Sequence[JointRecord]) -> tuple[float, float]:
    """Interval in which the power may lie; the whole range where the records have too few levels to determine it."""
    shape = effect_of("level").parameter("exponent")
    return _between(left, shape) if len(level_groups(train)) >= LEVELS_OF_A_POWER else (shape.low, shape.high)


def _between(left: Mapping[float, float], shape: Parameter) -> tuple[float, float]:
    """Interval of the values that leave at most 1 % more than the best: all that can be said of something so slow, or
    of a power that few levels show. A bound where the outermost value tried is among them."""
    least = min(left.values())
    allowed = [value for value, squares in left.items() if squares < 1.01 * least]
    low, high = min(allowed), max(allowed)
    return (low if low > min(left) else shape.low, high if high < max(left) else shape.high)
