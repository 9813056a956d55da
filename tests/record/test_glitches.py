"""Rows that stand alone are seen, and what a stage or a sensor does by itself is not."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phaselead.record import AxisRecord, Recording, glitch_doubts
from phaselead.record.glitches import glitches
from phaselead.record.read import windowed

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
    assert len(glitches(x_um)) == 0


@pytest.mark.parametrize("scored", [slice(None), slice(5000, None)])
def test_the_line_says_where_among_the_rows_that_are_judged(scored):
    x_um = path("sine", 0.01, 1)
    x_um[[3000, 9000]] += 30.0
    record = Recording(T_S, {"x": AxisRecord(np.zeros(ROWS), x_um)}, scored=scored, source="a.csv")
    (line,) = glitch_doubts([record])
    first, more = ("0.6", " (1 more like it)") if scored == slice(None) else ("1.8", "")
    assert line.startswith(f"a.csv: the position of axis x jumps away and back at t_s = {first}; ")
    assert f", or record again{more}; " in line
    assert glitch_doubts([Recording(T_S, {"x": AxisRecord(np.zeros(ROWS), None)})]) == []


def test_the_windows_that_are_proposed_have_no_glitch():
    x_um = path("sine", 0.01, 1)
    x_um[[3000, 3001]] += 30.0
    record = Recording(T_S, {"x": AxisRecord(np.zeros(ROWS), x_um)}, source="a.csv")
    (line,) = glitch_doubts([record])
    ends = re.search(r"@:([0-9.]+) and @([0-9.]+):", line)
    assert ends is not None
    for window in ((-np.inf, float(ends[1])), (float(ends[2]), np.inf)):
        part = windowed(record, window)
        assert not {3000, 3001} & {*range(*part.scored.indices(ROWS))}
        assert len(part.t_s[part.scored]) > 2900


@pytest.mark.parametrize("f_Hz", [60, 100, 125, 500, 2000])
@pytest.mark.parametrize("zeta", [0.02, 0.1, 0.3])
def test_one_step_of_a_stage_that_rings_is_no_glitch(f_Hz, zeta):
    """However far it overshoots, and however little else moves."""
    since = np.maximum(T_S - 2.5, 0.0)
    ring = 100 * (1 - np.exp(-2 * np.pi * f_Hz * zeta * since) * np.cos(2 * np.pi * f_Hz * since))
    x_um = np.where(T_S < 2.5, 0.0, ring) + np.random.default_rng(f_Hz).normal(0, 0.01, ROWS)
    assert len(glitches(x_um)) == 0


def test_what_the_drive_does_is_no_glitch():
    u_V = np.zeros(ROWS)
    u_V[7000] = 5.0
    x_um = 10 * u_V + np.random.default_rng(1).normal(0, 0.01, ROWS)
    assert len(glitches(x_um)) == 1
    assert len(glitches(x_um, u_V)) == 0
