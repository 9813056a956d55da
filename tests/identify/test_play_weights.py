"""``fit`` on stages whose plays weigh more at some levels than at others; equations of their own."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from any_stage import NO_MODE, held_out, laboratory

from phaselead.errors import BadInput
from phaselead.identify.fit_result import FitResult
from phaselead.identify.fitting import fit
from phaselead.model.prediction import predict
from phaselead.model.stage_file import load_stage, save_stage
from phaselead.record.recording import AxisRecord
from trials import in_trials

RATE_HZ = 2500.0
RECORDS = ("sine", "small sine", "steps", "multisine")
LEVELS = 4001


def plays_read_by(weight):
    """Ten plays, stepped one by one; where each stands is looked up in the sum of the weights (of -1 to 1) below it."""

    def memory(u, span):
        levels = np.linspace(-0.5, 1.5, LEVELS)
        below = np.cumsum([weight(2 * level - 1) for level in levels]) * (levels[1] - levels[0]) * span
        r = 0.04 * span * np.arange(1, 11)
        at, out = np.zeros(10), []
        for volt in u:
            at = np.clip(at, volt - r, volt + r)
            out.append(0.8 * volt + 0.02 * np.interp(at / span, levels, below).sum())
        return np.array(out) - 0.2 * np.interp(0.0, levels, below)

    return memory


def bell(s):
    """Half as much at the ends as in the middle."""
    return math.exp(-math.log(2) * s**2)


def rising(s):
    return 1 + 0.4 * max(-1.0, min(s, 1.0))


def even(_):
    return 1.0


def stage_of(weight):
    return replace(NO_MODE, memory=plays_read_by(weight))


def records_of(weight):
    return laboratory(stage_of(weight), RATE_HZ, only=RECORDS)


def held_out_um(stage, weight):
    """Rms that the stage leaves of a record that it was not fitted to."""
    record = held_out(stage_of(weight), RATE_HZ)
    return float(np.std(record.axes["x"].x_um - predict(stage, record).axes["x"].x_um))


AT = np.array([-0.5, 0.0, 0.5])
"""Levels, from -1 to 1: beyond half-way to the ends only small plays come."""


def weights(stage):
    """At these levels, of that in the middle."""
    density = stage.axis("x").time.density
    low, high = density.span_V
    return density.at((low + high) / 2 + AT * (high - low) / 2)


@pytest.mark.parametrize("weight", [bell, *in_trials(rising)])
def test_uneven_weights_are_found_and_predict(weight):
    stage, report = fit(records_of(weight))
    assert weights(stage) == pytest.approx([weight(s) for s in AT], abs=0.03)
    view = stage.axis("x").time
    assert "play weights" in str(report.time["x"])
    assert "play_tilt" in " ".join(report.messages)
    of_axis = report.as_dict()["axes"]["x"]
    assert (of_axis["play_tilt"], of_axis["play_taper"]) == (view.play_tilt, view.play_taper)
    alike = fit(records_of(even))[0]
    assert held_out_um(stage, weight) < 1.3 * held_out_um(alike, even)


def test_plays_of_one_weight_stay_so():
    view = fit(records_of(even))[0].axis("x").time
    assert view.density.is_even


def test_loops_of_one_size_tell_none():
    (record,) = laboratory(stage_of(rising), RATE_HZ, only=("sine",))
    assert fit([record])[0].axis("x").time.density.is_even


def test_a_sensor_turned_round_shows_the_same_weights():
    records = records_of(rising)
    turned = [replace(r, axes={"x": AxisRecord(r.axes["x"].u_V, -r.axes["x"].x_um)}) for r in records]
    assert weights(fit(turned)[0]) == pytest.approx(weights(fit(records)[0]), abs=0.01)


def test_a_stage_file_keeps_them(tmp_path):
    stage, _ = fit(records_of(bell))
    save_stage(tmp_path / "bell.toml", stage)
    again = load_stage(tmp_path / "bell.toml")
    assert again.axis("x").time.play_taper == pytest.approx(stage.axis("x").time.play_taper)


def test_weights_that_nearly_vanish_are_refused_in_one_line(tmp_path):
    path = tmp_path / "stage.toml"
    save_stage(path, fit(records_of(bell))[0])
    text = path.read_text()
    path.write_text("\n".join("play_tilt = 0.9" if "play_tilt" in line else line for line in text.splitlines()))
    with pytest.raises(BadInput, match=r"play_tilt = 0.9 and play_taper .*smaller"):
        load_stage(path)


def test_the_figure_of_a_fit_is_drawn_from_where_its_records_began():
    """What the page shows of a record is what the fit left of it: it began micrometres off."""
    whole = held_out(stage_of(even), RATE_HZ)
    late = round(0.6 * RATE_HZ)
    cut = replace(
        whole,
        t_s=whole.t_s[:-late],
        axes={"x": AxisRecord(whole.axes["x"].u_V[late:], whole.axes["x"].x_um[late:])},
        source="cut",
    )
    records = [*records_of(even), cut]
    stage, report = fit(records)
    result = FitResult(model=stage, report=report, records=tuple(records))
    left = next(one for one in report.time["x"].records if one.source == "cut")
    error_um = cut.axes["x"].x_um - result.predicted_um(cut, "x")
    assert left.turned_V is not None
    assert np.std(error_um[cut.scored]) < 2 * left.rms_um
