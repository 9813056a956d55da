"""``fit`` on stages whose memory of a turn fades, and on one whose does not; equations of their own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from any_stage import NO_MODE, held_out, laboratory

from phaselead.identify.fitting import fit
from phaselead.identify.operator import fit_operator, regressors
from phaselead.identify.runs import AxisRun
from phaselead.identify.words import hysteresis_pct
from phaselead.model.prediction import predict
from phaselead.record.recording import AxisRecord

RATE_HZ = 2500.0
RECORDS = ("sine", "small sine", "steps", "multisine")


def coleman_hodgdon(u, span):
    """dz/du = 1.7 (sign(du) - z), u over half of its span; a loop of a tenth of the travel."""
    s, z = 2 * u / span, [0.0]
    for d in np.diff(s):
        end = np.sign(d)
        z.append(end + (z[-1] - end) * np.exp(-1.7 * abs(d)))
    return u - 0.05 * span * np.array(z)


def bouc_wen(u, span):
    """dz/ds = 1 - (|z| / 0.4)^1.4 (0.4 + 0.6 sign(z ds)), s from 0 to 2 over the span; the way loses 0.15 z of it."""
    z, out = 0.0, []
    for d in np.diff(2 * u / span, prepend=2 * u[0] / span):
        for _ in range(4):
            z += d / 4 * (1 - abs(z / 0.4) ** 1.4 * (0.4 + (0.6 if z * d > 0 else -0.6)))
        out.append(z)
    return u - 0.15 * span / 2 * np.array(out)


def many_plays_and_friction(u, span, friction=0.0005, taper=0.0):
    """Forty plays, those of small threshold heavier, and small loops that fade within a twentieth of the span. With a
    ``taper`` plays weigh less by so much at both ends of the span."""
    r = 0.4 * span * np.arange(1, 41) / 40
    at, z, out, last = np.zeros(40), 0.0, [], 0.0
    for v in u:
        at, d, last = np.clip(at, v - r, v + r), v - last, v
        z = np.sign(d) + (z - np.sign(d)) * np.exp(-20 * abs(d) / span)
        level = 2 * at / span - 1
        read = span / 2 * (level - taper * level**3 / 3)
        out.append(0.8 * v + 0.01 * np.exp(-r / (0.2 * span)) @ read - friction * span * z)
    return np.array(out)


def left_share(stage, record):
    """Rms of what the stage leaves of a record that it was not fitted to, of its range."""
    x, model = record.axes["x"].x_um, predict(stage, record).axes["x"].x_um
    return float(np.std(x - model) / np.ptp(x))


@pytest.mark.parametrize(("memory", "most"), [(coleman_hodgdon, 1e-3), (bouc_wen, 3e-3)])
def test_a_memory_that_fades_is_told_from_plays(memory, most):
    """Also where it fades by another law."""
    truth = replace(NO_MODE, memory=memory)
    stage, report = fit(laboratory(truth, RATE_HZ, only=RECORDS))
    assert "fading_hysteresis" in [effect.name for effect in stage.axis("x").effects]
    assert left_share(stage, held_out(truth, RATE_HZ)) < most
    assert "fading" in str(report.time["x"])
    # The width that is told of is that of the whole loop: it was that of the plays beside, 2 of 13 %.
    assert hysteresis_pct(stage.axis("x")) == pytest.approx(opening_pct(memory), rel=0.1)


def test_a_memory_of_many_plays_fades_beside_all_of_them():
    """There were sixteen at most, for which the device had room."""
    found = fit_operator(
        [run_of([0, 8, 0, 8, 0], 1), run_of([0, 6, 2, 5, 3, 4, 0], 2), run_of([0, 3, 1, 7, 5, 6, 4], 3)]
    )
    assert len(found.view.play_r_V) > 16
    assert len(found.fading_r_V) > 0
    assert max(one.rms_um / one.range_um for one in found.records) < 2.2e-5  # noise alone is 1.2e-5


def test_uneven_weights_are_told_beside_what_fades():
    """Each hides the other: of weights that fall off by 0.3 it found 0.23."""
    ways = [0, 8, 0, 8, 0], [0, 6, 2, 5, 3, 4, 0], [0, 3, 1, 7, 5, 6, 4], [0, 2, 0, 8, 6, 8, 0]
    found = fit_operator([run_of(turns_V, seed, friction=0.002, taper=0.3) for seed, turns_V in enumerate(ways)])
    assert len(found.fading_r_V) > 0
    assert found.view.play_taper == pytest.approx(0.3, abs=0.03)


def run_of(turns_V, seed, **memory):
    """A slow way from turn to turn, 400 rows a turn."""
    n = 400 * (len(turns_V) - 1)
    u = np.interp(np.arange(n) / 400, np.arange(len(turns_V)), turns_V)
    x = 10 * many_plays_and_friction(u, 8.0, **memory) + 0.001 * np.random.default_rng(seed).standard_normal(n)
    return AxisRun(np.arange(n) / RATE_HZ, u, x, slice(0, None), "x", str(seed))


def opening_pct(memory):
    """Of the steady loop over the whole span."""
    way = np.linspace(0.0, 1.0, 500)
    loop = memory(np.concatenate([way, way[::-1], way, way[::-1]]), 1.0)
    return 100 * float(np.max(loop[1500:][::-1] - loop[1000:1500]) / np.ptp(loop[1000:]))


def test_a_sensor_that_counts_backwards_shows_the_same_loops():
    truth = replace(NO_MODE, memory=coleman_hodgdon)
    records = laboratory(truth, RATE_HZ, only=RECORDS)
    there, back = (fit([turned(r, sign) for r in records])[0].axis("x") for sign in (1, -1))
    (forward,), (backward,) = ([e for e in axis.effects if e.name == "fading_hysteresis"] for axis in (there, back))
    assert backward.params["reach"] == pytest.approx(forward.params["reach"])
    assert backward.params["width"] == pytest.approx([-width for width in forward.params["width"]])
    assert back.time.gain_um_per_V == pytest.approx(-there.time.gain_um_per_V)


def turned(record, sign):
    axis = record.axes["x"]
    return replace(record, axes={"x": AxisRecord(axis.u_V, sign * axis.x_um)})


def test_none_fade_where_none_are_tried(monkeypatch):
    """As the benchmark that compares the two has it."""
    monkeypatch.setattr(regressors, "FADING", ())
    found = fit_operator([run_of([0, 8, 0, 8, 0], 1), run_of([0, 6, 2, 5, 3, 4, 0], 2)])
    assert len(found.fading_r_V) == 0


def test_plays_that_remember_are_no_fading_ones(plays_memory):
    stage, _ = fit(laboratory(replace(NO_MODE, memory=plays_memory), RATE_HZ, only=RECORDS))
    assert "fading_hysteresis" not in [effect.name for effect in stage.axis("x").effects]


@pytest.fixture
def plays_memory():
    """Ten plays of equal weight, stepped one by one."""

    def memory(u, span):
        r = 0.04 * span * np.arange(1, 11)
        at, out = np.zeros(10), []
        for v in u:
            at = np.clip(at, v - r, v + r)
            out.append(0.8 * v + 0.02 * at.sum())
        return np.array(out)

    return memory
