"""In which direction a sensor counts."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from phaselead.record.direction import counts_backwards

T_s = np.arange(2000) / 1000


@given(st.floats(-5, 5), st.sampled_from([1.0, -1.0]), st.integers(1, 10))
def test_small_sweeps_on_a_stage_that_creeps_do_not_decide_it(creep_um, sign, sweeps):
    """Over their own voltages they move by far more than the large one, whichever way."""
    large, small = 5 * np.sin(2 * np.pi * 2 * T_s), 0.05 * np.sin(2 * np.pi * 30 * T_s**2)
    pairs = [(large, 10 * sign * large), *[(small, 10 * sign * small + creep_um * np.log1p(T_s))] * sweeps]
    assert counts_backwards(pairs) == (sign < 0)
