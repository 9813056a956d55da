"""Creep beside the operator of any records: how much there is, and none where there is none or nothing tells it.

The stage creeps by a sum of exponentials that is worked out row by row, and answers with a stack of plays.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from any_stage import play_stack
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import phaselead as pl
from phaselead.identify.fitting import fit
from phaselead.identify.verification import verify
from phaselead.model import lags, without_lags
from phaselead.record.recording import AxisRecord, Recording
from trials import in_trials

Array = NDArray[np.float64]
RATE_HZ, SPAN_V = 500.0, 100.0


def crept(x: Array, per_decade: float) -> Array:
    """What goes on after ``x``: five lags to the decade, of equal shares, from 20 ms to 200 s, at rest before."""
    found = np.zeros(len(x))
    for tau_s in 0.02 * 10 ** (np.arange(20) / 5):
        state, keep = 0.0, float(np.exp(-1 / (RATE_HZ * tau_s)))
        for i, now in enumerate(x.tolist()):
            state = keep * state + (1 - keep) * now
            found[i] += per_decade / 5 * state
    return found


def stairs(rng: np.random.Generator) -> Array:
    """A full scan, then steps of half a second with edges of 20 ms."""
    scan = SPAN_V * (0.5 - 0.5 * np.cos(2 * np.pi * np.arange(round(4 * RATE_HZ)) / (2 * RATE_HZ)))
    levels = np.repeat(rng.uniform(0.1, 0.9, 12) * SPAN_V, round(0.5 * RATE_HZ))
    edge = np.ones(10) / 10
    return np.concatenate([scan, np.convolve(np.concatenate([np.zeros(9), levels]), edge, "valid")])


def wandering(rng: np.random.Generator) -> Array:
    """Slow sines that begin at 0 V."""
    t = np.arange(round(10 * RATE_HZ)) / RATE_HZ
    moved = sum(rng.uniform(0.3, 1) * np.sin(2 * np.pi * f * t) ** 2 for f in (0.13, 0.31, 0.77, 1.9))
    return np.asarray(0.9 * SPAN_V * moved / np.max(moved))


def records(per_decade: float, seed: int = 1) -> list[Recording]:
    rng, found = np.random.default_rng(seed), []
    for name, u in (("stairs", stairs(rng)), ("wandering", wandering(rng)), ("more", stairs(rng))):
        x = play_stack(u, SPAN_V)
        x = x + crept(x, per_decade) + rng.normal(0, 0.005, len(u))
        t = np.arange(len(u)) / RATE_HZ
        found.append(Recording(t, {"x": AxisRecord(u, x)}, slice(None), name))
    return found


def with_positions(changed: Callable[[Array], Array], recordings: list[Recording]) -> list[Recording]:
    """The same records of another sensor."""
    axes = [AxisRecord(r.axes["x"].u_V, changed(r.axes["x"].x_um)) for r in recordings]
    return [replace(r, axes={"x": axis}) for r, axis in zip(recordings, axes, strict=True)]


def creep_of(recordings: list[Recording]) -> float:
    """Per decade, as the stage file has it."""
    stage, _ = fit(recordings)
    return sum(float(one.params["gamma"]) for one in stage.axis("x").effects if one.name == "creep")


@pytest.mark.parametrize("per_decade", [0.01, *in_trials(0.003, 0.03)])
def test_what_creeps_is_found_in_any_records(per_decade):
    assert creep_of(records(per_decade)) == pytest.approx(per_decade, rel=0.05)


def test_a_stage_that_does_not_creep_gets_none():
    assert creep_of(records(0.0)) == 0.0


def test_the_sensor_may_count_backwards():
    turned = with_positions(lambda x: -x, records(0.01))
    assert creep_of(turned) == pytest.approx(creep_of(records(0.01)), rel=0.02)


def test_a_sine_of_one_frequency_does_not_tell_creep_from_a_loop():
    t = np.arange(2000) / RATE_HZ
    u = SPAN_V * (0.5 - 0.5 * np.cos(2 * np.pi * t))
    x = play_stack(u, SPAN_V)
    x = x + crept(x, 0.02)
    assert creep_of([Recording(t, {"x": AxisRecord(u, x)}, slice(None), "sine")]) == 0.0


@pytest.mark.parametrize("share", [0.05, *in_trials(1.0)])
def test_a_quick_lag_is_not_called_creep(share):
    """Of 20 ms, of all that the sensor says or of a twentieth: no straight line in the logarithm of time."""

    def late(x: Array) -> Array:
        slow, keep = x.copy(), float(np.exp(-1 / (0.02 * RATE_HZ)))
        for i in range(1, len(x)):
            slow[i] = keep * slow[i - 1] + (1 - keep) * x[i]
        return (1 - share) * x + share * slow

    assert creep_of(with_positions(late, records(0.0))) == 0.0


@pytest.mark.parametrize("rest_um", [50.0, *in_trials(0.0)])
def test_what_the_model_predicts_rests_where_the_stage_does(rest_um):
    """In um, not about the mean: from rest at 0 V, wherever the sensor has its zero."""
    moved = with_positions(lambda x: x + rest_um, [*records(0.02), *records(0.02, seed=2)])
    stage, _ = fit(moved[:3])
    assert [one.name for one in stage.axis("x").effects] == ["creep"]
    assert max(one.mean_um for one in verify(stage, moved[3:])) < 0.002 * SPAN_V


def test_creep_does_not_depend_on_the_unit():
    small = with_positions(lambda x: 1e-4 * x, records(0.01))
    assert creep_of(small) == pytest.approx(creep_of(records(0.01)), rel=0.02)


def test_none_is_looked_for_where_that_is_asked():
    assert pl.fit(records(0.01), creep=False).model.axis("x").effects == ()


def test_a_message_says_how_much():
    _, report = fit(records(0.01))
    assert any("% per decade of time; adopted as effect creep" in line for line in report.messages)


SHARES = st.lists(st.tuples(st.floats(0.0, 0.1), st.floats(0.01, 100.0)), min_size=1, max_size=8)


@given(SHARES, st.integers(0, 2**32 - 1), st.floats(-1e6, 1e6), st.booleans())
@settings(deadline=None, max_examples=50)
def test_lags_are_undone(terms, seed, offset, moves):
    gain, tau_s = map(list, zip(*terms, strict=True))
    y = np.random.default_rng(seed).normal(size=300).cumsum() * moves + offset
    x = y + lags(y, tau_s, gain, 0.01)
    assert without_lags(x, tau_s, gain, 0.01) == pytest.approx(y, abs=1e-7 * float(np.ptp(x)) + 1e-9 * abs(offset))


@pytest.mark.parametrize("gain", [[1.0], [0.6, 0.5], [-0.1]])
def test_lags_that_cannot_be_undone_are_refused(gain):
    with pytest.raises(ValueError, match="cannot be undone"):
        without_lags(np.arange(5.0), [1.0] * len(gain), gain, 0.01)
