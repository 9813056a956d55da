"""``fit`` on stages whose plays answer to a field that rises unevenly, and on such as only bend behind them; equations
of their own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from any_stage import LEAD_S, NO_MODE, held_out, laboratory

from phaselead.device.encode_model import inverse_refusal
from phaselead.gap.residual import left_um
from phaselead.identify.fitting import fit
from phaselead.model.axis import Limits
from phaselead.model.prediction import predict
from phaselead.model.stage_file import Stage
from phaselead.record.recording import AxisRecord
from trials import in_trials

RATE_HZ = 2500.0
RECORDS = ("sine", "small sine", "steps", "multisine")


def plays(u, span):
    """Ten of equal weight, stepped one by one; a loop of about a tenth of the travel."""
    r = 0.04 * span * np.arange(1, 11)
    at, out = np.zeros(10), []
    for volt in u:
        at = np.clip(at, volt - r, volt + r)
        out.append(0.8 * volt + 0.02 * at.sum())
    return np.array(out)


def plays_of(bend):
    """Of a field with its parabola over the span from 0 V; s is -1 to 1."""

    def memory(u, span):
        s = 2 * np.asarray(u) / span - 1
        return plays(u + bend * span / 2 * (s**2 - 1), span)

    return memory


def plays_and_curve(u, span):
    """The same parabola behind the plays, which feel nothing of it."""
    s = 2 * np.asarray(u) / span - 1
    return plays(u, span) + 0.05 * span / 2 * (s**2 - 1)


def bend_of(stage):
    """Of the field; 0 where it rises evenly."""
    return stage.axis("x").time.field_bend


def held_out_um(stage, truth):
    """Rms that the stage leaves of a record that it was not fitted to."""
    record = held_out(truth, RATE_HZ)
    return float(np.std(record.axes["x"].x_um - predict(stage, record).axes["x"].x_um))


def turned(record):
    axis = record.axes["x"]
    return replace(record, axes={"x": AxisRecord(axis.u_V, -axis.x_um)})


EVEN = replace(NO_MODE, memory=plays)


@pytest.mark.parametrize("bend", [0.06, *in_trials(-0.1, -0.03, 0.12)])
def test_a_bend_of_the_field_is_found_and_predicts(bend):
    truth = replace(NO_MODE, memory=plays_of(bend))
    stage, report = fit(laboratory(truth, RATE_HZ, only=RECORDS))
    assert bend_of(stage) == pytest.approx(bend, abs=0.01)
    assert "field bend" in str(report.time["x"])
    assert "field_bend" in " ".join(report.messages)
    assert report.as_dict()["axes"]["x"]["field_bend"] == bend_of(stage)
    assert held_out_um(stage, truth) < 1.3 * held_out_um(fit(laboratory(EVEN, RATE_HZ, only=RECORDS))[0], EVEN)


@pytest.mark.parametrize("memory", [plays, plays_and_curve])
def test_a_field_that_rises_evenly_has_none(memory):
    """Also where the motion bends behind it."""
    stage, _ = fit(laboratory(replace(NO_MODE, memory=memory), RATE_HZ, only=RECORDS))
    assert bend_of(stage) == 0


@pytest.mark.parametrize("first", [0, 800, 2100])
def test_loops_of_one_size_tell_no_bend(first):
    """What else may make a loop uneven does so there too; wherever the record begins."""
    (record,) = laboratory(replace(NO_MODE, memory=plays_of(0.1)), RATE_HZ, only=("sine",))
    u, x = (values[first:] for values in (record.axes["x"].u_V, record.axes["x"].x_um))
    cut = replace(record, t_s=record.t_s[: len(u)], axes={"x": AxisRecord(u, x)})
    assert bend_of(fit([cut])[0]) == 0


@pytest.mark.parametrize("shift_V", [-5.0, -3.0, 20.0])
def test_it_is_the_same_wherever_0_V_is(shift_V):
    """Records that begin behind their full loop, where the stage comes from the other end."""
    truth = replace(NO_MODE, memory=plays_of(0.1))
    records = laboratory(truth, RATE_HZ, only=RECORDS)
    moved = [behind_loop(record, shift_V) for record in records]
    stage, _ = fit(moved)
    view = stage.axis("x").time
    assert view.u_range_V[0] == pytest.approx(shift_V)
    assert bend_of(stage) == pytest.approx(0.1 * np.ptp(view.u_range_V) / truth.span_V, abs=0.015)
    assert left_um(Stage(name="rig", axes=stage.axes), moved) < 0.002 * 100
    assert inverse_refusal(stage.axis("x").model_copy(update={"limits": wide(view)})) is None


def behind_loop(record, shift_V):
    """The record from where its full loop ends, other voltages for the same field."""
    u, x = (values[round(LEAD_S * RATE_HZ) :] for values in (record.axes["x"].u_V, record.axes["x"].x_um))
    return replace(record, t_s=record.t_s[: len(u)], axes={"x": AxisRecord(u + shift_V, x)})


def wide(view):
    """Limits as wide as the voltages of the fit."""
    low, high = view.u_range_V
    return Limits(u_min_V=low, u_max_V=high, u_park_V=low)


def test_a_sensor_turned_round_shows_the_same_bend():
    records = laboratory(replace(NO_MODE, memory=plays_of(0.08)), RATE_HZ, only=RECORDS)
    there, back = fit(records)[0], fit([turned(record) for record in records])[0]
    assert bend_of(back) == pytest.approx(bend_of(there), abs=1e-3)


def test_what_went_before_a_record_is_told_in_volts_that_were_asked_for():
    """A record from mid-range after a turn at the top: the turn is that of the voltage, not of the field."""
    truth = replace(NO_MODE, memory=plays_of(0.1))
    records = laboratory(truth, RATE_HZ, only=("sine", "steps", "multisine"))
    late = held_out(truth, RATE_HZ)
    u, x = late.axes["x"].u_V, late.axes["x"].x_um
    top = int(np.argmax(u[: len(u) // 2]))
    start = top + int(np.argmax(u[top:] < (u[top] + u.min()) / 2))
    cut = replace(
        late, t_s=late.t_s[start:] - late.t_s[start], axes={"x": AxisRecord(u[start:], x[start:])}, source="cut"
    )
    _, report = fit([*records, cut])
    (told,) = (record.turned_V for record in report.time["x"].records if record.source == "cut")
    assert told
    assert told[0] == pytest.approx(u[top], abs=0.03 * np.ptp(u))
