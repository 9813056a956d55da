"""Runs: the driven axes of recordings, checked for what every estimate needs, and the sines that drive them.

A recording in which nothing can be used raises BadInput, in one line that says how to mend it. A set leaves it out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from phaselead.errors import BadInput
from phaselead.model import plays
from phaselead.record import (
    Began,
    Recording,
    Samples,
    began,
    counts_backwards,
    refuse_clipped,
    refuse_gapped,
)

STILL_S = 1.0
"""A voltage that stands still for longer shows creep: of a hysteresis no more than where it began."""
STILL_V = 1e-6
"""A voltage that spans less than this does not move (a 16-bit code of 20 V is 0.3 mV)."""
DRIVEN_SHARE = 0.02
"""An axis counts as driven when its voltage spans more than this share of the recording's largest span."""
SINE_RESIDUAL = 0.01
"""Rms departure from a sine, as a share of its amplitude, up to which a voltage is called one."""

SAME_RATE = 0.01
"""Largest relative difference between sampling rates that count as one."""

ROWS_PER_PERIOD = 32
"""A sine is estimated from about this many rows per period; more add time and no precision."""
FEWEST_PERIODS = 2
"""Periods of a sine that are needed before anything is fitted to it: the first settles the memory."""
SAME = 0.02
"""Levels or frequencies closer than this, relatively, are one."""
TURN_SHARE = 0.02
"""Of the span of a voltage: a smaller turn is noise or a hesitation."""
START_SHARE = 0.01
"""Of its span: a voltage that begins closer to 0 V begins there."""
FEWEST_ROWS = 16
"""That are judged."""
JUMP_SHARE = 0.05
"""A change of voltage between two rows beyond this share of its span, and far beyond the usual, is a jump."""
SLOW_END = 0.1
"""Of the first steep change of a jump: where the voltage moves more slowly, the jump has not begun or is over. A
sine-shaped one has gone 0.3 % of its way there."""
ROWS_BEFORE = 5
"""Whose median is where the stage was before a jump."""
FOLLOWED = 0.5
"""Of the motion, rms: a path that the position leaves by less was followed."""


class SineDrive(NamedTuple):
    """A sine voltage, ``mean_V + swing_V / 2 cos(2 pi f_Hz t + phase)``, on ``rows`` of the whole recording."""

    f_Hz: float
    swing_V: float
    mean_V: float
    rows: slice

    @property
    def starts_at_zero(self) -> bool:
        """Whether it runs between 0 V and its swing, as the grid of Xu & Li 2010 does (eq. 4)."""
        return abs(self.mean_V - self.swing_V / 2) < 0.02 * self.swing_V


@dataclass(frozen=True)
class AxisRun:
    """One driven axis of one recording, checked.

    ``t_s``, ``u_V`` and ``x_um`` are (n,); ``scored`` are the rows that count, those before them warm the memory.
    """

    t_s: Samples
    u_V: Samples
    x_um: Samples
    scored: slice
    axis: str
    source: str
    r_um: Samples | None = None
    """The path (n,) that it followed; None where none was asked for, or what is written down as one was not."""
    began: Began | None = None
    """When its ``t_s`` = 0 was, where the recording says it."""

    @property
    def step_s(self) -> float:
        """Time between two rows."""
        return float(self.t_s[-1] - self.t_s[0]) / (len(self.t_s) - 1)

    @cached_property
    def sine(self) -> SineDrive | None:
        """The sine that the scored voltage is, or None."""
        return sine_of(self)

    @cached_property
    def turning_rows(self) -> NDArray[np.uintp]:
        """The rows, ascending, after which the voltage, 0 V before the record, goes the other way."""
        return turning_rows(self.u_V)

    @property
    def begins_at_0_V(self) -> bool:
        """Whether the voltage begins there."""
        return abs(float(self.u_V[0])) < START_SHARE * float(np.ptp(self.u_V))

    @property
    def first_V(self) -> float:
        """Where the voltage begins: 0 V where it begins there, but for noise."""
        return 0.0 if self.begins_at_0_V else float(self.u_V[0])

    @property
    def range_um(self) -> float:
        """Measured peak-to-peak over the scored rows."""
        return float(np.ptp(self.x_um[self.scored]))


def turning_rows(u_V: Samples) -> NDArray[np.uintp]:
    """The rows, ascending, after which a voltage (n,), 0 V before its first row, goes the other way."""
    steps = np.diff(u_V, prepend=0.0)
    moving = np.flatnonzero(steps)
    rises = steps[moving] > 0
    return np.asarray(moving[1:][rises[1:] != rises[:-1]] - 1, dtype=np.uintp)


