"""An axis as feedback sees it: linear, at the slopes that its time view has."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from phaselead.errors import BadInput
from phaselead.model.axis import AxisModel, TimeView
from phaselead.model.effects import Mode, effect, modes_in, rewritten
from phaselead.model.inverse import BACKWARDS, in_time_view
from phaselead.model.operator import CURVE_PIECES, without_plays_um


@dataclass(frozen=True)
class SmallSignal:
    """x = g G(s) exp(-s delay_s) u, G(0) = 1: modes behind first-order lags, g anywhere in ``gain_um_per_V``."""

    gain_um_per_V: tuple[float, float]
    """Lowest and highest local slope: of a reversal, which moves no play, and of one long way, which moves all."""
    modes: tuple[Mode, ...]
    """(share of the motion, f_Hz, zeta); what the shares leave follows at once."""
    lags_s: tuple[float, ...]
    """Time constants of amplifier and sensor."""
    delay_s: float
    """Dead time, counted as the fit does, from straight lines between the rows of a recording."""

    def with_modes_at(self, factor: float) -> SmallSignal:
        """Every mode at ``factor`` times its frequency."""
        return replace(self, modes=tuple((c, f_Hz * factor, zeta) for c, f_Hz, zeta in self.modes))


def small_signal(axis: AxisModel) -> SmallSignal:
    """Raises BadInput when the axis has no time view, or one that falls: the loop's sign is fixed in the firmware."""
    view = in_time_view(axis).time
    if view is None:
        raise BadInput("it has no time view; fit or identify it")
    low, high = slopes_um_per_V(view)
    if axis.time is not None and not axis.time.is_even:
        own_low, own_high = slopes_um_per_V(axis.time)
        low, high = min(low, own_low), max(high, own_high)
    if high <= 0:
        raise BadInput(BACKWARDS)
    entries = rewritten([(effect(e.name), effect(e.name).complete(e.params)) for e in axis.effects])
    modes = tuple(mode for mode in modes_in(entries) if mode[0] != 0)
    lags = tuple(e.lag_in_loop_s(params) for e, params in entries if e.lag_in_loop_s is not None)
    return SmallSignal((max(low, 0.0), high), modes, tuple(tau_s for tau_s in lags if tau_s > 0), view.delay_s)


def slopes_um_per_V(view: TimeView) -> tuple[float, float]:
    """Lowest slope without plays and highest with all of them, over the voltages that the view was fitted on."""
    low_V, high_V = view.u_range_V
    if not view.is_even:
        knots_V = np.unique(np.clip([*np.linspace(low_V, high_V, CURVE_PIECES + 1), *view.deadzone_d_V], low_V, high_V))
        v = view.field.of(knots_V)
        standing = np.diff(without_plays_um(view, v)) / np.diff(knots_V)
        moving = np.diff(view.density.read(v)) / np.diff(knots_V) * sum(view.play_w_um_per_V)
        return float(standing.min()), float((standing + moving).max())
    bends = list(zip(view.deadzone_d_V, view.deadzone_s_um_per_V, strict=True))
    below = sum(s for d, s in bends if d <= low_V)
    inside = [s for d, s in bends if low_V < d < high_V]
    slopes = [view.gain_um_per_V + s for s in itertools.accumulate(inside, initial=below)]
    return min(slopes), max(slopes) + sum(view.play_w_um_per_V)
