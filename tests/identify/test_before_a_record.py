"""Laws of what a fit makes of the time before a record: how late the stage may be, and where it came from."""

from __future__ import annotations

import numpy as np
import pytest
from bench_stage import Array, record
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from phaselead.identify.modal import fit_together, shares_left_by
from phaselead.identify.runs import AxisRun, axis_run, jumps, longest_delay_s
from phaselead.model import respond
from phaselead.model.axis import TimeView
from phaselead.model.operator import delayed
from trials import in_trials

RATE_HZ = 1000.0


def rounded(levels_V: list[float], rows_each: int, rows_of_a_step: int) -> Array:
    """Stairs whose steps take so many rows, as a drive that is gentle to the stage makes them."""
    u = np.repeat(levels_V, rows_each).astype(float)
    window = np.hanning(rows_of_a_step + 2)[1:-1]
    return np.convolve(np.pad(u, len(window), mode="edge"), window / window.sum(), "same")[len(window) : -len(window)]


def late(u_V: Array, rows: float) -> AxisRun:
    """Of a stage that goes 2 um/V, late by so many rows."""
    return AxisRun(np.arange(len(u_V)) / RATE_HZ, u_V, 2.0 * delayed(u_V, rows), slice(None), "x", "made.csv")


@given(
    st.lists(st.sampled_from([0.0, 1.0, 2.5, 4.0, 7.0, 10.0]), min_size=3, max_size=8),
    st.integers(10, 200),
    st.integers(1, 40),
    st.floats(0.0, 30.0),
    st.floats(0.0, 0.02),
)
@settings(deadline=None, max_examples=200)
def test_no_step_however_rounded_bounds_the_delay_below_what_it_is(
    levels_V, rows_each, rows_of_a_step, delay_rows, ramp_V
):
    """Of a stage that is late and nothing else: the rows of a rounded step that come first had already moved when the
    steepest of them were taken for jumps of their own, and so had what answered the step before."""
    u = rounded([0.0, *levels_V], rows_each, rows_of_a_step)
    u += ramp_V * np.arange(len(u)) / 200
    assume(np.ptp(u) > 0.5)
    run = late(u, delay_rows)
    assert longest_delay_s(run) >= (delay_rows - 1e-6) / RATE_HZ


def test_a_rounded_step_bounds_the_delay_by_little_more_than_it_takes():
    u = rounded([0.0, 5.0, 0.0, 10.0, 3.0, 3.0], 2000, 8)
    run = late(u, 3.0)
    assert len(jumps(run)) > 6
    assert longest_delay_s(run) < 12 / RATE_HZ


R_V = np.linspace(0.2, 40, 30)
STAGE = TimeView(
    gain_um_per_V=0.5,
    play_r_V=tuple(R_V),
    play_w_um_per_V=tuple(0.03 * np.exp(-R_V / 15)),
    deadzone_d_V=(),
    deadzone_s_um_per_V=(),
    offset_um=0.0,
    delay_s=0.0,
    rest_fraction=0.0,
    u_range_V=(0.0, 100.0),
    rate_Hz=RATE_HZ,
)


def after(before_V: tuple[float, ...], u_V: Array, rng: np.random.Generator) -> Array:
    """Position of the stage that went from rest through these voltages to the first of ``u_V``, in um."""
    _, plays_V = respond(STAGE, np.array([*before_V, u_V[0]]), np.zeros(len(R_V)))
    return respond(STAGE, u_V, plays_V)[0] + 0.002 * rng.standard_normal(len(u_V))


def shares_left_of_a_session(seed: int, rounding_um: float = 0.0) -> list[float]:
    """Of a scan after a loop and stairs that never go to both ends of it, after loops and turns that no record shows.

    ``rounding_um``: what another machine's arithmetic would make of the positions.
    """
    rng, other = np.random.default_rng(seed), np.random.default_rng(1)
    turn_V = float(rng.uniform(20, 80))
    waves = [50 + 50 * np.sin(2 * np.pi * np.arange(3000) / 1000)]
    waves += [rounded(list(np.clip(55 + np.cumsum(rng.uniform(-12, 12, 12)), 20, 90)), 250, 58) for _ in range(2)]
    ways = [(100.0, 0.0), (0.0, 100.0, turn_V), (100.0,)]
    seen_um = [after(way, u, rng) + rounding_um * other.standard_normal(len(u))
               for u, way in zip(waves, ways, strict=True)]  # fmt: skip
    runs = [axis_run(record(np.arange(len(u)) / RATE_HZ, u, x_um), "x") for u, x_um in zip(waves, seen_um, strict=True)]
    operator, modes = fit_together(runs)
    assert modes is None
    return shares_left_by(operator, None, runs)


@pytest.mark.parametrize("seed", [0, 1, 4, 5, *in_trials(2, 3)])
def test_each_record_is_described_whatever_the_stage_did_before_it(seed):
    """Described from one turn before each, 0.2 to 5.7 % of a range were left."""
    assert max(shares_left_of_a_session(seed)) < 0.0015


@pytest.mark.parametrize("seed", [3, *in_trials(8, 11)])
def test_rounding_does_not_tell_from_how_far_a_stage_came(seed):
    """How high it was before is an offset alone for settled rows: any height describes those of one record alike, and a
    wrong one left twenty times as much of all once the records had one offset."""
    assert max(shares_left_of_a_session(seed, rounding_um=1e-13)) < 0.0006


@pytest.mark.parametrize("levels_V", [(100.0, 80.0, 60.0), (100.0, 80.0, 60.0, 40.0, 20.0, 10.0), (20.0, 60.0, 100.0)])
def test_levels_may_fall_or_rise(levels_V):
    """Loops from 0 V, each after the one before. Where they fall, all but the first come after the highest: told one by
    one, a record alone cannot know from how high, and all were left at rest, 1 % of their range."""
    rng = np.random.default_rng(1)
    waves = [level_V / 2 * (1 - np.cos(2 * np.pi * np.arange(3000) / 1000)) for level_V in levels_V]
    runs = [axis_run(record(np.arange(3000) / RATE_HZ, u, after(levels_V[:i], u, rng)), "x")
            for i, u in enumerate(waves)]  # fmt: skip
    operator, _ = fit_together(runs)
    assert max(shares_left_by(operator, None, runs)) < 0.003
