"""The modes that all axes of a stage share, fitted to its training records, and how they soften with the level."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phaselead.gap.search import Progress
from phaselead.gap.several_axes.joint_records import Entries, JointRecord, effect_of, level_groups, response_groups
from phaselead.identify import (
    Drive,
    ModalFit,
    ModalModel,
    Shaping,
    common_poles,
    fit_modes,
    frequency_response,
)
from phaselead.model import Complex, Effect, Entry, Parameter
from phaselead.record import Samples

SAME_POLE = 0.03
"""Poles at two levels that differ by less than this share belong to one mode."""
MOST_ADDED_DAMPING = 0.1
"""Largest damping ratio of a mode that only records of a weaker level show."""
TAUS_s = (0.1, 0.3, 1.0, 3.0)
"""Memories of the level that are tried."""
FIRST_TAU_s = 0.3
EXPONENTS = (0.5, 2.0)
"""Powers of the level that are tried beside Rayleigh's 1."""
SIZE_STEP = 0.02
"""Of the typical size, for derivatives."""
STEPS, SOFT_STEPS, LAST_STEPS, EXPONENT_STEPS = 10, 20, 6, 4
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


def fitted_parameters(effect: Effect) -> tuple[Parameter, ...]:
    """What is fitted of an effect in front of the modes: its first size and its shapes. Those of softening are tried
    one by one, since its level is slow."""
    return effect.sizes[:1] if effect.shared_modes == "level" else (*effect.sizes[:1], *effect.shapes)