def driven_axes(recording: Recording) -> list[str]:
    """The axes whose voltage moves, in order. Raises BadInput when there is none."""
    spans = {name: float(np.ptp(a.u_V)) for name, a in recording.axes.items() if a.u_V is not None and len(a.u_V)}
    if not spans:
        raise BadInput(f"{recording.source}: has no voltage; record u_V beside x_um")
    largest = max(spans.values())
    if largest < STILL_V:
        raise BadInput(f"{recording.source}: the voltage never moves; give a record of the stage while it is driven")
    return [name for name, span in spans.items() if span > DRIVEN_SHARE * largest]


def axis_run(recording: Recording, axis: str) -> AxisRun:
    """The checked arrays of one axis. Raises BadInput."""
    source = recording.source
    refuse_gapped(recording)
    refuse_clipped(recording)
    record = recording.axes.get(axis)
    if record is None or record.u_V is None or record.x_um is None:
        lacks = "position" if record is not None and record.x_um is None else "voltage"
        raise BadInput(f"{source}: has no {lacks} of axis {axis}; record voltage and position, or map the column")
    u, x = record.u_V, record.x_um
    if not (np.isfinite(u).all() and np.isfinite(x).all()):
        raise BadInput(f"{source}: holds values that are not numbers; cut those rows or record again")
    scored = recording.scored
    if len(u[scored]) < FEWEST_ROWS:
        raise BadInput(f"{source}: {len(u[scored])} rows are too few to judge; at least {FEWEST_ROWS} are needed")
    if np.ptp(u[scored]) < STILL_V:
        raise BadInput(f"{source}: the voltage of {axis} is constant where it is scored; choose rows where it moves")
    if np.ptp(x[scored]) == 0:
        raise BadInput(f"{source}: the position of {axis} never changes; is the sensor connected and mapped?")
    r_um = record.r_um if record.r_um is not None and _followed(record.r_um[scored], x[scored]) else None
    return AxisRun(recording.t_s, u, x, scored, axis, source, r_um, began(recording.meta))


def white_noise_rms(values: Samples) -> float:
    """Of (n,) samples, from second differences, whose variance is six times that of white noise: what moves fast counts
    as noise. 0 of fewer than three."""
    return float(np.sqrt(np.mean(np.diff(values, 2) ** 2) / 6)) if len(values) > 2 else 0.0


def _followed(r_um: Samples, x_um: Samples) -> bool:
    """Whether a position (n,) goes with what may be its path: a set point in another unit, or of an output that nobody
    closed a loop around, says nothing of what the stage was asked to do."""
    off_um, moved_um = np.std(x_um - r_um), np.std(x_um)
    return bool(off_um < FOLLOWED * moved_um)  # not where a value is missing


def driven_runs(recording: Recording) -> tuple[dict[str, AxisRun], list[str]]:
    """The runs of the driven axes that can be used, and a line for each axis, or for the recording, that cannot."""
    runs, left_out = {}, []
    try:
        for axis in driven_axes(recording):
            try:
                runs[axis] = axis_run(recording, axis)
            except BadInput as error:
                left_out.append(str(error))
    except BadInput as error:
        left_out.append(str(error))
    return runs, list(dict.fromkeys(left_out))


def usable(recordings: Sequence[Recording]) -> tuple[list[Recording], list[str]]:
    """The recordings of which something can be used, and a line for all that cannot.

    Raises BadInput, the first of these lines, when nothing can.
    """
    kept, left_out = [], []
    for recording in recordings:
        runs, lines = driven_runs(recording)
        left_out += lines
        if runs:
            kept.append(recording)
    if not kept and left_out:
        raise BadInput(left_out[0])
    return kept, left_out


def refuse_without_loop(runs: Sequence[AxisRun]) -> None:
    """Raise BadInput when no voltage goes round often enough to show a loop, warm-up rows included.

    One record that does is enough: the others are used for what they show.
    """
    too_short = [message for run in runs if (message := _too_short(run)) is not None]
    if len(too_short) == len(runs):
        raise BadInput(too_short[0])


