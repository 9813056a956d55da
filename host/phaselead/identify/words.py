"""A fitted axis in words: its gain, the width of its loop, where it rings, how late it is, and what is left."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phaselead.errors import BadInput
from phaselead.identify.runs import white_noise_rms
from phaselead.model import AxisModel, TimeView, effect, small_signal, steady_loop, turned_view
from phaselead.quantity import digits
from phaselead.record import Recording, Samples

SMALL_SWING = 0.5
"""Of the span of a fit's voltages: a loop grows with the swing, and where no record swings as far as half of the span
it was not seen at the size that is stated."""
LEVELS = 200
"""Voltages at which the width of a loop is looked up."""


def describe_axis(axis: str, model: AxisModel, records: Sequence[Recording], *, straight: bool = False) -> str:
    """One line on the time view of an axis and what it leaves of its records. ``straight``: whether gain and offset
    alone were fitted."""
    view = model.time
    if view is None:
        return f"axis {axis}: no time view"
    parts = [f"{_gain_um_per_V(model):.3g} um/V"]
    if straight:
        parts.append("a straight line: no hysteresis looked for")
    else:
        width_pct = hysteresis_pct(model)
        loop = f"hysteresis {width_pct:.2g} % of the travel" if width_pct >= 0.05 else "no hysteresis seen"
        parts.append(loop + _in_small_swings(view, axis, records))
    parts += _modes(model)
    parts.append(f"lag {1e3 * (view.delay_s + _filters_s(model)):.2g} ms")
    noise_um = [noise for record in records if (noise := noise_um_rms(record, axis)) is not None]
    least_um = min(noise_um, default=np.inf)
    beside = f", the sensor's noise is about {_short(least_um)}" if least_um < view.residual_um_rms else ""
    return f"axis {axis}: {', '.join(parts)}; the model leaves {_short(view.residual_um_rms)} rms{beside}"


def describe_coupling(matrix: Sequence[Sequence[float]]) -> str:
    """The largest share of one axis' motion that another one sees."""
    shares = np.where(np.eye(3) > 0, 0.0, np.array(matrix))
    if not shares.any():
        return "no cross-talk seen"
    row, column = np.unravel_index(int(np.argmax(np.abs(shares))), (3, 3))
    return f"cross-talk of up to {100 * abs(shares[row, column]):.2g} %: {'xyz'[row]} moves with {'xyz'[column]}"


def _in_small_swings(view: TimeView, axis: str, records: Sequence[Recording]) -> str:
    """That no record shows the whole loop, where the voltages of all together span far more than each."""
    driven = [one for record in records if axis in record.axes and (one := record.axes[axis].u_V) is not None]
    swing_V, span_V = max((float(np.ptp(u_V)) for u_V in driven), default=np.inf), float(np.ptp(view.u_range_V))
    return (
        ""
        if swing_V > SMALL_SWING * span_V
        else f" (no record swings by more than {swing_V:.2g} of the {span_V:.2g} V)"
    )


def _short(value_um: float) -> str:
    """In nm where that is the unit a person would use."""
    return f"{digits(1e3 * value_um, 2)} nm" if value_um < 0.0995 else f"{digits(value_um, 2)} um"


def _gain_um_per_V(model: AxisModel) -> float:
    """Way over voltage of the whole steady loop, with its sign."""
    loop = steady_loop(model)
    assert loop.u_V is not None
    assert loop.x_um is not None
    top, bottom = int(np.argmax(loop.u_V)), int(np.argmin(loop.u_V))
    return float((loop.x_um[top] - loop.x_um[bottom]) / (loop.u_V[top] - loop.u_V[bottom]))


def hysteresis_pct(model: AxisModel) -> float:
    """Largest width of the steady loop over the voltages of the fit, in per cent of its height."""
    loop = steady_loop(model)
    assert loop.u_V is not None
    assert loop.x_um is not None
    top = int(np.argmax(loop.u_V))
    at_V = np.linspace(loop.u_V.min(), loop.u_V.max(), LEVELS)
    up = np.interp(at_V, loop.u_V[: top + 1], loop.x_um[: top + 1])
    down = np.interp(at_V, loop.u_V[top:][::-1], loop.x_um[top:][::-1])
    height = float(np.ptp(loop.x_um))
    return 100 * float(np.abs(down - up).max()) / height if height > 0 else 0.0


def _modes(model: AxisModel) -> list[str]:
    assert model.time is not None
    said, rising = [], model
    if _gain_um_per_V(model) < 0:
        said = ["a sensor that counts backwards (swap its polarity: the signs of a device's loop are fixed)"]
        rising = model.model_copy(update={"time": turned_view(model.time)})
    try:
        modes = small_signal(rising).modes
    except BadInput:
        return said
    heard = " and ".join(f"a mode at {f_Hz:.4g} Hz (damping {zeta:.2g})" for _, f_Hz, zeta in modes)
    return [*said, heard or "no mode seen"]


def _filters_s(model: AxisModel) -> float:
    """How late amplifier and sensor make slow motion, beside the delay."""
    lags_s = [(effect(one.name).lag_in_loop_s, one.params) for one in model.effects]
    return sum(lag_s(params) for lag_s, params in lags_s if lag_s is not None)


def noise_um_rms(record: Recording, axis: str) -> float | None:
    """White noise of the sensor from second differences of (n,) positions, whose variance is six times its own; motion
    that is slow against the sampling rate has none. None without positions, and where the voltage bends as much in its
    own span: all of it may be motion then."""
    found = record.axes.get(axis)
    if found is None or found.x_um is None or len(found.x_um) < 16:
        return None
    bends: Samples = np.diff(found.x_um, 2)
    if found.u_V is not None and np.ptp(found.u_V) > 0:
        moved: Samples = np.diff(found.u_V, 2) * float(np.ptp(found.x_um) / np.ptp(found.u_V))
        if np.mean(moved**2) >= np.mean(bends**2):
            return None
    return white_noise_rms(found.x_um)
