"""Adopted effects that the time view itself can express, moved into it: what a controller inverts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from phaselead.model.axis import AxisModel, TimeView
from phaselead.model.effects import effect, hysteresis
from phaselead.model.effects.interface import Params, Samples, Signal, number
from phaselead.model.operator import range_um, rest_position_um

BENDS = 16
"""Straight pieces that a curvature is drawn with: within 0.4 % of its size."""


def folded(axis: AxisModel) -> AxisModel:
    """The same axis with hysteresis, the bend of asymmetric hysteresis, delay, gain change and offset in its time view.

    ``effects`` keeps the others. Meant for inversion and upload: sizes given as a share of the range belong to the
    range before. Plays share one rest fraction; those of the view keep theirs. Raises BadInput for parameters that
    make no sense.
    """
    if axis.time is None:
        return axis
    view, left = axis.time, []
    for adopted in axis.effects:
        fold = _FOLDS.get(adopted.name)
        params = effect(adopted.name).complete(adopted.params)
        if fold is None or (adopted.name == "asymmetric_hysteresis" and number(params, "skew")):
            left.append(adopted)
        else:
            view = fold(axis, view, params)
    return axis.model_copy(update={"time": view, "effects": tuple(left)})


def _hysteresis(axis: AxisModel, view: TimeView, params: Params) -> TimeView:
    none = np.zeros(1)
    r, w = hysteresis.thresholds_and_weights(Signal(none, none, none, axis), params)
    rest = view.rest_fraction if view.play_r_V else number(params, "rest_fraction")
    plays_r, plays_w = _merged(view.play_r_V, view.play_w_um_per_V, r, w)
    gain = view.gain_um_per_V - float(w.sum())
    update = {"gain_um_per_V": gain, "play_r_V": plays_r, "play_w_um_per_V": plays_w, "rest_fraction": rest}
    return _resting_at(rest_position_um(view), view.model_copy(update=update))


def _bend(axis: AxisModel, view: TimeView, params: Params) -> TimeView:
    """The parabola as straight pieces through its values at their ends."""
    assert axis.time is not None
    low, high = axis.time.u_range_V
    knots = np.linspace(low, high, BENDS + 1)
    share = np.linspace(-1, 1, BENDS + 1)
    slopes = np.diff(number(params, "bend") * range_um(axis) * share**2) / np.diff(knots)
    d, s = _merged(view.deadzone_d_V, view.deadzone_s_um_per_V, knots[1:-1], np.diff(slopes))
    gain = view.gain_um_per_V + float(slopes[0])
    update = {"gain_um_per_V": gain, "deadzone_d_V": d, "deadzone_s_um_per_V": s}
    return _resting_at(rest_position_um(view), view.model_copy(update=update))


def _delay(axis: AxisModel, view: TimeView, params: Params) -> TimeView:
    return view.model_copy(update={"delay_s": view.delay_s + number(params, "delay_s")})


def _gain(axis: AxisModel, view: TimeView, params: Params) -> TimeView:
    factor = 1 + number(params, "gain")
    update = {
        "gain_um_per_V": factor * view.gain_um_per_V,
        "play_w_um_per_V": tuple(factor * w for w in view.play_w_um_per_V),
        "deadzone_s_um_per_V": tuple(factor * s for s in view.deadzone_s_um_per_V),
    }
    return _resting_at(rest_position_um(view), view.model_copy(update=update))


def _offset(axis: AxisModel, view: TimeView, params: Params) -> TimeView:
    return view.model_copy(update={"offset_um": view.offset_um + number(params, "offset_um")})


def _resting_at(rest_um: float, view: TimeView) -> TimeView:
    offset = view.offset_um + rest_um - rest_position_um(view)
    return view.model_copy(update={"offset_um": offset})


def _merged(
    at: tuple[float, ...], values: tuple[float, ...], more_at: Samples, more: Samples
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Thresholds of both, rising, each once; values of equal thresholds add."""
    total: dict[float, float] = {}
    for threshold, value in [*zip(at, values, strict=True), *zip(more_at.tolist(), more.tolist(), strict=True)]:
        total[threshold] = total.get(threshold, 0.0) + value
    thresholds = tuple(sorted(total))
    return thresholds, tuple(total[t] for t in thresholds)


_FOLDS: dict[str, Callable[[AxisModel, TimeView, Params], TimeView]] = {
    "hysteresis": _hysteresis,
    "asymmetric_hysteresis": _bend,
    "delay": _delay,
    "gain_change": _gain,
    "offset": _offset,
}