def _too_short(run: AxisRun) -> str | None:
    sine = run.sine
    if sine is not None:
        first = int(np.flatnonzero(np.diff(run.u_V))[0])
        periods = (sine.rows.stop - first) * run.step_s * sine.f_Hz
        if periods < FEWEST_PERIODS - 0.05:
            return (
                f"{run.source}: {periods:.2g} periods of {sine.f_Hz:.4g} Hz are too few; "
                f"record at least {FEWEST_PERIODS}, one of them to settle"
            )
    elif turning_points(run.u_V) < 2:
        return (
            f"{run.source}: the voltage of {run.axis} turns round less than twice, too little to show a loop; "
            f"record at least {FEWEST_PERIODS} periods"
        )
    return None


def turning_points(u: Samples) -> int:
    """How often ``u`` (n,) turns round by more than ``TURN_SHARE`` of its span."""
    slack = TURN_SHARE * float(np.ptp(u))
    # The output of a play of this slack turns only where u turns by more.
    moved, _ = plays(u, [slack / 2], [u[0]])
    steps = np.diff(moved[:, 0])
    directions = np.sign(steps[steps != 0])
    return int(np.count_nonzero(np.diff(directions)))


def sensor_counts_backwards(runs: Sequence[AxisRun]) -> bool:
    """Whether the position falls where the voltage rises, slowly."""
    return counts_backwards((run.u_V[run.scored], run.x_um[run.scored]) for run in runs)


def still_share(run: AxisRun) -> float:
    """The share of the scored rows in which the voltage has stood still for longer than a second."""
    rows = np.arange(len(run.u_V))
    changed = np.diff(run.u_V, prepend=run.u_V[0]) != 0
    since = rows - np.maximum.accumulate(np.where(changed, rows, 0))
    return float(np.mean(since[run.scored] * run.step_s > STILL_S))


def turned(run: AxisRun) -> AxisRun:
    """The same record from a sensor that counts the other way."""
    return replace(run, x_um=-run.x_um)


def moving_rows(run: AxisRun) -> slice:
    """The scored rows without the still ones at either end."""
    start, stop, _ = run.scored.indices(len(run.u_V))
    moves = np.flatnonzero(np.abs(np.diff(run.u_V[start:stop])) > 0)
    return slice(start + int(moves[0]), start + int(moves[-1]) + 2)


def sine_of(run: AxisRun, f_Hz: float | None = None) -> SineDrive | None:
    """The sine that the scored voltage is, or None when it is something else. ``f_Hz``: known beforehand."""
    rows = moving_rows(run)
    u = run.u_V[rows]
    if len(u) < FEWEST_ROWS:
        return None
    rough_Hz = _strongest_line(u, run.step_s) if f_Hz is None else f_Hz
    stride = max(1, int(1.0 / (rough_Hz * run.step_s * ROWS_PER_PERIOD)))
    t, u = run.t_s[rows][::stride] - run.t_s[rows.start], u[::stride]
    f_Hz = _refined(t, u, rough_Hz) if f_Hz is None else f_Hz
    if not f_Hz > 0 or f_Hz * (t[-1] - t[0]) < 0.9:
        return None
    (mean, cosine, sine), squares = _sine_fit(t, u, f_Hz)
    amplitude = float(np.hypot(cosine, sine))
    if not amplitude > 0 or np.sqrt(squares / len(u)) > SINE_RESIDUAL * amplitude:
        return None
    return SineDrive(f_Hz, 2 * amplitude, float(mean), rows)


def _strongest_line(u: Samples, step_s: float) -> float:
    """Frequency in Hz of the strongest line in the spectrum of ``u``, to about one over its length in seconds."""
    spectrum = np.abs(np.fft.rfft((u - u.mean()) * np.hanning(len(u))))
    return max(int(np.argmax(spectrum)), 1) / (len(u) * step_s)


def _refined(t: Samples, u: Samples, rough_Hz: float) -> float:
    """The frequency near ``rough_Hz`` of the sine that fits ``u`` best, to six digits."""
    wide = 1.5 / float(t[-1] - t[0])
    found = minimize_scalar(
        lambda f: _sine_fit(t, u, f)[1],
        bounds=(max(rough_Hz - wide, 0.2 * wide), rough_Hz + wide),
        method="bounded",
        options={"xatol": 1e-7 * rough_Hz},
    )
    return float(f"{found.x:.6g}")


