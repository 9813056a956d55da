"""Records that are not in the model's units, or not of its stage: said, since a base that is refitted hides it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from rig import Rig

from phaselead.errors import BadInput
from phaselead.gap.records import axis_runs
from phaselead.gap.run import run_gap
from phaselead.gap.scale import beside_model, model_doubts, refuse_moved_at_rest, refuse_unlike_model
from phaselead.identify import fit
from phaselead.model import AdoptedEffect, AxisModel, Stage, TimeView, catalogue, predict, range_um, simulate
from phaselead.model.effects.filters import resonant
from phaselead.model.scale import scale_range
from phaselead.record.recording import AxisRecord, Recording
from phaselead.report.gap import gap_page

WAVES = ("multisine0.9", "multisine0.25")


@cache
def records():
    rig = Rig(5, rate_Hz=1000.0)
    each = [[rig.record(u, f"{name}-{kind}") for kind, u in rig.waves(1.0).items()] for name in ("one", "two")]
    return tuple([r for r in part if r.source[4:-4] in WAVES] for part in each)


@cache
def stage():
    return fit(records()[0])[0]


def as_written(part, change):
    """The records with other columns: ``change`` gives voltage and position."""
    return [replace(r, axes={"x": AxisRecord(*change(r.axes["x"].u_V, r.axes["x"].x_um))}, sha256="") for r in part]


def doubts_of(model, train, holdout, reference=()):
    return model_doubts(model, beside_model(model, axis_runs(model, train, holdout, reference)))


def doubts(change, of=(True, True)):
    train, holdout = (as_written(part, change) if off else part for part, off in zip(records(), of, strict=True))
    return doubts_of(stage(), train, holdout)


def test_references_of_a_stage_parked_elsewhere_than_at_0_V_are_asked_about_too():
    """Taken for a step from 0 V in its first row, which rings, every record would be described as badly."""
    view = TimeView(gain_um_per_V=20.0, u_range_V=(0.0, 5.0), rate_Hz=1000.0)
    mode = AdoptedEffect(name="resonance", params={"f_Hz": 60.0, "zeta": 0.002})
    ringing = Stage(name="mode", axes={"x": AxisModel(time=view, effects=(mode,))})

    def parked(seed, wrong_um):
        t_s, noise = np.arange(3000) / 1000.0, np.random.default_rng(seed)
        u_V = np.r_[np.full(1000, 2.0), 2 + np.sin(2 * np.pi * 2 * t_s)]
        long_s = np.arange(-1000 * 20, 3000) / 1000.0
        x_um = simulate(ringing.axis("x"), long_s, np.r_[np.full(19000, 2.0), u_V])[-3000:]
        x_um = x_um + wrong_um * np.sin(3 * u_V[-3000:]) + noise.normal(0, 0.01, 3000)
        return Recording(t_s, {"x": AxisRecord(u_V[-3000:], x_um)}, source=f"of {seed}")

    def said(reference_um, others_um):
        return doubts_of(ringing, [parked(1, others_um)], [parked(2, others_um)], [parked(3, reference_um)])

    assert "were they exchanged?" in said(2.0, 0.0)[0]
    assert said(0.0, 2.0) == []


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda u, x: (u, -x), "move backwards beside the model"),
        (lambda u, x: (1000 * u, x), "move 0.00"),
        (lambda u, x: (u, x / 1000), "move 0.001 times"),
        (lambda u, x: (x, u), "move 0.0"),
    ],
    ids=["turned round", "mV for V", "mm for um", "exchanged"],
)
def test_another_unit_sign_or_column_is_said_in_one_line(change, said):
    line, *beyond = doubts(change)
    assert line.startswith("x: the records")
    assert said in line
    assert "check units, signs and columns" in line
    assert all("beyond that it is a guess" in one for one in beyond)


def test_what_a_stage_can_come_to_is_no_doubt():
    rng = np.random.default_rng(1)
    least, most = scale_range()
    for gain in (1.0, 1.05 * least, 0.95 * most):
        assert doubts(lambda u, x, gain=gain: (u, gain * x)) == []
    assert doubts(lambda u, x: (u, 30 * rng.normal(size=len(x)))) == []  # nothing but noise


def test_records_of_one_part_alone_are_named():
    (line,) = doubts(lambda u, x: (u, -x), of=(False, True))
    assert "the held-out records move backwards" in line


@pytest.mark.parametrize("role", [0, 1])
def test_one_record_that_is_turned_round_among_others_is_named(role):
    """Together with the others of its role it moved neither one way nor the other, and nothing was said."""
    parts = [list(part) for part in records()]
    parts[role][0] = as_written(parts[role][:1], lambda u, x: (u, -x))[0]
    (said,) = doubts_of(stage(), *parts)
    assert said.startswith(f"{parts[role][0].source}: axis x moves backwards")


def test_a_small_record_that_drifts_is_not_asked_about():
    train, holdout = records()
    t = train[0].t_s
    small = Recording(t, {"x": AxisRecord(5 + 0.01 * np.sin(5 * t), 50 - 0.5 * np.sin(5 * t))}, source="small.csv")
    assert doubts_of(stage(), [*train, small], holdout) == []


def test_the_answer_says_it():
    train, holdout = (as_written(part, lambda u, x: (u, -x)) for part in records())
    found = run_gap(stage(), train, holdout, without=tuple(name for name in catalogue() if name != "delay"))
    assert "backwards" in found.doubts[0]
    assert str(found).splitlines()[1].startswith("x: the records move backwards")
    assert found.as_json()["doubts"] == list(found.doubts)
    assert "move backwards beside the model" in gap_page(found, "model.toml").split("<h2>")[0]


def test_every_role_that_is_off_is_said():
    train = as_written(records()[0], lambda u, x: (u, -x))
    holdout = as_written(records()[1], lambda u, x: (u, 1000 * x))
    (line,) = doubts_of(stage(), train, holdout, records()[0])
    assert line.startswith("x: the training and held-out records move backwards beside the model and 1000 times")


def test_a_record_that_moves_while_its_voltage_stands_still_is_refused_by_its_name():
    """It was taken for one at rest, and a vibration and a hum were named."""
    train, holdout = records()
    still = as_written(train[1:], lambda u, x: (np.full_like(u, 5.0), x))
    with pytest.raises(BadInput, match=r"one-multisine0.9.csv: axis x moves \d+ um while its voltage stands still"):
        run_gap(stage(), [train[0], *still], holdout)


@pytest.mark.parametrize("share", [0.15, 0.25])
@pytest.mark.parametrize("shape", [lambda t: np.sin(40 * t) / 2, lambda t: 2 * np.exp(-4 * t)])
def test_what_creeps_at_rest_is_at_rest_and_what_moves_further_is_not(shape, share):
    train, holdout = records()
    t = train[0].t_s - train[0].t_s[0]
    x_um = 50 + 30 * t / t[-1] + share * range_um(stage().axes["x"]) * shape(t)
    x_um[77] = 100.0  # a bad row
    at_rest = Recording(t, {"x": AxisRecord(np.full(len(t), 5.0), x_um)}, source="still.csv")
    runs = axis_runs(stage(), [*train, at_rest], holdout, [])
    if share < 0.2:
        refuse_moved_at_rest(stage(), runs)
    else:
        with pytest.raises(BadInput, match=r"still\.csv: axis x moves"):
            refuse_moved_at_rest(stage(), runs)


def test_a_hold_that_still_rings_of_what_was_before_is_at_rest():
    view = TimeView(gain_um_per_V=20.0, u_range_V=(0.0, 5.0), rate_Hz=1000.0)
    mode = AdoptedEffect(name="resonance", params={"f_Hz": 60.0, "zeta": 0.02})
    ringing = Stage(name="mode", axes={"x": AxisModel(time=view, effects=(mode,))})
    t_s, u_V = np.arange(4000) / 1000.0, np.r_[np.zeros(1000), np.full(3000, 5.0)]
    x_um = simulate(ringing.axis("x"), t_s, u_V)[-4000:]
    hold = Recording(t_s, {"x": AxisRecord(u_V, x_um)}, scored=slice(1000, 4000), source="hold.csv")
    moved = Recording(t_s, {"x": AxisRecord(2 + np.sin(20 * t_s), 20 * (2 + np.sin(20 * t_s)))}, source="moved.csv")
    other = Recording(t_s, {"x": AxisRecord(2 + np.sin(30 * t_s), 20 * (2 + np.sin(30 * t_s)))}, source="other.csv")
    refuse_moved_at_rest(ringing, axis_runs(ringing, [moved, hold], [other], []))


def test_references_that_the_model_describes_worse_than_the_others_may_be_exchanged():
    changed = as_written(records()[0], lambda u, x: (u, x + 0.02 * np.ptp(x) * np.sin(u)))

    def said(reference, others):
        return doubts_of(stage(), others[:1], others[1:], reference)

    (line,) = said(changed, records()[1])
    assert line.startswith("x: of the reference records' motion the model leaves")
    assert "were they exchanged?" in line
    assert said(records()[0], as_written(records()[1], lambda u, x: (u, x + 0.02 * np.ptp(x) * np.sin(u)))) == []
    assert said([], changed) == []
    small = [predict(stage(), r) for r in as_written(records()[0], lambda u, x: (0.01 * u, x))]
    quiet = as_written(small, lambda u, x: (u, x + 0.01 * np.sin(1000 * u)))
    assert said(quiet, records()[1]) == []


def test_quick_references_beside_slow_records_are_not_taken_for_exchanged():
    """The model leaves more of quick records than of slow ones, also of those that it was fitted to."""
    quick = as_written(records()[0], lambda u, x: (u, x + 0.02 * np.ptp(x) * np.sin(u)))
    left = max(float(np.std(r.axes["x"].x_um - predict(stage(), r).axes["x"].x_um)) for r in quick)
    view = stage().axis("x").time

    def said(fit_left_um):
        axis = stage().axis("x").model_copy(update={"time": replace_left(view, fit_left_um)})
        known = stage().model_copy(update={"axes": {"x": axis}})
        return doubts_of(known, records()[1][:1], records()[1][1:], quick)

    assert said(left) == []
    assert "were they exchanged?" in said(left / 10)[0]


def replace_left(view, residual_um_rms):
    """The view of a fit that left so much."""
    return view.model_copy(update={"residual_um_rms": residual_um_rms})


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda u, x: (1000 * u, x), 1e-3),
        (lambda u, x: (u, x / 1000), 1e-3),
        (lambda u, x: (u, x * 1e6), 1e6),
    ],
    ids=["mV for V", "mm for um", "pm for um"],
)
@pytest.mark.parametrize("of", [(True, True), (True, False), (False, True)])
def test_records_in_another_unit_are_refused(change, said, of):
    train, holdout = (as_written(part, change) if off else part for part, off in zip(records(), of, strict=True))
    with pytest.raises(BadInput, match="another unit") as refused:
        run_gap(stage(), train, holdout)
    assert float(str(refused.value).split(" moves ")[1].split()[0]) == pytest.approx(said, rel=0.1)
    assert ("--map" in str(refused.value)) == all(of)
    assert ("log import" in str(refused.value)) != all(of)
    assert ("fit the model to this stage" in str(refused.value)) == all(of)


def test_one_record_in_another_unit_among_others_is_refused_by_its_name():
    train = [records()[0][0], *as_written(records()[0][1:], lambda u, x: (u, x / 1000))]
    with pytest.raises(BadInput, match=train[1].source.split(".")[0]):
        run_gap(stage(), train, records()[1])


@pytest.mark.parametrize("gain_um_per_V", [2000.0, 0.005], ids=["as in another unit", "out of scale"])
def test_exchanged_columns_are_called_that_and_no_unit(gain_um_per_V):
    """Those that moved ten times as far as they should had a doubt, and the steps of the voltage were named
    quantisation of the sensor."""
    t = np.arange(4000) / 1000
    u = 3 - 3 * np.cos(2 * np.pi * 1.5 * t)
    x = 20 * u + np.random.default_rng(3).normal(0, 0.05, len(t))
    made = [Recording(t_s=t, axes={"x": AxisRecord(x, u)}, source="odd"), *records()[1]]
    view = TimeView(gain_um_per_V=gain_um_per_V, u_range_V=(0.0, 10.0), rate_Hz=1000.0)
    model = Stage(name="s", axes={"x": AxisModel(time=view)})
    with pytest.raises(BadInput, match=r"odd: .* voltage and position seem exchanged"):
        refuse_unlike_model(beside_model(model, axis_runs(model, made[:1], made[1:], [])))


def test_motion_behind_a_mode_is_in_no_other_unit():
    """It is as small, and against the voltage."""
    t_s = np.arange(4000) / 1000.0

    def fast(f_Hz: float) -> Recording:
        u_V = 4 + 3 * np.sin(2 * np.pi * f_Hz * t_s)
        x_um = resonant(8 * u_V, 20.0, 0.02, 1e-3)
        return Recording(t_s, {"x": AxisRecord(u_V, x_um)}, slice(2000, 4000), f"{f_Hz}.csv")

    refuse_unlike_model(
        beside_model(stage(), axis_runs(stage(), [fast(5.0), fast(200.0)], [fast(60.0), fast(450.0)], []))
    )


def test_what_a_monitor_sees_of_another_axis_is_no_drive():
    """Its axis moves by cross-talk, of which its own voltage knows nothing."""
    both = Stage(name="two axes", axes={"x": stage().axes["x"], "y": stage().axes["x"]})

    def beside(record: Recording) -> Recording:
        x = record.axes["x"]
        y = AxisRecord(1e-6 * x.u_V, 0.04 * x.x_um)
        return replace(record, axes={"x": x, "y": y})

    train, holdout = ([beside(record) for record in part] for part in records())
    refuse_unlike_model(beside_model(both, axis_runs(both, train, holdout, [])))


@pytest.mark.parametrize("factor", [2.0, 0.5, -1.0])
def test_a_held_out_record_that_is_nothing_like_the_others_is_never_nothing(factor):
    (first, *train), (other, *_) = records()
    holdout = as_written([other], lambda u, x: (u, factor * x))
    found = run_gap(stage(), train, holdout, [first], without=tuple(name for name in catalogue() if name != "delay"))
    assert "unknown" in found.verdicts
    assert any(line.startswith(f"{other.source}: of its motion the model") for line in found.doubts)
    assert f"{other.source}: of its motion" in gap_page(found, "model.toml").split("<h2>")[0]


@pytest.mark.parametrize("factor", [5.0, -1.0])
def test_a_training_record_that_is_nothing_like_the_others_is_never_nothing(factor):
    """Of which the held-out ones know nothing: the model describes them as it did."""
    (first, only), holdout = records()
    train = as_written([only], lambda u, x: (u, factor * x))
    found = run_gap(stage(), train, holdout, [first], without=tuple(name for name in catalogue() if name != "delay"))
    assert "unknown" in found.verdicts
    assert any(line.startswith(f"{only.source}: of its motion the model") for line in found.doubts)


@pytest.mark.parametrize("way", ["back in time", "the other way"])
def test_a_training_record_that_no_stage_makes_is_never_nothing_without_references_either(way):
    """The held-out ones are described as they were: that ended as none, with the doubt beside it or without one."""
    train, holdout = records()
    first, *others = train
    train = [*others, *as_written([first], lambda u, x: (u, x[::-1] if way == "back in time" else -x))]
    found = run_gap(stage(), train, holdout, without=tuple(name for name in catalogue() if name != "delay"))
    assert "unknown" in found.verdicts
    assert any(
        f"is left of {train[-1].source}, far more than of what the model was fitted to" in line
        for line in found.messages
    )


def test_a_held_out_record_that_is_like_the_others_raises_no_doubt():
    (first, *train), holdout = records()
    found = run_gap(stage(), train, holdout, [first], without=tuple(name for name in catalogue() if name != "delay"))
    assert found.verdicts == ("none",)
    assert found.doubts == ()


@pytest.mark.parametrize("factor", [1.0, 1.006])
def test_large_held_out_records_are_judged_by_what_the_fit_left_where_only_small_ones_train(factor):
    """Without reference records a small record to train says nothing of what the base leaves of a large one."""
    train = [r for r in records()[0] if r.source.endswith("0.25.csv")]
    (other,) = (r for r in records()[1] if r.source.endswith("0.9.csv"))
    holdout = as_written([other], lambda u, x: (u, factor * x))
    found = run_gap(stage(), train, holdout, without=tuple(name for name in catalogue() if name != "delay"))
    told = [
        line
        for line in found.messages
        if f"is left of {other.source}, far more than of what the model was fitted to" in line
    ]
    assert found.verdicts == (("none",) if factor == 1 else ("unknown",))
    assert len(told) == (factor != 1)
