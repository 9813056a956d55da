"""What makes a recording unusable, each as one line that says where it is and what to do."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from phaselead.errors import BadInput
from phaselead.record.axis_record import AxisRecord, Samples
from phaselead.record.recording import Recording

UNIFORM_WITHIN = 0.01
MISSING_FROM = 1.5 * (1 + 1e-6)
"""A step of so many usual ones is no rounding: samples are missing (the excess forgives printed decimals)."""
NOT_MEASURED = 1e30
"""In any unit: its fourth power, of which estimates are made, is still a number."""
FLAT_SAMPLES = 3
"""Consecutive samples at a rail that make a signal clipped."""

Where = Callable[[int], str]
"""Names a row (0-based) in words: "line 17" of a text file, "row 16" of an array."""


def require_measured(name: str, values: Samples, where: Where, source: str) -> None:
    """Refuse NaN, infinities and what no instrument gives."""
    bad = np.flatnonzero(~(np.abs(values) < NOT_MEASURED))
    if bad.size:
        what = _unlike_measured(float(values[bad[0]]))
        more = f" (and {bad.size - 1} more)" if bad.size > 1 else ""
        raise BadInput(
            f"{source}: {where(int(bad[0]))}: {name} is {what}{more}; cut the recording there or measure again"
        )


def _unlike_measured(value: float) -> str:
    if np.isnan(value):
        return "empty or not a number"
    return "infinite" if np.isinf(value) else f"{value:.3g}, which no instrument gives"


def require_rows(rows: int, source: str) -> None:
    """Refuse fewer than the two rows that have a sampling rate."""
    if rows < 2:
        there = "1 row" if rows else "no rows"
        raise BadInput(f"{source}: has {there} of data, at least 2 are needed; record for longer, or give another file")


def require_uniform(t_s: Samples, where: Where, source: str, *, gapped: bool = False) -> None:
    """Refuse fewer than two rows, time that does not advance, and steps that differ by more than 1 %.

    ``gapped``: rows are known to be missing, so that a step may be any number of usual ones.
    """
    require_rows(len(t_s), source)
    steps = np.diff(t_s)
    still = np.flatnonzero(steps <= 0)
    if still.size:
        row = int(still[0]) + 1
        told = f"{source}: {where(row)}: t_s {{}} ({t_s[row]:.9g} s after {t_s[row - 1]:.9g} s); "
        if steps[row - 1] < 0:
            raise BadInput(told.format("goes back") + "sort the rows, or cut the recording there")
        raise BadInput(told.format("repeats") + "remove doubles, or give --rate if the times are only rounded")
    usual = float(np.median(steps))
    multiples = np.maximum(np.round(steps / usual), 1) if gapped else 1.0
    uneven = np.flatnonzero(np.abs(steps - multiples * usual) > UNIFORM_WITHIN * usual)
    if uneven.size:
        row = int(uneven[0]) + 1
        longest = int(np.argmax(steps))
        told = (
            f"{source}: {where(row)}: t_s is not uniform: a step of {steps[row - 1]:.6g} s, {usual:.6g} s "
            f"elsewhere ({uneven.size} such); "
        )
        if steps[longest] > MISSING_FROM * usual:
            raise BadInput(told + missing_samples(where(longest + 1)))
        raise BadInput(f"{told}resample it, or give --rate {1 / usual:.6g}Hz if the times are only rounded")


def require_rate(stated_Hz: object, t_s: Samples, source: str) -> None:
    """Refuse times whose rate differs by more than 1 % from the one that the file states, where it states one."""
    stated = np.asarray(stated_Hz)
    if stated.size != 1 or stated.dtype.kind not in "iuf":
        return
    told_Hz, rate_Hz = float(stated.item()), 1 / float(np.median(np.diff(t_s)))
    if not abs(told_Hz - rate_Hz) <= UNIFORM_WITHIN * rate_Hz:
        raise BadInput(
            f"{source}: states rate_Hz = {told_Hz:.6g}, but its times t_s have {rate_Hz:.6g} rows per second; "
            "mend the one that is wrong"
        )


def missing_samples(place: str) -> str:
    """What to do about a step in which samples were lost; ``place`` names the row after it."""
    return f"samples are missing before {place}: use the rows on one side of it, or record again"


def refuse_gapped(recording: Recording) -> None:
    """Refuse a capture with ticks missing: nothing can be identified across a gap."""
    gaps = recording.meta.get("gaps")
    count = len(gaps) if isinstance(gaps, (list, tuple, np.ndarray)) else int(bool(gaps))
    if count:
        places = f"{count} place{'s' if count > 1 else ''}"
        raise BadInput(f"{recording.source}: has gaps in {places} (samples lost on the line); record it again")


def refuse_clipped(recording: Recording) -> None:
    """Refuse positions that stood at a rail of the sensor, known (``meta["rails_um"]``) or recognised.

    Flat tops of the voltage are no fault: an amplifier or a limit that holds it there is what the stage was driven
    with, as long as the column is what was applied and not what was asked for.
    """
    rails = recording.meta.get("rails_um") or {}
    for name, axis in _present(recording, "x_um"):
        run = clipped_run(axis, tuple(rails[name]) if name in rails else None)
        if run is not None:
            assert axis.x_um is not None
            raise BadInput(
                f"{recording.source}: the position of axis {name} is clipped at {axis.x_um[run.start]:g} um "
                f"({run.stop - run.start} samples from t_s = {recording.t_s[run.start]:g}); "
                "record it again with less swing or a wider sensor range"
            )


def _present(recording: Recording, field: str) -> Iterator[tuple[str, AxisRecord]]:
    return ((name, axis) for name, axis in recording.axes.items() if getattr(axis, field) is not None)


def clipped_run(axis: AxisRecord, rails_um: tuple[float, float] | None = None) -> slice | None:
    """The longest run of three or more samples in which the position stood at a rail, or None.

    With ``rails_um`` (lowest and highest position the converter can say) a run at either is enough. Without
    them a flat top is told from the turning point of a coarse sensor; see ``_is_flat_top``.
    """
    x = axis.x_um
    if x is None or len(x) < FLAT_SAMPLES:
        return None
    found: list[slice] = []
    if rails_um is not None:
        slack = 1e-9 * (rails_um[1] - rails_um[0])
        found += [run for at in (x <= rails_um[0] + slack, x >= rails_um[1] - slack) for run in _runs(at)]
    elif axis.u_V is not None and np.ptp(x) > 0:
        sign, moves = _direction(axis.u_V, x), _Moves.of(x)
        gain = float(np.ptp(x) / np.ptp(axis.u_V)) if np.ptp(axis.u_V) > 0 else 0.0
        for side in (1.0, -1.0):
            u, outward_x = side * sign * axis.u_V, side * x
            runs = (run for run in _runs(outward_x == outward_x.max()) if not _asked_to_stand(axis, run))
            found += [run for run in runs if _is_flat_top(u, outward_x, run, gain, moves)]
    return max(found, key=lambda run: run.stop - run.start, default=None)


def _runs(mask: np.ndarray) -> list[slice]:
    """Runs of at least three True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(np.int8)))
    pairs = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    return [slice(start, stop) for start, stop in pairs if stop - start >= FLAT_SAMPLES]


