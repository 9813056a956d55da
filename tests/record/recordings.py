"""Recordings to try things on."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from phaselead.record import AxisRecord, Recording

finite = st.floats(-1e6, 1e6, allow_subnormal=False)


def sine_recording(n: int = 500, f_Hz: float = 5.0, rate_Hz: float = 1000.0) -> Recording:
    """2.5 cycles of 5 V and about 112 um, noise-free."""
    t = np.arange(n) / rate_Hz
    u = 2.5 * (1 - np.cos(2 * np.pi * f_Hz * t))
    return Recording(t_s=t, axes={"x": AxisRecord(u_V=u, x_um=22.5 * u + 3)})


@st.composite
def recordings(draw: st.DrawFn) -> Recording:
    """Any recording our formats can say: one to three axes, with or without voltage, position and reference."""
    n = draw(st.integers(2, 12))

    def column() -> np.ndarray:
        return np.array(draw(st.lists(finite, min_size=n, max_size=n)))

    axes = {}
    for name in draw(st.sampled_from(["x", "y", "xy", "xyz"])):
        has_u, has_x, has_r = draw(st.tuples(st.booleans(), st.booleans(), st.booleans()))
        axes[name] = AxisRecord(
            u_V=column() if has_u or not has_x else None,
            x_um=column() if has_x else None,
            r_um=column() if has_r else None,
        )
    rate = draw(st.sampled_from([0.5, 200.0, 5000.0, 6400.0]))
    return Recording(t_s=draw(st.sampled_from([0.0, -3.0, 1234.5])) + np.arange(n) / rate, axes=axes)


def assert_same(a: Recording, b: Recording) -> None:
    """Equal times and axes, to the last bit."""
    np.testing.assert_array_equal(a.t_s, b.t_s)
    assert list(a.axes) == list(b.axes)
    for name, axis in a.axes.items():
        for field in ("u_V", "x_um", "r_um"):
            mine, other = getattr(axis, field), getattr(b.axes[name], field)
            assert (mine is None) == (other is None), (name, field)
            if mine is not None:
                np.testing.assert_array_equal(mine, other)


def assert_one_line(refusal: Exception) -> None:
    """What a user gets to see: one line of bearable length."""
    assert str(refusal).isprintable()
    assert 10 < len(str(refusal)) < 600
