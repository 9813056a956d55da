"""Which simple changes describe the error of a model on a record: a shift of zero, a gain, a delay, or several."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.signal import correlate, correlation_lags

from phaselead.identify.runs import AxisRun, period_s, repeats_s
from phaselead.model import TimeView
from phaselead.quantity import digits
from phaselead.record import Samples

What = Literal["shift", "gain", "delay"]
Size = tuple[What, bool, int]
UNITS: dict[What, str] = {"shift": "um", "gain": "1", "delay": "s"}

MOST_LEFT = 0.5
"""Of the rms of an error, with what describes it. Chosen: three quarters of its power are described."""
ALIKE = 2.0
"""Times the rms that all changes together leave: fewer describe it as well. Chosen: a quarter of the power more."""
WORSE_THAN_FIT, LEAST_SHARE = 2.0, 1e-3
"""Times the rms that the fit left of its own records, and of the range of the record: a smaller error asks for no
reason. Chosen."""
FAR_WORSE = 10.0
"""Times the rms that the fit left: more than that is no matter of another record. Chosen."""
LATEST = 0.25
"""Of a period, of the time between jumps to one side, or of the scored rows where nothing repeats: a sine that comes
later looks like one that is earlier."""
KNOWN = 0.5
"""Of the scored rows: of a prediction that is known in fewer, once it comes later or earlier, nothing is said."""
JUMP_SHARE = 0.25
"""Of the range: what a prediction moves by more within a row is a jump. Chosen."""
DELAYS, SMALL, ROWS = 33, 1e-3, 4000
"""Of the search for a delay: how many are tried before the best is looked for between the next to it, to how many
sampling steps, and by how many rows at least."""


@dataclass(frozen=True)
class Change:
    """What the position does otherwise than the model says."""

    what: What
    value: float
    """In ``unit``: higher, further and later than the model says."""
    unit: str

    @property
    def said(self) -> str:
        """What the axis does ... than the model says."""
        size, more = abs(self.value), self.value > 0
        if self.what == "shift":
            return f"stands {digits(size, 3)} um {'higher' if more else 'lower'}"
        if self.what == "gain":
            return f"moves {digits(100 * size, 3)} % {'further' if more else 'less far'}"
        return f"comes {digits(1e3 * size, 3)} ms {'later' if more else 'earlier'}"


@dataclass(frozen=True)
class Way:
    """Changes that together describe an error, and what they leave of it."""

    changes: tuple[Change, ...]
    left_um_rms: float


@dataclass(frozen=True)
class Described:
    """An error that is larger than a model should leave, and the ways that describe it; none where no simple change
    does."""

    error_um_rms: float
    fitted_um_rms: float
    """What the fit left of its own records; 0 where that is not known, and then there are ways."""
    ways: tuple[Way, ...]
    """With as few changes as will do; what leaves least first."""
    begins_at_0_V: bool
    """Whether the record does: of one that does not nobody knows where the stage came from."""
    latest_s: float
    """The longest delay that was looked for."""
    looked_for: tuple[What, ...]
    """The changes that were tried."""

    @property
    def about(self) -> tuple[Size, ...]:
        """What changed by the first of the ways, to which side, and by about how much, in powers of two."""
        changes = [change for way in self.ways[:1] for change in way.changes if change.value]
        return tuple((one.what, one.value > 0, round(math.log2(abs(one.value)))) for one in changes)

    def said(self) -> str:
        """In one sentence."""
        error = f"{digits(self.error_um_rms, 3)} um rms of error"
        if not self.ways:
            times = self.error_um_rms / self.fitted_um_rms
            *others, last = self.looked_for
            tried = f"{', '.join(others)} or {last}" if others else last
            changes = f"no {tried} of up to {digits(1e3 * self.latest_s, 2)} ms describes it"
            more = changes + ("" if self.begins_at_0_V else ", what it had done before it began may")
            return f"leaves {error}, {digits(times, 2)} times what the fit left: {more}"
        ways = " or ".join(" and ".join(change.said for change in way.changes) for way in self.ways)
        left = " or ".join(digits(way.left_um_rms, 3) for way in self.ways)
        more = ""
        if self.ways[0].left_um_rms > FAR_WORSE * self.fitted_um_rms > 0:
            more = f"; the fit left {digits(self.fitted_um_rms, 2)}, so something else changed as well"
        return f"{ways} than the model says: of {error} that leaves {left}{more}"


def more_than_usual(error_um_rms: float, run: AxisRun, view: TimeView) -> bool:
    """Whether an error of a run is larger than its model may well leave."""
    return error_um_rms > max(WORSE_THAN_FIT * view.residual_um_rms, LEAST_SHARE * run.range_um)


def described(
    run: AxisRun,
    view: TimeView,
    predicted_um: Samples,
    at_rest_um: Callable[[], Samples],
    *,
    refit_offset: bool = False,
    follows: bool = True,
) -> Described | None:
    """What describes the error of a prediction (n,) of all rows of ``run``, over the scored ones; None where a model
    may well leave it. ``at_rest_um``: the prediction (n,) at 0 V. ``refit_offset``: the error is judged without its
    mean. ``follows``: whether the position goes with the prediction row by row, without which no gain is looked for."""
    found = _Changes(run, predicted_um, at_rest_um, refit_offset)
    error, fitted = _rms(found.error_um), view.residual_um_rms
    if not more_than_usual(error, run, view):
        return None
    allowed: dict[What, bool] = {"shift": not refit_offset, "gain": follows, "delay": True}
    kinds = tuple(what for what, is_allowed in allowed.items() if is_allowed)
    sets = [which for count in range(1, len(kinds) + 1) for which in combinations(kinds, count)]
    ways = [found.by(which) for which in sets]
    enough = [way for way in ways if way.left_um_rms <= min(ALIKE * ways[-1].left_um_rms, MOST_LEFT * error)]
    fewest = min((len(way.changes) for way in enough), default=0)
    as_few = sorted((way for way in enough if len(way.changes) == fewest), key=lambda way: way.left_um_rms)
    if not as_few and not error > FAR_WORSE * fitted > 0:
        return None
    alike = tuple(way for way in as_few if way.left_um_rms <= ALIKE * as_few[0].left_um_rms)
    return Described(error, fitted, alike, run.begins_at_0_V, found.latest_s, kinds)


class _Changes:
    """The error of a prediction, and what is left of it with some changes."""

    def __init__(
        self, run: AxisRun, predicted_um: Samples, at_rest_um: Callable[[], Samples], refit_offset: bool
    ) -> None:
        self._t_s, self._measured_um, self._step_s = run.t_s, run.x_um, run.step_s
        self._begins_at_0_V = run.begins_at_0_V
        self._predicted_um, self._at_rest_um, self._refit_offset = predicted_um, at_rest_um, refit_offset
        self._scored = np.arange(len(run.t_s))[run.scored]
        scored_s = run.t_s[self._scored]
        self.latest_s = LATEST * min(period_s(run), repeats_s(run), float(scored_s[-1] - scored_s[0]))
        self.error_um = self._judged(run.x_um - predicted_um, self._scored)

    def by(self, which: tuple[What, ...]) -> Way:
        """The likeliest of these changes together."""
        late_s = self._late_s(which) if "delay" in which else 0.0
        sizes, left_um_rms = self._beside(which, late_s, self._scored)
        values: dict[What, float] = {**dict.fromkeys(which, 0.0), **sizes, "delay": late_s}
        return Way(tuple(Change(what, values[what], UNITS[what]) for what in which), left_um_rms)

    def _beside(
        self, which: tuple[What, ...], late_s: float, rows: NDArray[np.intp]
    ) -> tuple[dict[What, float], float]:
        """The likeliest sizes of these changes beside a delay, and the rms that they leave of the rows in which the
        prediction is known then: infinite where that is less than ``KNOWN`` of them."""
        known = rows[self._is_known(late_s, rows)]
        if len(known) < KNOWN * len(rows):
            return {}, math.inf
        columns, left_um = self._at(which, late_s, known)
        sizes = self._sizes([what for what in which if what != "delay"], columns, left_um)
        return sizes, _rms(left_um - sum((size * columns[what] for what, size in sizes.items()), np.zeros(1)))

    def _is_known(self, late_s: float, rows: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Whether the prediction is known there if it comes so late, and does not jump within a row: of a jump
        nobody knows when within that it was. Before a record from 0 V the stage rests."""
        at_s = self._t_s[rows] - late_s
        known = (at_s <= self._t_s[-1]) & (self._begins_at_0_V | (at_s >= self._t_s[0]))
        if late_s == 0:
            return np.asarray(known)
        before = np.clip(np.searchsorted(self._t_s, at_s, side="right") - 1, 0, len(self._t_s) - 2)
        steps_um = np.abs(np.diff(self._predicted_um))[before]
        within_jump = (at_s > self._t_s[before]) & (steps_um > JUMP_SHARE * np.ptp(self._predicted_um))
        return np.asarray(known & ~within_jump)

    def _late_s(self, which: tuple[What, ...]) -> float:
        """The delay beside which these changes leave least."""
        rows = self._scored[:: max(1, len(self._scored) // ROWS)]

        def left(late_s: float) -> float:
            return self._beside(which, late_s, rows)[1]

        grid_s = np.linspace(-self.latest_s, self.latest_s, DELAYS)
        best = int(np.argmin([left(late_s) for late_s in grid_s]))
        tried_s = [0.0, float(grid_s[best]), self._aligned_s]
        for near_s, apart_s in ((tried_s[1], grid_s[1] - grid_s[0]), (tried_s[2], self._step_s)):
            bounds = max(near_s - apart_s, -self.latest_s), min(near_s + apart_s, self.latest_s)
            options = {"xatol": SMALL * self._step_s}
            tried_s.append(float(minimize_scalar(left, bounds=bounds, method="bounded", options=options).x))
        return min(tried_s, key=left)

    @cached_property
    def _aligned_s(self) -> float:
        """The delay, to a row, beside which the prediction goes up and down where the position does: of what jumps or
        rings that is sharper than the delays that are tried stand apart."""
        measured, predicted = (np.diff(x_um[self._scored]) for x_um in (self._measured_um, self._predicted_um))
        rows = correlation_lags(len(measured), len(predicted))
        allowed = np.abs(rows) * self._step_s <= self.latest_s
        alike = correlate(measured, predicted, method="fft")
        return float(rows[allowed][np.argmax(alike[allowed])] * self._step_s)

    def _at(
        self, which: tuple[What, ...], late_s: float, rows: NDArray[np.intp]
    ) -> tuple[dict[What, Samples], Samples]:
        """What each change of size 1 adds to the rows of a prediction that comes so late, and the error of that."""
        at_s = self._t_s[rows] - late_s
        model_um = np.interp(at_s, self._t_s, self._predicted_um)
        columns: dict[What, Samples] = {}
        for what in which:
            if what == "shift":
                columns[what] = np.ones(len(rows))
            elif what == "gain":
                columns[what] = self._judged(model_um - np.interp(at_s, self._t_s, self._rest_um))
        return columns, self._judged(self._measured_um[rows] - model_um)

    @cached_property
    def _rest_um(self) -> Samples:
        return self._at_rest_um()

    @staticmethod
    def _sizes(which: Sequence[What], columns: dict[What, Samples], left_um: Samples) -> dict[What, float]:
        """Of these changes, the likeliest together."""
        if not which:
            return {}
        a = np.column_stack([columns[what] for what in which])
        found = np.linalg.lstsq(a, left_um, rcond=None)[0]
        return {what: float(size) for what, size in zip(which, found, strict=True)}

    def _judged(self, error_um: Samples, rows: NDArray[np.intp] | None = None) -> Samples:
        chosen = error_um if rows is None else error_um[rows]
        return chosen - chosen.mean() if self._refit_offset else chosen


def _rms(values: Samples) -> float:
    return float(np.sqrt(np.mean(values**2)))