@dataclass(frozen=True)
class _InFront:
    """What is fitted in front of the modes: softening of every actuator, and the effects ``others``."""

    axes: tuple[str, ...]
    others: tuple[Effect, ...]
    tau_s: float = FIRST_TAU_s
    exponent: float = 1.0

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Softening first."""
        return (effect_of("level"), *self.others)

    @property
    def first_values(self) -> Samples:
        """From which a fit begins: nothing softens, everything else is as is typical."""
        found = [0.0 if e.shared_modes == "level" else p.typical for e in self.effects for p in fitted_parameters(e)]
        return np.repeat(found, len(self.axes))

    def entries(self, values: Sequence[float]) -> dict[str, list[Entry]]:
        """The effects of every axis for ``values``: each fitted parameter of each effect in turn, axis by axis. How
        softening moves the modes is left to their fit."""
        found: dict[str, list[Entry]] = {axis: [] for axis in self.axes}
        shapes = {"tau_s": self.tau_s, "exponent": self.exponent}
        by_parameter = iter(np.reshape(values, (-1, len(self.axes))).tolist())
        for effect in self.effects:
            given = shapes if effect.shared_modes == "level" else {}
            of_axes = {p.name: next(by_parameter) for p in fitted_parameters(effect)}
            for i, axis in enumerate(self.axes):
                own = {name: values[i] for name, values in of_axes.items()}
                found[axis].append((effect, effect.complete({**given, **own})))
        return found

    def shaping(self, records: Sequence[JointRecord], values: Samples) -> Shaping:
        """The drives of records as a function of the values, from ``values`` on; the last two results are kept."""
        known: dict[bytes, list[Drive]] = {}

        def drives(at: Samples) -> Sequence[Drive]:
            key = at.tobytes()
            if key not in known:
                while len(known) > 1:
                    del known[next(iter(known))]
                known[key] = [s.drive(self.entries(at.tolist())) for s in records]
            return known[key]

        fitted = [p for effect in self.effects for p in fitted_parameters(effect)]
        rows = [(SIZE_STEP * p.typical, p.low, p.high) for p in fitted for _ in self.axes]
        steps, low, high = np.array(rows, dtype=np.float64).T
        return Shaping(drives, values, steps, low, high)


def fit_softening(
    train: Sequence[JointRecord], start: CommonModes, others: Sequence[Effect], report: Progress
) -> CommonModes:
    """The modes of ``start``, with poles and gains that follow the level of the actuators, and with the effects
    ``others`` in front of them."""
    front = _InFront(train[0].axes, tuple(others))
    values = front.first_values
    shift = np.zeros(len(start.model.poles), dtype=complex)

    def fitted(
        front: _InFront, poles: Complex, shift: Complex, values: Samples, steps: int, weights: Samples | None = None
    ) -> ModalFit:
        return fit_modes(
            poles,
            front.shaping(train, values),
            shift=shift,
            split=start.split,
            most_steps=steps,
            weights=weights,
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
        begin = _with_exponent(train, front, best, start.split, exponent)
        powers[exponent] = fitted(replace(front, exponent=exponent), *begin, EXPONENT_STEPS, best.weights)
    left = {exponent: _squares_left(train, fit, replace(front, exponent=exponent)) for exponent, fit in powers.items()}
    exponents = _between(left, effect_of("level").parameter("exponent"))
    if (exponents[0], exponents[1]) != (min(left), max(left)):
        front = replace(front, exponent=min(left, key=lambda p: left[p]))
    report(1.0)
    fit = powers[front.exponent]
    entries = front.entries(fit.values.tolist())
    return CommonModes(fit, entries, start.split, _between(tried, effect_of("level").parameter("tau_s")), exponents)


def _with_exponent(
    train: Sequence[JointRecord], front: _InFront, fit: ModalFit, split: Samples, exponent: float
) -> tuple[Complex, Complex, Samples]:
    """Poles, shifts and values that at the weakest and at the strongest level are the same under another exponent."""
    assert fit.shift is not None
    own = np.eye(len(front.axes))
    of_shift, of_gain = (
        [_extreme_levels(train, f, fit, of) for f in (front, replace(front, exponent=exponent))] for of in (split, own)
    )
    base, rise = _matched(of_shift[0], of_shift[1], -fit.shift)
    values = fit.values.copy()
    _, values[: len(own)] = _matched(of_gain[0], of_gain[1], values[: len(own)])
    return fit.model.poles * base, -rise, values


def _extreme_levels(
    train: Sequence[JointRecord], front: _InFront, fit: ModalFit, split: Samples
) -> tuple[Samples, Samples]:
    """Mean levels (k,) of the weakest record and of the strongest, of which each counts ``split`` (k, axes)."""
    drives = front.shaping(train, fit.values).drives(fit.values)
    ranked = sorted((d.mean_level(split) for d in drives), key=lambda level: float(level.mean()))
    return ranked[0], ranked[-1]


def _matched(
    was: tuple[Samples, Samples], now: tuple[Samples, Samples], rise: NDArray[Any]
) -> tuple[NDArray[Any], NDArray[Any]]:
    """``base`` and its relative rise per level for which base (1 + rise level) is what 1 + ``rise`` level was, at the
    levels ``was`` and ``now``."""
    at_low, at_high = 1 + rise * was[0], 1 + rise * was[1]
    slope = (at_high - at_low) / (now[1] - now[0])
    base = at_low - slope * now[0]
    return base, slope / base


def _squares_left(train: Sequence[JointRecord], fit: ModalFit, front: _InFront) -> float:
    """Weighted squares of the residual with these shapes of the level and everything else as fitted."""
    total = 0.0
    for drive, weight in zip(front.shaping(train, fit.values).drives(fit.values), fit.weights, strict=True):
        error = (drive.x_um - fit.model.answer(drive))[drive.rows]
        total += weight * float(np.sum((error - error.mean(axis=0)) ** 2))
    return total


def _between(left: Mapping[float, float], shape: Parameter) -> tuple[float, float]:
    """Interval of the values that leave at most 1 % more than the best: all that can be said of something so slow, or
    of a power that few levels show. A bound where the outermost value tried is among them."""
    least = min(left.values())
    allowed = [value for value, squares in left.items() if squares < 1.01 * least]
    low, high = min(allowed), max(allowed)
    return (low if low > min(left) else shape.low, high if high < max(left) else shape.high)