def _sine_fit(t: Samples, u: Samples, f_Hz: float) -> tuple[Samples, float]:
    """Mean, cosine and sine amplitude of the best sine of ``f_Hz``, and the sum of squares of what it leaves."""
    turn = 2 * np.pi * f_Hz * t
    basis = np.stack([np.ones_like(t), np.cos(turn), np.sin(turn)])
    coefficients = np.linalg.solve(basis @ basis.T + 1e-12 * len(t) * np.eye(3), basis @ u)
    return coefficients, float(np.sum((u - coefficients @ basis) ** 2))


def one_frequency(runs: Sequence[AxisRun]) -> bool:
    """Whether all of them are sines of about one frequency: these tell neither a delay nor creep from a loop."""
    sines = [run.sine for run in runs]
    found = [sine.f_Hz for sine in sines if sine is not None]
    return len(found) == len(runs) and max(found) < 1.5 * min(found)


def distinct(values: Sequence[float]) -> list[float]:
    """Levels or frequencies that differ by more than ``SAME``, ascending, each the mean of those that it stands for."""
    groups: list[list[float]] = []
    for value in sorted(values):
        if groups and value <= groups[-1][0] * (1 + SAME):
            groups[-1].append(value)
        else:
            groups.append([value])
    return [float(np.mean(group)) for group in groups]


def period_s(run: AxisRun) -> float:
    """Period of the sine that is as large and as fast as the scored voltage; infinite where it only jumps."""
    u = run.u_V[run.scored]
    rate = np.abs(np.diff(u)) / run.step_s
    rate = np.minimum(rate, np.quantile(rate, 0.99))
    speed = float(np.sqrt(np.mean(rate**2)))
    return float(2 * np.pi * u.std()) / speed if speed > 0 else np.inf


def repeats_s(run: AxisRun) -> float:
    """The shortest time between two jumps to the same side inside the record; infinite without such a pair."""
    found = [(first, run.u_V[last] > run.u_V[first - 1]) for first, last in _whole_jumps(run)]
    to_a_side = [[first for first, up in found if up == side] for side in (True, False)]
    return min((later - first for rows in to_a_side for first, later in pairwise(rows)), default=np.inf) * run.step_s


def jumps(run: AxisRun) -> NDArray[np.intp]:
    """Rows at which the voltage jumps; row 0 is one when the record does not begin at 0 V."""
    steps = np.abs(np.diff(run.u_V, prepend=0.0))
    return np.flatnonzero(steps > max(JUMP_SHARE * float(np.ptp(run.u_V[run.scored])), 5 * _usual_step_V(run)))


def _usual_step_V(run: AxisRun) -> float:
    """By how much the voltage changes between two rows where it does not jump, at most."""
    return float(np.quantile(np.abs(np.diff(run.u_V, prepend=0.0))[run.scored], 0.99))


def longest_delay_s(run: AxisRun) -> float:
    """The longest delay that the jumps inside the record allow: until the position has gone half of the way, beyond
    what the slow motion before may have made it go. Infinite where it has none.

    Nothing of a jump is seen before the delay has passed since its first row, however many rows it takes.
    """
    slope, usual_V = run.range_um / np.ptp(run.u_V[run.scored]), _usual_step_V(run)
    bound, rows, seen = np.inf, 0, 0
    for first, last in _whole_jumps(run):
        if first <= seen:  # what moves now may still be the answer to the jump before
            seen = last + rows
            continue
        way_V = abs(run.u_V[last] - run.u_V[first - 1])
        before = slice(max(0, first - ROWS_BEFORE), first)
        moved = np.abs(run.x_um[first:] - np.median(run.x_um[before]))
        slow_V = usual_V * (np.arange(len(moved)) + ROWS_BEFORE)
        gone = moved > slope * (way_V / 2 + slow_V)
        if gone.any():
            rows = int(np.argmax(gone))
            seen = last + rows
            bound = min(bound, (rows + 0.5) * run.step_s)
    return bound


def _whole_jumps(run: AxisRun) -> list[tuple[int, int]]:
    """First and last row of every jump inside the record: a drive that rounds its steps takes several rows for one."""
    steps = np.diff(run.u_V, prepend=run.u_V[0])
    found: list[tuple[int, int]] = []
    for row in jumps(run).tolist():
        if row == 0 or (found and row <= found[-1][1]):
            continue
        still = np.flatnonzero(steps * np.sign(steps[row]) <= SLOW_END * abs(steps[row]))
        after = np.searchsorted(still, row)
        first = int(still[after - 1]) + 1
        last = int(still[after]) - 1 if after < len(still) else len(steps) - 1
        found.append((first, last))
    return found
