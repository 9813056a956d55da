"""Laws of records in blocks, and of what the base alone is expected to leave, on records of known power."""

from __future__ import annotations

from types import SimpleNamespace as Made

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.fft import idct, next_fast_len

from phaselead.gap.posterior.blocks import FALLS_BY, BlockedRun, CARRIED_OVER_s, blocked
from phaselead.gap.posterior.noise_and_base_share import (
    BASE_SHARE,
    LEAST_UM2,
    UNTOLD,
    NoiseAndBaseShare,
    noise_and_base_share_of,
)
from phaselead.model.axis import AdoptedEffect, AxisModel, TimeView

STEP_S = 1e-3
LINE = AxisModel(time=TimeView(gain_um_per_V=10.0, u_range_V=(0.0, 10.0), rate_Hz=1 / STEP_S))
ROWS = st.integers(16, 700)
SEEDS = st.integers(0, 2**32 - 1)


def record(x_um, motion_um=None, role="train", plays=None, idle=False, start=0, axis=LINE):
    """A run whose model moves by ``motion_um`` (n,) and whose plays started ``plays`` (n, k) off, in um."""
    n = len(x_um)
    motion = np.zeros(n) if motion_um is None else motion_um
    plays = np.zeros((n, 0)) if plays is None else plays
    t_s = STEP_S * np.arange(start + n)
    run = Made(
        role=role, start=start, stop=start + n, rows=slice(start, start + n), t_s=t_s, step_s=STEP_S, idle=idle,
        driven=not idle, span_s=(0.0, t_s[-1]),
    )  # fmt: skip
    nuisances = np.concatenate([np.ones((n, 1)), plays], axis=1)
    return Made(
        run=run, axis=axis, nuisances=nuisances, answer=lambda extra=(): motion, error=lambda extra=(): x_um - motion
    )


def blocks(n, usual_um=1.0, plays=None, start=0):
    return BlockedRun(record(np.zeros(n), plays=plays, start=start), usual_um)


def of_power(run, power, rng):
    """A column in um of this mean power (blocks,), every coefficient of a block as large and of either sign."""
    size = np.sqrt(np.repeat(power, run.sizes)) * rng.choice([-1.0, 1.0], run.sizes.sum())
    return np.append(np.zeros(run.skipped), idct(np.append(0.0, size), norm="ortho"))


@given(ROWS, SEEDS, st.floats(-1e3, 1e3))
def test_coefficients_keep_the_power_and_lose_the_mean(n, seed, offset_um):
    run, columns = blocks(n, start=seed % 50), np.random.default_rng(seed).normal(size=(n, 3))
    found = run.coefficients(columns + offset_um)
    assert found.shape == (run.rows - 1, 3)
    counted = columns[run.skipped :]
    np.testing.assert_allclose(np.sum(found**2, axis=0), len(counted) * np.var(counted, axis=0), rtol=1e-6)
    np.testing.assert_allclose(found, run.coefficients(columns), atol=1e-8)


