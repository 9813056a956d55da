import numpy as np
from core_bindings import any_u32
from hypothesis import given


def sine_q30(core, phases_turn32):
    phases_turn32 = np.ascontiguousarray(phases_turn32, dtype=np.uint32)
    out = np.empty(phases_turn32.size, dtype=np.int32)
    core.h_sine_many(phases_turn32.ctypes.data, out.ctypes.data, out.size)
    return out


def exact_q30(phases_turn32):
    """float64 is good to 2^-22 of an LSB here once the phase is folded to +-1/8 turn by exact integers."""
    return np.sin(phases_turn32.astype(np.float64) * (2 * np.pi / 2**32)) * 2**30


def whole_turn():
    """A grid whose stride shares no factor with the nodes, and every node, mid-node and their neighbours."""
    grid = (np.arange(2_000_000, dtype=np.uint64) * 2147 + 12345) % 2**32
    around = (np.arange(2048, dtype=np.int64)[:, None] * 2**21 + np.arange(-3, 4)).ravel() % 2**32
    return np.concatenate([grid, around.astype(np.uint64)]).astype(np.uint32)


def test_within_stated_bound_over_the_turn(core):
    phases = whole_turn()
    error = sine_q30(core, phases) - exact_q30(phases)
    assert np.abs(error).max() <= 1.01


def test_quarter_points_are_exact(core):
    quarters = np.array([0, 2**30, 2**31, 3 * 2**30], dtype=np.uint32)
    assert sine_q30(core, quarters).tolist() == [0, 2**30, 0, -(2**30)]


def test_never_beyond_one(core):
    assert np.abs(sine_q30(core, whole_turn()).astype(np.int64)).max() == 2**30


@given(any_u32)
def test_symmetries_are_exact(core, phase):
    value = core.sine_q30(phase)
    assert core.sine_q30((phase + 2**31) % 2**32) == -value
    assert core.sine_q30((2**31 - phase) % 2**32) == value
    assert core.sine_q30((-phase) % 2**32) == -value
