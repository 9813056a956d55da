"""Rows that stand alone are seen, and what a stage or a sensor does by itself is not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phaselead.record import AxisRecord, Recording, glitch_doubts
from phaselead.record.glitches import glitches

ROWS = 20_000
T_S = np.arange(ROWS) / 5000


def path(kind, noise_um, seed):
    """Positions (ROWS,) in um of a sine, stairs, a ringing stage, one at rest, or what a coarse sensor sees."""
    rng = np.random.default_rng(seed)
    sine = 30 * np.sin(2 * np.pi * 5 * T_S)
    since = T_S % 0.5
    moves = {
        "sine": sine,
        "stairs": 10 * np.floor(T_S / 0.5),
        "ringing": 20 * np.exp(-2 * np.pi * 1200 * 0.02 * since) * np.cos(2 * np.pi * 1200 * since),
        "rest": np.zeros(ROWS),
        "coarse": sine,
    }[kind]
    seen = moves + noise_um * rng.normal(size=ROWS)
    return np.round(seen / 0.5) * 0.5 if kind == "coarse" else seen


KINDS = st.sampled_from(["sine", "stairs", "ringing", "rest", "coarse"])
NOISE = st.sampled_from([0.0, 0.005, 0.1, 0.5])


@given(KINDS, NOISE, st.integers(0, 999))
def test_no_stage_and_no_sensor_is_said_to_have_glitches(kind, noise_um, seed):
    assert len(glitches(path(kind, noise_um, seed))) == 0


@given(st.sampled_from(["sine", "stairs", "rest", "coarse"]), NOISE.filter(bool), st.integers(0, 999), st.data())
def test_rows_that_stand_alone_are_seen(kind, noise_um, seed, data):
    x_um = path(kind, noise_um, seed)
    where = sorted(data.draw(st.sets(st.integers(1, ROWS // 500 - 2), min_size=1, max_size=5)))
    for i in where:
        x_um[500 * i + 250] += data.draw(st.sampled_from([-1, 1])) * max(40 * noise_um, 20.0)
    assert glitches(x_um).tolist() == [500 * i + 250 for i in where]


@given(st.integers(2, 900), st.integers(0, 99))
def test_of_few_rows_nothing_is_said(rows, seed):
    x_um = np.random.default_rng(seed).normal(size=rows)
    x_um[rows // 2] += 100.0
    assert len(glitches(x_um)) == (1 if rows >= 1000 else 0)


@pytest.mark.parametrize("scored", [slice(None), slice(5000, None)])
def test_the_line_says_where_among_the_rows_that_are_judged(scored):
    x_um = path("sine", 0.01, 1)
    x_um[[3000, 9000]] += 30.0
    record = Recording(T_S, {"x": AxisRecord(np.zeros(ROWS), x_um)}, scored=scored, source="a.csv")
    (line,) = glitch_doubts(record)
    first, others = ("0.6", " (1 more like it)") if scored == slice(None) else ("1.8", "")
    assert line.startswith(f"a.csv: the position of axis x jumps away and back at t_s = {first}{others}: ")
    assert glitch_doubts(Recording(T_S, {"x": AxisRecord(np.zeros(ROWS), None)})) == []