def _direction(u_V: Samples, x_um: Samples) -> float:
    """+1 where position follows voltage, -1 where it runs against it."""
    return 1.0 if float(np.dot(u_V - u_V.mean(), x_um - x_um.mean())) >= 0 else -1.0


def _asked_to_stand(axis: AxisRecord, run: slice) -> bool:
    """In closed loop: the reference stood still, so the position had no business to move."""
    return axis.r_um is not None and float(np.ptp(axis.r_um[run])) == 0


@dataclass(frozen=True)
class _Moves:
    """How far a signal goes from one sample to the next."""

    smallest: float
    """Above 0: the step of the sensor, or less."""
    largest: tuple[tuple[int, float], ...]
    """The three largest, as (index, size)."""

    @classmethod
    def of(cls, x: Samples) -> _Moves:
        sizes = np.abs(np.diff(x))
        top = np.argpartition(sizes, -min(3, len(sizes)))[-3:].tolist()
        return cls(float(sizes[sizes > 0].min()), tuple((i, float(sizes[i])) for i in top))


def _is_flat_top(u: Samples, x: Samples, run: slice, gain: float, moves: _Moves) -> bool:
    """Whether a run at the maximum of ``x`` is a rail and not a turning point. ``u`` rises where ``x`` rises.

    A turning point of a quantised sensor is flat too. Two things tell them apart, both in steps q of the
    sensor:
    - at a turning point the voltage hardly moves on outwards while the reading stands still (and with play it
      moves only back), so at the average gain it accounts for about q; against a rail it goes on pushing;
    - a parabola that stays within q over n samples has come up by at most 8 q in the n samples before; a
      signal cut off comes up steeply.
    A short run that jumps in and out of the maximum, further than the signal ever moves otherwise, is a
    rail too. Noise lets a moving signal repeat a reading by chance, so q is at least twice its deviation.
    """
    start, stop = run.start, run.stop
    into = x[start] - x[start - 1] if start else 0.0
    out_of = x[stop - 1] - x[stop] if stop < len(x) else 0.0
    others = [size for i, size in moves.largest if i not in (start - 1, stop - 1)]
    if others and min(into, out_of) > 3 * max(others):
        return True
    pushed = gain * float(u[run].max() - u[start])
    came_up = float(x[start] - x[max(0, start - (stop - start))])
    return pushed > 4 * moves.smallest and came_up > 12 * moves.smallest
