"""What equations miss: columns that bend a signal smoothly, for the base's own signals and for those of an effect.

No stage obeys its equations exactly. What an equation leaves of a signal is a share of that signal which depends
smoothly on how things stand: on the level, the direction of motion, the path since the last reversal, the time scale.
So the columns are the signal times low-order functions of these.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import lfilter

from phaselead.gap.refit import SizedEffect, fresh_columns, is_logarithmic, to_internal
from phaselead.gap.residual import ModelledRun
from phaselead.model import Parameter, Place, range_um
from phaselead.record import Samples

BASE_SHARE = 0.01
"""Prior deviation of what a fitted base misses of its own signals: one per cent, as good fits of stages leave."""
BANDS, SHORTEST_BAND, LONGEST_BAND = 6, 1.5, 3000.0
"""Time scales into which a signal is split, and the first and the last of them in rows."""
PATHS = (0.05, 0.25)
"""Paths since a reversal, in ranges, over which a loop's shape may be off."""
DIRECTION_ROWS = 5.0
"""Rows over which a change of direction is smoothed: a corner in a column would look like a jump."""
SLOW_PARTS = (0.03, 0.17, 1.0)
"""Time constants of what fades in a record, as parts of its length."""
NEAR_RATIO, NEAR_PART = 0.3, 0.2
"""Deviation of a shape that is near another: of its logarithm, or as a part of its range."""
OUTSIDE = 1.3
"""Largest level in half ranges about the middle, beyond which polynomials of it stay as they are."""


def base_misfit(modelled: ModelledRun) -> tuple[Samples, list[str]]:
    """Columns (n, k) in um, one prior deviation each, of what the base misses of its own position, of its dynamic part
    and of its speed; and per column the name of its group, which share a spread."""
    position = modelled.answer()
    still = modelled.chain.signal_at(Place.HYSTERESIS).value[1:][modelled.run.rows]
    bends = _Bends(modelled)
    found: list[Samples] = []
    names: list[str] = []
    for name, signal, banded in (
        ("position", position - position[0], True),
        ("dynamics", position - still, True),
        ("speed", np.diff(position, prepend=position[0]), False),
    ):
        parts = [("whole", [signal])] if name != "position" else []
        parts += [("level", bends.by_level(signal)), ("path", bends.by_path(signal))]
        parts += [("band", bends.by_band(signal))] if banded else []
        for part, columns in parts:
            found += columns
            names += [f"{name} by {part}"] * len(columns)
    slow = _slow(modelled)
    return np.concatenate([BASE_SHARE * np.stack(found, axis=1), slow], axis=1), [*names, *["slow"] * slow.shape[1]]


def _slow(modelled: ModelledRun) -> Samples:
    """Columns (n, k) in um of what went on before the record began and fades: lags of several time scales, and a
    straight line."""
    run = modelled.run
    since_s = run.t_s[run.rows] - run.t_s[0]
    whole_s = float(since_s[-1])
    fading = [np.exp(-since_s / (part * whole_s)) for part in SLOW_PARTS]
    return BASE_SHARE * range_um(modelled.axis) * np.stack([*fading, since_s / whole_s], axis=1)


def equation_misfit(modelled: ModelledRun, entries: Sequence[SizedEffect], index: int) -> Samples:
    """Columns (n, k) in um of what the equation of effect ``index`` of the entries may miss, for a share of 1."""
    rest = [entry for i, entry in enumerate(entries) if i != index]
    signal = modelled.answer(entries) - modelled.answer(rest)
    signal = signal - signal[0]
    effect = entries[index][0]
    if effect.moves_zero is not None:  # no voltage moves it: only its course in time may be off
        time = np.linspace(-1.0, 1.0, len(signal))
        return np.stack([signal * time, signal * (1.5 * time**2 - 0.5)], axis=1)
    bends = _Bends(modelled)
    return np.stack([*bends.by_level(signal), *bends.by_path(signal), *bends.by_band(signal)], axis=1)


def before_record(modelled: ModelledRun, entries: Sequence[SizedEffect]) -> Samples | None:
    """Columns (n, k) in um of what slow effects had done before the record began, one deviation of the state of each
    of their lags; None without a slow effect. What stood off as a voltage passes the hysteresis."""
    run = modelled.run
    since_s = run.t_s - run.t_s[0]
    found: list[Samples] = []
    for effect, params in entries:
        if effect.before_record is None:
            continue
        columns = effect.before_record(since_s, params, modelled.axis)
        if effect.place <= Place.AMPLIFIER:
            found += [modelled.after_voltage(column) for column in columns.T]
        else:
            found += list(columns[run.rows].T)
    return np.stack(found, axis=1) if found else None