@given(ROWS)
def test_rows_that_carry_over_what_went_before_do_not_count(n):
    run, rows = blocks(n), np.arange(n)
    carried = min(round(CARRIED_OVER_s / STEP_S), n // 2)
    assert run.skipped >= carried
    assert run.rows == n - run.skipped
    assert next_fast_len(run.rows) == run.rows
    assert all(next_fast_len(more) > more for more in range(run.rows + 1, n - carried + 1))
    first = np.where(rows < run.skipped, 1e3, 0.0) * (1 + rows)
    assert not run.coefficients(first[:, None]).any()
    assert run.coefficients(np.where(rows == run.skipped, 1.0, 0.0)[:, None]).all()


@pytest.mark.parametrize("phase", [0.0, 1.0, 2.5])
def test_a_mode_of_the_base_that_still_rings_from_before_is_taken_out(phase):
    """However it was left; a ring of another frequency or another damping stays."""
    mode = AdoptedEffect(name="resonance", params={"f_Hz": 90.0, "zeta": 0.03, "c": 1.0})
    t_s = STEP_S * np.arange(500)

    def left_of(f_Hz, zeta):
        ring = np.exp(-2 * np.pi * f_Hz * zeta * t_s) * np.cos(2 * np.pi * f_Hz * np.sqrt(1 - zeta**2) * t_s + phase)
        run = BlockedRun(record(ring, axis=LINE.model_copy(update={"effects": (mode,)})), 0.01)
        return np.sum(run.coefficients(ring[:, None]) ** 2) / np.sum(run.modelled.error() ** 2)

    assert left_of(90.0, 0.03) < 1e-3
    assert left_of(180.0, 0.03) > 0.3
    assert left_of(90.0, 0.003) > 0.1


@given(SEEDS, st.floats(0.01, 100.0))
def test_the_start_of_its_plays_is_taken_out_as_far_as_its_prior_allows(seed, usual_um):
    """What is left is what a residual of noise and of plays one deviation off says of the noise."""
    rng, n = np.random.default_rng(seed), 60
    plays = (np.arange(n)[:, None] < rng.integers(10, 50, 2)) * rng.uniform(0.5, 2, 2)
    x = rng.normal(size=n) + plays @ rng.normal(size=2)
    run = blocks(n, usual_um, plays)
    counted, moved = (c[run.skipped :] - c[run.skipped :].mean(axis=0) for c in (x, plays))
    left = np.zeros(n)
    left[run.skipped :] = np.linalg.solve(np.eye(run.rows) + moved @ moved.T / usual_um**2, counted)
    np.testing.assert_allclose(
        run.coefficients(x[:, None]), blocks(n).coefficients(left[:, None]), atol=1e-6, rtol=1e-6
    )


def test_a_play_is_forgotten_where_the_record_tells_and_stays_where_it_does_not():
    plays = np.where(np.arange(200) < 80, 1.0, 0.0)[:, None]
    whole = np.sum(blocks(200).coefficients(plays) ** 2)
    for usual_um, share in ((0.01, 0.0), (1e4, 1.0)):
        assert np.sum(blocks(200, usual_um, plays).coefficients(plays) ** 2) / whole == pytest.approx(share, abs=1e-3)


@given(ROWS)
def test_octaves_hold_every_coefficient_once(n):
    run = blocks(n, start=7)
    held = np.concatenate([np.arange(a, b) for a, b in zip(run.edges[:-1], run.edges[1:], strict=True)])
    np.testing.assert_array_equal(held, np.arange(run.rows - 1))
    assert run.sizes.min() > 0
    assert run.sizes.sum() == run.rows - 1
    for first, last in zip(run.edges[:-1] + 1, run.edges[1:], strict=True):
        assert last < 2 * first  # from its first coefficient, of frequency 1, on below the double
    assert len(run.octaves) == len(run.sizes)
    assert np.all(np.diff(run.octaves) >= 0)


@pytest.mark.parametrize("f_Hz", [3.0, 10.0, 40.0, 170.0, 450.0])
def test_a_sine_is_in_the_octave_of_its_frequency(f_Hz):
    run = blocks(2000)
    power = run.power(np.sin(2 * np.pi * f_Hz * np.arange(2000) * STEP_S)) * run.sizes
    assert abs(run.octaves[power.argmax()] - np.log2(f_Hz)) <= 1


@given(ROWS, SEEDS)
def test_products_of_all_octaves_are_the_whole(n, seed):
    run, rng = blocks(n), np.random.default_rng(seed)
    a, b = (rng.normal(size=(run.rows - 1, k)) for k in (2, 3))
    found = run.products(a, b)
    assert found.shape == (len(run.sizes), 2, 3)
    np.testing.assert_allclose(np.tensordot(run.sizes, found, 1), a.T @ b, atol=1e-9)
    column = rng.normal(size=n)
    assert run.power(column) @ run.sizes == pytest.approx(run.rows * np.var(column[run.skipped :]))


@given(ROWS, SEEDS)
def test_spreading_moves_power_between_octaves_and_loses_none(n, seed):
    run = blocks(n)
    power = np.random.default_rng(seed).exponential(size=len(run.sizes))
    found = run.spread(power)
    assert found @ run.sizes == pytest.approx(power @ run.sizes)
    assert np.all(found > 0)
    np.testing.assert_allclose(run.spread(3 * power), 3 * found)


def test_spread_power_falls_from_octave_to_octave():
    run = blocks(512)
    for place in range(len(run.sizes)):
        total = run.spread(np.eye(len(run.sizes))[place]) * run.sizes
        apart = np.abs(np.arange(len(total)) - place)
        np.testing.assert_allclose(total * FALLS_BY**apart, total[place])


@pytest.mark.parametrize(("role", "changed"), [("reference", False), ("train", True), ("holdout", True)])
def test_effects_act_in_all_but_reference_records(role, changed):
    assert BlockedRun(record(np.zeros(20), role=role), 1.0).changed is changed


def test_how_surely_a_record_tells_its_plays_is_what_the_base_leaves_of_references():
    rng = np.random.default_rng(0)
    small, large = 0.1 * rng.normal(size=300), 10 * rng.normal(size=300)
    both = blocked([record(small, role="reference"), record(large)])
    assert [run.usual_um for run in both] == pytest.approx([small.std()] * 2)
    assert blocked([record(large)])[0].usual_um == pytest.approx(large.std())
    assert blocked([record(np.zeros(20))])[0].usual_um > 0


def expected(*records):
    every = blocked(records)
    return noise_and_base_share_of(every), every


def sloped(run, exponent):
    """Power (blocks,) in um^2 that changes as a power of the frequency."""
    return 0.01 * 2.0 ** (exponent * run.octaves.astype(float))


@pytest.mark.parametrize("exponent", [0.0, -1.0, 0.7])
@pytest.mark.parametrize("role", ["reference", "train"])
def test_noise_is_that_of_records_at_rest(exponent, role):
    """Smoothed over neighbouring octaves, which bends a slope a little. What moves says nothing of it."""
    rng, run = np.random.default_rng(1), blocks(1024)
    drawn = sloped(run, exponent)
    loud = [record(of_power(run, 1e4 * drawn, rng), role=role) for _ in range(2)]
    still = [record(of_power(run, drawn, rng), role=role, idle=True) for _ in range(3)]
    found, (first, *_) = expected(*still, *loud)
    noise, missed, _ = found.of(first, np.zeros(len(drawn)))
    np.testing.assert_allclose(noise / drawn, 1.0, rtol=0.4 if exponent else 1e-6)
    assert not missed.any()


def test_no_noise_is_below_what_a_sensor_has():
    found, _ = expected(record(np.zeros(100), role="reference", idle=True))
    assert np.all(found.noise_um2 >= LEAST_UM2)


@pytest.mark.parametrize("share", [0.002, 0.03, 0.2])
def test_the_share_that_the_base_misses_is_that_of_driven_references(share):
    rng, run = np.random.default_rng(2), blocks(1024)
    noise = np.full(len(run.sizes), 1e-4)
    records = [record(of_power(run, noise, rng), role="reference", idle=True)]
    for swing_um in (1.0, 5.0, 20.0):
        motion = swing_um * np.cumsum(rng.normal(size=1024))
        left = of_power(run, noise + share**2 * run.spread(run.power(motion)), rng)
        records.append(record(motion + left, motion, "reference"))
    changed = record(100 * rng.normal(size=1024), np.zeros(1024))
    found, every = expected(*records, changed)
    motion = np.arange(1.0, len(run.sizes) + 1)
    found_noise, missed, _ = found.of(every[-1], motion)
    np.testing.assert_allclose(missed, share**2 * motion, rtol=1e-6)
    np.testing.assert_allclose(found_noise, noise, rtol=1e-6)


def test_more_driven_references_tell_more():
    rng, run = np.random.default_rng(3), blocks(256)
    motion = np.cumsum(rng.normal(size=256))
    driven = [record(motion + of_power(run, np.ones(len(run.sizes)), rng), motion, "reference") for _ in range(6)]
    told = [expected(*driven[:count])[0].share_told for count in (1, 3, 6)]
    np.testing.assert_allclose(told[1:], [3 * told[0], 6 * told[0]])
    assert np.all(told[0] > 1)


def test_noise_is_told_by_every_coefficient_of_records_at_rest():
    """The lowest octave has one or two. Records differ, so that it is never known better than the misfit; a sum of two
    parts is told as the part that dominates it (Welch 1947)."""
    rng, run = np.random.default_rng(3), blocks(256)
    still = [record(of_power(run, np.ones(len(run.sizes)), rng), role="reference", idle=True) for _ in range(4)]
    motion = np.cumsum(rng.normal(size=256))
    left = of_power(run, np.full(len(run.sizes), 100.0), rng)
    driven = [record(motion + left, motion, "reference")] * 30
    (one, (first, *_)), (four, _) = expected(still[0], *driven), expected(*still, *driven)
    assert four.noise_told[0] == pytest.approx(4 * one.noise_told[0])
    assert one.noise_told[0] < 3
    np.testing.assert_allclose(one.noise_told[-2:], one.share_told[-2:])
    *_, at_rest = one.of(first, np.zeros(len(run.sizes)))
    *_, in_motion = one.of(first, np.full(len(run.sizes), 1e12))
    np.testing.assert_allclose(at_rest, one.noise_told[first.octaves - one.first])
    np.testing.assert_allclose(in_motion, one.share_told[first.octaves - one.first])


def test_octaves_in_which_no_reference_moves_have_the_prior_of_the_share():
    """As where all driven references are shorter than what is judged: neither more nor less is known there."""
    rng, long = np.random.default_rng(5), 4096
    motion = np.cumsum(rng.normal(size=64))
    driven = record(motion + rng.normal(size=64), motion, "reference")
    still = record(rng.normal(size=long), role="reference", idle=True)
    found, (_, _, first) = expected(driven, still, record(rng.normal(size=long)))
    noise, missed, told = found.of(first, np.ones(len(first.sizes)))
    assert np.isfinite([noise, missed, told]).all()
    assert missed[0] == BASE_SHARE**2
    assert min(told) > 0


def test_without_references_the_noise_is_the_quietest_and_the_share_a_prior():
    rng, run = np.random.default_rng(4), blocks(512)
    power = np.full(len(run.sizes), 0.09)
    power[4] = 0.0016
    moved = 10 * rng.normal(size=512)
    quiet = record(moved + of_power(run, power, rng), moved)
    loud = record(moved + of_power(run, 100 * power, rng), moved)
    found, (first, _) = expected(quiet, loud)
    motion = np.linspace(1, 2, len(run.sizes))
    noise, missed, told = found.of(first, motion)
    assert np.ptp(noise) == 0
    assert 0.0016 <= noise[0] < 0.09  # the quietest octave, smoothed with those beside it
    np.testing.assert_allclose(missed, BASE_SHARE**2 * motion)
    assert np.all((told >= UNTOLD) & (told <= 2 * UNTOLD))


def test_the_share_is_the_likeliest_not_that_of_the_record_that_moves_most():
    """Without noise the mean, over all records, of what each misses for how much it moves."""
    run = blocks(256)
    motion = np.cumsum(np.random.default_rng(5).normal(size=256))
    records = []
    for swing, share in ((1.0, 0.01), (1.0, 0.03), (30.0, 0.002)):
        of_it = run.spread(run.power(swing * motion))
        left = of_power(run, share**2 * of_it, np.random.default_rng(6))
        records.append(record(swing * motion + left, swing * motion, "reference"))
    still = record(np.zeros(256), role="reference", idle=True)
    found, (first, *_) = expected(*records, still)
    _, missed, _ = found.of(first, run.spread(run.power(motion)))
    mean = np.mean([0.01**2, 0.03**2, 0.002**2])
    np.testing.assert_allclose(missed / run.spread(run.power(motion)), mean, rtol=0.01)


@given(size=st.integers(1, 10**6), noise=st.floats(1e-6, 1e3), missed=st.floats(0.0, 1e3), times=st.floats(1e-3, 1e3))
def test_what_is_missed_counts_once_and_noise_in_each_coefficient(size, noise, missed, times):
    """In any unit; beside what is missed, the mean power of noise differs by chance."""
    of_one = np.ones(1)
    of_noise = NoiseAndBaseShare(0, of_one, of_one, of_one, of_one, noise_spread=of_one)

    def counted(size, noise, missed):
        return of_noise.counted(np.array([0]), np.array([size]), np.array([noise]), np.array([missed])).item()

    n = counted(size, noise, missed)
    root = np.sqrt(2 * size)
    assert 1 - 1e-9 <= n <= (size + root) / (1 + root) * (1 + 1e-9)
    assert n == pytest.approx(counted(size, times * noise, times * missed))
    assert n <= counted(size, noise, missed / 2) + 1e-9
    assert n <= counted(2 * size, noise, missed) + 1e-9
    assert counted(size, noise, 1e6 * noise) == pytest.approx(1.0, rel=1e-5)
    assert counted(size, noise, 0.0) == pytest.approx((size + root) / (1 + root))


@pytest.mark.parametrize("role", ["reference", "train"])
def test_what_no_record_at_rest_shows_to_be_noise_counts_once(role):
    """It may be missed as well: without such a record, and in octaves below its own. So does a line."""
    rng, run = np.random.default_rng(4), blocks(1024)
    motion = np.cumsum(rng.normal(size=1024))
    white = of_power(run, np.ones(len(run.sizes)), rng)
    driven = record(motion + white, motion, role)
    missed = 1e-3 * np.ones(len(run.sizes))

    def counted(*records):
        return expected(*records)[0].counted(run.octaves, run.sizes, np.ones(len(run.sizes)), missed)

    def still(x_um):
        return record(x_um, role=role, idle=True)

    assert np.all(counted(driven) == 1)
    assert np.all(counted(driven, still(white))[3:] > 2)
    short = counted(driven, still(white[:256]))
    assert np.all(short[:2] == 1)
    assert np.all(short[3:] > 2)
    line = white + 30 * np.sin(2 * np.pi * 300 * np.arange(1024) / 1024)
    fewer = counted(driven, still(line)) / counted(driven, still(white))
    at = int(np.searchsorted(run.edges, 600 * run.rows // 1024, side="right")) - 1
    assert fewer[at] < 0.3
    assert np.all(np.delete(fewer, at)[3:] > 0.5)


def test_the_share_of_the_noise_that_motion_adds_is_found_however_small():
    """Blocks that show a little more than noise, and such as show less, which leave none."""
    rng, run = np.random.default_rng(8), blocks(1024)
    noise = np.ones(len(run.sizes))
    motion = rng.normal(size=1024)
    of_motion = run.spread(run.power(motion))
    still = record(of_power(run, noise, rng), role="reference", idle=True)
    for more in (0.05, 0.3, -0.1):
        driven = record(motion + of_power(run, noise + more * of_motion, rng), motion, "reference")
        found, _ = expected(driven, still)
        share = found.of(run, np.ones(len(noise)))[1]
        np.testing.assert_allclose(share, max(more, 0.0), rtol=1e-3, atol=1e-9)
