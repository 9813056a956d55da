"""Where the residual lies: each signature in its cell and in words, and silence about noise."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from phaselead.gap.error_rates import ERROR_RATE
from phaselead.gap.findings import NamedEffect
from phaselead.gap.locate.cells import AMPLITUDE, DIRECTION, FREQUENCY, HARMONIC, STEP
from phaselead.gap.locate.ranking import axis_cells, rank_cells
from phaselead.gap.locate.sentences import explained, headline, sentence_of
from phaselead.gap.noise import Noise
from phaselead.gap.records import GapRun
from phaselead.gap.residual import RunResidual
from phaselead.model import catalogue

RATE_HZ = 1000.0
SENSOR = Noise(np.array([1.0, -0.5]), 0.01)
WANDERING = Noise(np.array([1.0, -0.3]), 0.005, 0.03, 0.4, 1e-7)


def run_of(u: np.ndarray, name: str = "rec") -> GapRun:
    n = len(u)
    t = np.arange(n) / RATE_HZ
    return GapRun("x", "holdout", t, u, np.zeros(n), None, 0, n, name, {}, {})


def steps(seconds: float = 24.0) -> np.ndarray:
    n = round(seconds * RATE_HZ)
    return np.array([0.0, 6.0, 2.0, 8.0, 1.0, 5.0, 0.0, 3.0])[np.minimum(np.arange(n) * 8 // n, 7)]


def sine(f_Hz: float = 5.0, seconds: float = 8.0) -> np.ndarray:
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    return 4 - 4 * np.cos(2 * np.pi * f_Hz * t)


def records() -> list[GapRun]:
    return [run_of(sine(), "sine"), run_of(steps(), "steps"), run_of(np.zeros(4000), "idle")]


def parts(error, noise: Noise = SENSOR, seed: int = 0, runs=None) -> list[RunResidual]:
    """Noise, and what ``error`` (of a run) adds to it."""
    rng = np.random.default_rng(seed)
    runs = records() if runs is None else runs
    found = []
    for run in runs:
        drawn = noise.drawn(run.u_V[run.rows], run.step_s, rng)
        e = drawn - drawn.mean() + error(run)
        found.append(RunResidual(run, e - e.mean()))
    return found


def first(cells, by):
    return next(c for c in cells if c.by == by)


def creep(run: GapRun, per_V: float = 0.02, up: float = 1.0, down: float = 1.0) -> np.ndarray:
    """A line over the logarithm of time after every step, in its direction."""
    e = np.zeros(len(run.u_V))
    jumps = [*(np.flatnonzero(np.abs(np.diff(run.u_V)) > 0.5) + 1), len(e)]
    for a, b in pairwise(jumps):
        size = run.u_V[a] - run.u_V[a - 1]
        factor = up if size > 0 else down
        e[a:b] = per_V * factor * size * np.log10((np.arange(b - a) + 1) / RATE_HZ / 1e-3)
    return e


def test_creep_is_a_slow_rise_after_steps_the_same_in_both_directions():
    found = rank_cells(parts(creep), SENSOR)
    told = next(c for c in found if c.by == STEP and c.cell == "all")
    assert told.p <= ERROR_RATE
    assert told.sentence.endswith("% of the unexplained power is a slow rise after steps, the same in both directions")
    assert told.share > 0.5
    assert headline(found) == told.sentence


def test_a_return_after_steps_and_one_side_are_told_apart():
    back = rank_cells(parts(lambda run: -creep(run)), SENSOR)
    assert "slow return after steps, the same" in next(c for c in back if c.cell == "all").sentence
    one = rank_cells(parts(lambda run: creep(run, down=0.05)), SENSOR)
    assert "mostly after steps up" in next(c for c in one if c.cell == "all").sentence


def test_drift_does_not_follow_the_steps():
    found = rank_cells(parts(lambda run: 0.05 * run.t_s if run.name == "steps" else 0 * run.t_s), SENSOR)
    sentences = [c.sentence for c in found if c.cell == "all"]
    assert all("whichever way they go" in s for s in sentences)
    slow = first(found, FREQUENCY)
    assert slow.p <= ERROR_RATE
    assert slow.cell.startswith("0..")


def test_a_line_is_found_in_its_octave():
    found = rank_cells(parts(lambda run: 0.05 * np.sin(2 * np.pi * 90 * run.t_s)), SENSOR)
    best = found[0]
    assert (best.by, best.cell) == (FREQUENCY, "64..128 Hz")
    assert best.share > 0.9
    assert best.p <= ERROR_RATE


def test_ringing_comes_soon_after_steps():
    def ring(run):
        e = np.zeros(len(run.u_V))
        for a in np.flatnonzero(np.abs(np.diff(run.u_V)) > 0.5) + 1:
            t = (np.arange(len(e) - a)) / RATE_HZ
            e[a:] += 0.5 * np.sin(2 * np.pi * 150 * t) * np.exp(-t / 0.02)
        return e

    found = rank_cells(parts(ring), SENSOR)
    assert {c.cell for c in found if c.by == STEP and c.p <= ERROR_RATE} >= {"0.01..0.1 s"}
    assert first(found, FREQUENCY).cell == "128..256 Hz"
    assert "between 128 and 256 Hz" in headline(found)
    assert not [c for c in found if c.cell == "all"]


@pytest.mark.parametrize(("order", "words"), [(1, "size or phase"), (2, "one half"), (3, "both halves")])
def test_harmonics_of_the_drive(order, words):
    def error(run):
        return 0.05 * np.cos(2 * np.pi * 5 * order * run.t_s + 0.3) if run.name == "sine" else 0 * run.t_s

    best = first(rank_cells(parts(error), SENSOR), HARMONIC)
    assert best.cell == str(order)
    assert best.p <= ERROR_RATE
    assert best.share > 0.9
    assert words in best.sentence


def test_no_sentence_about_where_names_an_effect():
    parts_of_names = {word for name in catalogue() for word in name.split("_")}
    cells = [(HARMONIC, order) for order in "123"] + [(DIRECTION, d) for d in ("rising", "falling", "still")]
    for by, cell in cells:
        assert not parts_of_names & set(sentence_of(by, cell, 0.5).replace(":", "").split())


def test_amplitude_and_direction():
    high = first(rank_cells(parts(lambda run: 0.1 * (run.u_V > 6.5) * np.sin(300 * run.t_s)), SENSOR), AMPLITUDE)
    assert (high.cell, high.p <= ERROR_RATE) == ("6..8 V", True)
    rising = rank_cells(parts(lambda run: 0.1 * (np.gradient(run.u_V) > 1e-3) * np.sin(300 * run.t_s)), SENSOR)
    best = first(rising, DIRECTION)
    assert (best.cell, best.p <= ERROR_RATE) == ("rising", True)
    assert best.share > 0.9


def test_the_axis_that_has_the_power():
    rng = np.random.default_rng(0)
    errors = {"x": [rng.normal(0, 0.03, 8000)], "y": [rng.normal(0, 0.01, 8000)], "z": [rng.normal(0, 0.01, 8000)]}
    cells = axis_cells(errors, {"x": 0.01, "y": 0.01, "z": 0.01})
    assert [c.cell for c in cells if c.p <= ERROR_RATE] == ["x"]
    assert next(c for c in cells if c.cell == "x").share == pytest.approx(9 / 11, abs=0.01)
    assert axis_cells({"x": errors["x"]}, {"x": 0.01}) == []


@pytest.mark.parametrize("noise", [SENSOR, WANDERING], ids=["coloured", "with misfit"])
def test_noise_alone_stands_out_as_rarely_as_promised(noise):
    """One family in a hundred; a family is all cells of a session."""
    runs = [run_of(sine(seconds=2.0), "sine"), run_of(steps(4.0), "steps"), run_of(np.zeros(1000), "idle")]
    loud = sum(
        any(c.p <= ERROR_RATE for c in rank_cells(parts(lambda run: 0.0, noise, s, runs), noise, s)) for s in range(40)
    )
    assert loud <= 3  # 0.4 expected; more than 3 in one of 1000


def test_axes_of_noise_alone():
    loud = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        errors = {a: [rng.normal(0, s, 2400)] for a, s in (("x", 0.01), ("y", 0.03), ("z", 0.01))}
        loud += any(c.p <= ERROR_RATE for c in axis_cells(errors, {"x": 0.01, "y": 0.03, "z": 0.01}))
    assert loud <= 8


def test_nothing_is_said_of_nothing():
    run = run_of(sine())
    assert rank_cells([RunResidual(run, np.zeros(len(run.u_V)))], SENSOR) == []
    assert headline([]) is None


def test_an_offset_is_not_said_to_explain_nothing():
    """The gap is about each record's own mean: "offset: 0 % of the unexplained power" read like a name for nothing."""
    assert "0 %" not in explained(NamedEffect("offset", {}, 0.0))
    assert explained(NamedEffect("creep", {}, 0.25)) == "25 % of the unexplained power"