def signal_of(modelled: ModelledRun, entries: Sequence[SizedEffect], index: int) -> Samples:
    """Column (n, 1) in um: what one effect adds to the others."""
    rest = [*entries[:index], *entries[index + 1 :]]
    return np.asarray((modelled.answer(entries) - modelled.answer(rest))[:, None])


def as_fault(modelled: ModelledRun, entries: Sequence[SizedEffect]) -> Samples:
    """Columns (n, parameters) in um of effects that the base may lack in all records: one deviation of each parameter,
    as large as they are and of shapes near theirs."""
    free = parameters_of(entries)
    deviations = np.array([_fault_deviation(p, entries[i][1][p.name]) for i, p in free])
    return np.asarray(fresh_columns(modelled, entries, free)[:, :-1] * deviations)


def as_fault_of(modelled: ModelledRun, entries: Sequence[SizedEffect], index: int) -> Samples:
    """The same of one of the effects, beside the others."""
    free = [(i, p) for i, p in parameters_of(entries) if i == index]
    deviations = np.array([_fault_deviation(p, entries[i][1][p.name]) for i, p in free])
    return np.asarray(fresh_columns(modelled, entries, free)[:, :-1] * deviations)


def _fault_deviation(p: Parameter, value: float) -> float:
    """In internal units."""
    if p.role == "size":
        return abs(to_internal(p, value))
    return NEAR_RATIO if is_logarithmic(p) else NEAR_PART * abs(to_internal(p, p.high) - to_internal(p, p.low))


def parameters_of(entries: Sequence[SizedEffect]) -> list[tuple[int, Parameter]]:
    """Every parameter, after the number of the entry it belongs to."""
    return [(i, p) for i, (effect, _) in enumerate(entries) for p in effect.parameters]


class _Bends:
    """Smooth functions of how things stand in a record."""

    def __init__(self, modelled: ModelledRun) -> None:
        view = modelled.axis.time
        assert view is not None
        u = modelled.run.u_V[modelled.run.rows]
        low, high = view.u_range_V
        self._step_s = modelled.run.step_s
        self._level = np.clip((2 * u - low - high) / (high - low), -OUTSIDE, OUTSIDE)
        move = np.diff(u, prepend=u[0])
        way = np.cumsum(np.abs(move)) / (high - low)
        sign = np.sign(move)
        keep = 1 - 1 / DIRECTION_ROWS
        self._direction = np.asarray(lfilter([1 - keep], [1, -keep], sign))
        moving = np.flatnonzero(sign)
        turned = moving[1:][sign[moving[1:]] != sign[moving[:-1]]] if len(moving) else moving
        mark = np.zeros(len(u))
        mark[turned] = way[turned]
        self._since = way - np.maximum.accumulate(mark)

    def by_level(self, s: Samples) -> list[Samples]:
        """Times the first three Legendre polynomials of the level."""
        z = self._level
        return [s * z, s * (1.5 * z**2 - 0.5), s * (2.5 * z**3 - 1.5 * z)]

    def by_path(self, s: Samples) -> list[Samples]:
        """Times the direction, and fading with the path since the last reversal."""
        return [s * self._direction, *(s * np.exp(-self._since / path) for path in PATHS)]

    def by_band(self, s: Samples) -> list[Samples]:
        """Split by time scale, each band as it is and late: changes of gain and of phase that vary slowly with the
        frequency."""
        pad = np.pad(s, 1, mode="edge")
        found = [(pad[2:] - pad[:-2]) / 2, (2 * s - pad[2:] - pad[:-2]) / 4]
        causal = anticausal = s
        for rows in np.geomspace(SHORTEST_BAND, LONGEST_BAND, BANDS - 1):
            keep = np.exp(-1 / rows)
            smooth = np.asarray(lfilter([1 - keep], [1, -keep], s - s[0])) + s[0]
            ahead = np.asarray(lfilter([1 - keep], [1, -keep], (s - s[-1])[::-1]))[::-1] + s[-1]
            found += [(causal - smooth + anticausal - ahead) / 2, (causal - smooth - anticausal + ahead) / 2]
            causal, anticausal = smooth, ahead
        return [*found, (causal + anticausal) / 2]
