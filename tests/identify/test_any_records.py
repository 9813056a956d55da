"""``fit`` on what a laboratory hands over: slow and fast, loops in front, idle, any range, rate and sign."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from any_stage import (
    NO_MODE,
    ONE_MODE,
    AnyStage,
    Array,
    bouc_wen,
    full_loop,
    held_out,
    laboratory,
    multisine,
    ramp,
    record_of,
    slow_sine,
    steps,
)

from phaselead.errors import BadInput
from phaselead.identify.fitting import _duration, fit
from phaselead.identify.modal import measured_response
from phaselead.identify.operator import OperatorFit
from phaselead.identify.runs import driven_runs
from phaselead.model.axis import LONGEST_DELAY_S
from phaselead.model.effects.filters import resonant
from phaselead.model.prediction import predict
from phaselead.model.stage_file import Stage, parse_stage, stage_text
from phaselead.record.recording import AxisRecord, Recording
from trials import in_trials

RATE_HZ, COARSE_HZ = 5000.0, 2500.0
QUICK = ("small sine", "steps", "multisine")


def left_um(stage: Stage, recording: Recording) -> float:
    """Rms of what the stage leaves, the record's own offset aside."""
    x, model = recording.axes["x"].x_um, predict(stage, recording).axes["x"].x_um
    assert x is not None
    assert model is not None
    return float(np.std(x - model))


def modes_of(stage: Stage) -> list[tuple[float, float, float]]:
    """Share, Hz and damping of every adopted mode."""
    found = []
    for effect in (effect for effect in stage.axis("x").effects if effect.name == "resonance"):
        f_Hz, zeta = (np.atleast_1d(effect.params[key]) for key in ("f_Hz", "zeta"))
        found += list(zip(np.atleast_1d(effect.params.get("c", 1.0)), f_Hz, zeta, strict=True))
    return found


def changed(
    r: Recording,
    u: Callable[[Array], Array] = lambda u: u,
    x: Callable[[Array], Array] = lambda x: x,
    late_s: float = 0,
) -> Recording:
    axis = r.axes["x"]
    return replace(r, t_s=r.t_s + late_s, axes={"x": AxisRecord(u(axis.u_V), x(axis.x_um))})


MECHANICS = {
    "none": (),
    "one mode": ((1.0, 430.0, 0.036),),
    "two modes": ((0.8, 210.0, 0.02), (0.2, 480.0, 0.03)),
    "zeros above": ((0.15, 300.0, 0.02),),
    "zeros between": ((1.3, 200.0, 0.02), (-0.3, 350.0, 0.02)),
    "hardly damped": ((1.0, 330.0, 0.005),),
    "well damped": ((1.0, 300.0, 0.3),),
    "slow": ((1.0, 69.0, 0.02),),
}


@pytest.mark.parametrize(
    "mechanics",
    [
        "none",
        "one mode",
        "two modes",
        *in_trials("zeros above", "zeros between", "hardly damped", "well damped", "slow"),
    ],
)
def test_operator_modes_and_delay_are_found_together(mechanics):
    """Down to the noise of 11 nm, on 100 um."""
    modes = MECHANICS[mechanics]
    stage = replace(NO_MODE, modes=modes, delay_s=1 / COARSE_HZ)
    fitted, report = fit(laboratory(stage, COARSE_HZ, only=QUICK))
    found = modes_of(fitted)
    assert len(found) == len(modes)
    assert {effect.name for effect in fitted.axis("x").effects} <= {"resonance"}  # no lag is made up
    for one, true in zip(found, modes, strict=True):
        assert one == pytest.approx(true, rel=0.02)
    assert fitted.axis("x").time.delay_s == pytest.approx(stage.delay_s, abs=1e-5)
    assert left_um(fitted, held_out(stage, COARSE_HZ)) < 0.03
    if modes:
        assert any("a mode at" in line for line in report.messages)
    else:
        (up_to,) = (
            one for one in (re.search(r"shows no mode up to (\d+) Hz", line) for line in report.messages) if one
        )
        assert float(up_to[1]) > 600  # the multisine ends there; steps drive more


def test_a_lag_whose_interval_holds_none_stays_in_the_delay(monkeypatch):
    monkeypatch.setattr(OperatorFit, "lag_ci95_s", (0.0, 6e-4))
    fitted, _ = fit(laboratory(replace(ONE_MODE, delay_s=3.6e-4, lag_s=3e-4), RATE_HZ, only=QUICK))
    assert {effect.name for effect in fitted.axis("x").effects} == {"resonance"}
    assert fitted.axis("x").time.delay_s == pytest.approx(6.6e-4, rel=0.1)


@pytest.mark.parametrize("lag_s", [3e-4, *in_trials(6e-5)])
def test_an_amplifier_s_lag_is_told_from_the_delay(lag_s):
    """Behind a delay of less than a row a lag of much less than a row is the same at every row: this one is longer."""
    stage = replace(ONE_MODE, delay_s=3.6e-4, lag_s=lag_s)
    fitted, report = fit(laboratory(stage, RATE_HZ, only=QUICK))
    (lag,) = [effect for effect in fitted.axis("x").effects if effect.name != "resonance"]
    assert (lag.name, lag.status) == ("amplifier_lowpass", "provisional")
    assert lag.params["tau_s"] == pytest.approx(lag_s, rel=0.05)
    (line,) = [line for line in report.lines() if "a lag of" in line]
    assert re.search(r"a lag of \d+(\.\d+)? us \+- \d\.?\d* us beside the delay", line), line
    assert "of amplifier or sensor: the records do not tell which" in line
    found = report.time["x"]
    (std_s,) = found.std["lag_s"]
    assert 0 < std_s < 0.05 * lag_s
    assert re.search(r"^lag  .* \+- .* ms$", str(found), re.MULTILINE)
    low_s, high_s = lag.ci95["tau_s"]
    assert (high_s - low_s) / 2 == pytest.approx(1.96 * std_s)
    assert 0.01 < lag.share < 1
    (chosen,) = [choice for choice in found.choices if choice.chosen]
    noise = sum((stage.noise_um / record.range_um) ** 2 for record in found.records) ** 0.5
    assert chosen.left_out < noise  # the size was chosen behind the lag
    assert fitted.axis("x").time.delay_s == pytest.approx(stage.delay_s, abs=5e-6)
    assert left_um(fitted, held_out(stage, RATE_HZ)) < 0.02


@pytest.mark.parametrize(("time_s", "words"), [(5.2e-5, "52 us"), (3e-4, "300 us"), (9.999e-4, "1 ms"), (5e-3, "5 ms")])
def test_a_lag_is_said_in_three_digits(time_s, words):
    assert _duration(time_s) == words


def test_every_record_of_the_laboratory_is_used():
    """Ramp, idle stretch and small sine after a full loop too, two of six in another session."""
    records = [
        changed(r, x=lambda x, i=i: x + 5.0 * (i in (1, 4))) for i, r in enumerate(laboratory(ONE_MODE, RATE_HZ))
    ]
    fitted, report = fit(records)
    assert report.left_out == []
    assert {r.source for r in report.time["x"].records} == {r.source for r in records}
    assert left_um(fitted, held_out(ONE_MODE, RATE_HZ)) < 0.02
    assert all(r.rms_um < 0.02 for r in report.time["x"].records)


@pytest.mark.trial
def test_a_memory_that_no_operator_follows_hides_no_mode():
    """Bouc-Wen loops do not close; what is left is theirs, and no more with a mode than without."""
    without, _ = fit(laboratory(replace(NO_MODE, memory=bouc_wen), RATE_HZ, only=QUICK))
    fitted, _ = fit(laboratory(replace(ONE_MODE, memory=bouc_wen), RATE_HZ, only=QUICK))
    ((_, f_Hz, _),) = modes_of(fitted)
    assert f_Hz == pytest.approx(430.0, rel=0.01)
    assert fitted.axis("x").time.residual_um_rms < 1.2 * without.axis("x").time.residual_um_rms


@pytest.mark.parametrize("delay_s", [1e-3, *in_trials(2e-2)])
def test_a_delay_of_many_periods_is_found(delay_s):
    stage = replace(ONE_MODE, delay_s=delay_s)
    fitted, _ = fit(laboratory(stage, COARSE_HZ, only=QUICK))
    assert fitted.axis("x").time.delay_s == pytest.approx(delay_s, abs=1e-5)


@pytest.mark.parametrize(
    ("rate_Hz", "span_V", "um_per_V"), [(200.0, 5.0, 0.4), (1000.0, 800.0, 1.0), *in_trials((50e3, 10.0, 10.0))]
)
def test_any_rate_and_range(rate_Hz, span_V, um_per_V):
    """2 um of 5 V at 200 Hz, 800 um of 800 V at 1 kHz, 50 kHz; the mode at a tenth of the rate or 430 Hz."""
    f_Hz = min(rate_Hz / 12, 430.0)
    stage = AnyStage(((1.0, f_Hz, 0.036),), um_per_V, span_V, 0.4 / rate_Hz, 1e-4 * um_per_V * span_V)
    top_Hz = 1.6 * f_Hz
    waves = {
        "steps": steps(span_V, rate_Hz, max(0.008, 2 / rate_Hz)),
        "multisine": multisine(span_V, rate_Hz, top_Hz=top_Hz),
    }
    seconds = 0.8 if rate_Hz > 10e3 else 2.0
    records = [
        record_of(stage, np.concatenate([full_loop(span_V, rate_Hz), u[: round(seconds * rate_Hz)]]), rate_Hz, i, name)
        for i, (name, u) in enumerate(waves.items())
    ]
    fitted, _ = fit(records)
    ((_, found_Hz, zeta),) = modes_of(fitted)
    assert (found_Hz, zeta) == pytest.approx((f_Hz, 0.036), rel=0.03)
    assert fitted.axis("x").time.residual_um_rms < 1e-3 * um_per_V * span_V


@pytest.mark.parametrize("only", [("sine", "ramp", "idle"), ("sine",)])
def test_what_nothing_drives_is_not_found_and_said(only):
    """A line that is clear by chance beyond the mode, or a harmonic, does not say that there is none."""
    fitted, report = fit(laboratory(ONE_MODE, RATE_HZ, only=only))
    assert modes_of(fitted) == []
    said = next(line for line in report.messages if "no mode" in line)
    up_to = re.search(r"shows no mode up to (\d+) Hz", said)
    assert float(up_to[1]) < 0.7 * 430 if up_to else "driven at too few frequencies" in said


@pytest.fixture(scope="module")
def few() -> list[Recording]:
    return laboratory(ONE_MODE, COARSE_HZ, only=("sine", "steps", "multisine"))


@pytest.fixture(scope="module")
def judged() -> Recording:
    return held_out(ONE_MODE, COARSE_HZ)


def answer(records: list[Recording], judged: Recording) -> Array:
    x = predict(fit(records)[0], judged).axes["x"].x_um
    assert x is not None
    return x


@pytest.fixture(scope="module")
def plain(few, judged) -> Array:
    return answer(few, judged)


@pytest.mark.parametrize(
    ("u", "x", "late_s"),
    [(1e-3, 1.0, 0.0), (1.0, -1.0, 0.0), *in_trials((1.0, 1e3, 0.0), (-1.0, 1.0, 0.0), (1.0, 1.0, 1e4))],
    ids=["kV", "sensor counts backwards", "nm", "voltage turned round", "later"],
)
def test_units_signs_and_time_do_not_matter(few, judged, plain, u, x, late_s):
    """0.1 % of the range at most."""

    def seen(record):
        return changed(record, lambda volts: u * volts, lambda um: x * um, late_s)

    found = answer([seen(r) for r in few], seen(judged)) / x
    assert np.std(found - plain) < 1e-3 * np.ptp(plain)


def test_the_order_of_records_does_not_matter(few, judged, plain):
    assert np.std(answer(few[::-1], judged) - plain) < 1e-4 * np.ptp(plain)


@pytest.mark.parametrize(("which", "at_s"), [(1, 2.0), *in_trials((0, 2.3), (2, 2.5))])
def test_a_record_cut_in_two_shows_the_same(few, judged, plain, which, at_s):
    """Even where the second part begins in motion, with a memory that it must tell by itself: 0.1 % of the range."""
    rows = round(COARSE_HZ * at_s)
    whole = few[which]
    axis = whole.axes["x"]
    parts = [
        replace(whole, t_s=whole.t_s[part], axes={"x": AxisRecord(axis.u_V[part], axis.x_um[part])}, source=name)
        for name, part in (("first part", slice(0, rows)), ("second part", slice(rows, None)))
    ]
    found = answer([*parts, *(r for r in few if r is not whole)], judged)
    assert np.std(found - plain) < 1e-3 * np.ptp(plain)


def test_what_cannot_be_used_is_left_out_and_said(few):
    still = changed(few[0], u=lambda u: np.full_like(u, 2.0))
    clipped = replace(changed(few[0], x=lambda x: np.minimum(x, 50.0)), source="the clipped one")
    stage, report = fit([*few, replace(still, source="the idle one", sha256="f" * 64), clipped])
    assert len(report.left_out) == 2
    assert all("\n" not in line for line in report.left_out)
    assert any("the idle one" in line and "never moves" in line for line in report.left_out)
    assert any("the clipped one" in line for line in report.left_out)
    assert sum(line.startswith("left out: the ") for line in report.lines()) == 2
    assert report.as_dict()["left_out"] == report.left_out
    assert stage.provenance.left_out == tuple(report.left_out)
    assert "f" * 64 not in {source.sha256 for source in stage.provenance.data}
    assert parse_stage(stage_text(stage)) == stage
    with pytest.raises(BadInput, match="never moves"):
        fit([still])


@pytest.mark.parametrize(("u", "x"), [(1000.0, 1.0), (1.0, 1e-3), (1.0, 1e6)], ids=["mV", "mm", "pm"])
@pytest.mark.parametrize("which", [0, -1])
def test_a_record_in_another_unit_is_refused_by_its_name(few, u, x, which):
    odd = changed(few[which], lambda u_V: u * u_V, lambda x_um: x * x_um)
    records = [odd if r is few[which] else r for r in few]
    with pytest.raises(BadInput, match="another unit") as refused:
        fit(records)
    assert str(refused.value).startswith(odd.source)


@pytest.mark.parametrize("factor", [0.05, -1.0, *in_trials(10.0)])
@pytest.mark.parametrize("which", [-1, *in_trials(0)])
def test_a_record_that_moves_as_no_other_does_is_named(few, factor, which):
    odd = replace(changed(few[which], x=lambda x_um: factor * x_um), source="the odd one")
    _, report = fit([odd if r is few[which] else r for r in few])
    (line,) = [line for line in report.messages if "about as slowly" in line]
    assert line.startswith("axis x: the odd one moves ")
    assert not any("about as slowly" in line for line in fit(few)[1].messages)


@pytest.mark.parametrize("which", [2, *in_trials(0, 1, 3, 4)])
def test_a_record_of_another_stage_is_named_however_quick(which):
    """Its gain is half as large again, which a mode may well make of it."""
    records = laboratory(ONE_MODE, COARSE_HZ)
    odd = replace(changed(records[which], x=lambda x_um: 1.5 * x_um), source="the odd one")
    _, report = fit([odd if r is records[which] else r for r in records])
    (line,) = [line for line in report.messages if "is it of this stage" in line]
    assert line.startswith("axis x: beside the odd one the fit leaves ")
    assert not any("is it of this stage" in line for line in fit(records)[1].messages)


@pytest.mark.parametrize("shifted_s", [0.3, None])
def test_a_voltage_that_does_not_drive_the_position_is_doubted(few, shifted_s):
    """A model that leaves a third of the range was written without a word. None: the rows run back in time, whose loop
    no play has."""
    (record,) = (r for r in few if r.source == "sine")

    def moved(x_um):
        return x_um[::-1] if shifted_s is None else np.roll(x_um, round(COARSE_HZ * shifted_s))

    for odd, doubted in ((changed(record, x=moved), True), (record, False)):
        _, report = fit([odd])
        assert any("does this voltage drive this position" in line for line in report.messages) == doubted


def test_times_in_milliseconds_beside_seconds_are_asked_about(few):
    late = replace(few[1], t_s=1e3 * few[1].t_s)
    for records in ([few[0], late], [late, few[0]]):
        with pytest.raises(BadInput, match="are its times in ms"):
            fit(records)


def sweep(level_V: float, to_Hz: float, seconds: float = 4.0) -> Array:
    """Rising slowly to mid-range, standing there, and then sweeping about it from 5 Hz on."""
    t = np.arange(round(seconds * COARSE_HZ)) / COARSE_HZ
    up = np.linspace(0, 0.5 * ONE_MODE.span_V, round(COARSE_HZ))
    swept = level_V * np.sin(2 * np.pi * (5 * t + (to_Hz - 5) * t**2 / (2 * seconds)))
    return np.concatenate([up, np.full(round(COARSE_HZ / 2), up[-1]), up[-1] + swept])


def scan(span_V: float, f_Hz: float = 17.0, seconds: float = 4.0) -> Array:
    """A triangle over most of the range, as of the lines of an image."""
    phase = np.arange(round(seconds * COARSE_HZ)) / COARSE_HZ * f_Hz % 1
    return span_V * (0.9 - 0.8 * np.abs(2 * phase - 1))


@pytest.mark.parametrize("level", [0.002, *in_trials(0.01)])
@pytest.mark.parametrize("stands", [True, *in_trials(False)])
def test_a_small_sweep_through_the_mode_is_heard_beside_large_slow_records(level, stands):
    """As a laboratory keeps a mode from ringing; ``stands``: its record begins where the stage already stood."""
    stage = replace(ONE_MODE, modes=((1.0, 430.0, 0.01),))
    quick = record_of(stage, sweep(level * stage.span_V, 600.0), COARSE_HZ, 7, "sweep")
    if stands:
        quick = later(quick, 1.25)
    slow = laboratory(stage, COARSE_HZ, only=("sine", "ramp"))
    fitted, _ = fit([*slow, record_of(stage, scan(stage.span_V), COARSE_HZ, 8, "scan"), quick])
    ((_, f_Hz, zeta),) = modes_of(fitted)
    assert f_Hz == pytest.approx(430.0, rel=2e-3)
    assert zeta == pytest.approx(0.01, rel=0.1)


@pytest.mark.parametrize("only", [("sine", "ramp"), *in_trials((("sine", "ramp", "small sine"),))])
def test_a_small_sweep_turned_round_is_named(only):
    """The fit of all bends to it, and leaves more of every other record."""
    slow = laboratory(ONE_MODE, COARSE_HZ, only=only)
    quick = later(record_of(ONE_MODE, sweep(0.01 * ONE_MODE.span_V, 600.0), COARSE_HZ, 7, "sweep"), 1.25)
    turned = replace(changed(quick, x=lambda x_um: -x_um), source="the odd one")
    (line,) = [line for line in fit([*slow, turned])[1].messages if "is it of this stage" in line]
    assert line.startswith("axis x: beside the odd one the fit leaves ")
    assert not any("is it of this stage" in line for line in fit([*slow, quick])[1].messages)


@pytest.mark.parametrize("noise_um", [0.1, 1.0, 10.0])
def test_a_noisy_record_takes_no_line_from_the_others(noise_um):
    """A run counts by what is left of it: the response to a small sweep stays as clear beside any large record."""
    quick = record_of(ONE_MODE, sweep(0.01 * ONE_MODE.span_V, 600.0), COARSE_HZ, 7, "sweep")
    large = record_of(ONE_MODE, scan(ONE_MODE.span_V), COARSE_HZ, 8, "scan")
    noisy = changed(large, x=lambda x_um: x_um + np.random.default_rng(9).normal(0, noise_um, len(x_um)))
    alone, beside = (
        measured_response([driven_runs(r)[0]["x"] for r in records]).unbroken for records in ([quick], [quick, noisy])
    )
    assert alone.f_Hz[-1] > 550
    heard = np.isin(alone.f_Hz, beside.f_Hz)
    assert heard[alone.f_Hz > 20].mean() > 0.98


def test_a_short_record_does_not_take_the_response_over():
    """Of one window, that its own response meets exactly, whatever the noise."""
    quick = record_of(ONE_MODE, sweep(0.01 * ONE_MODE.span_V, 600.0), COARSE_HZ, 7, "sweep")
    short = changed(later(quick, 4.6), x=lambda x_um: x_um + np.random.default_rng(9).normal(0, 3, len(x_um)))
    alone, beside = (
        measured_response([driven_runs(r)[0]["x"] for r in records]) for records in ([quick], [quick, short])
    )
    both = np.intersect1d(alone.f_Hz, beside.f_Hz)
    before, after = (one.value[np.isin(one.f_Hz, both)] for one in (alone, beside))
    assert len(both) > 0.9 * len(alone.f_Hz)
    assert np.median(np.abs(after / before - 1)) < 0.1


def later(r: Recording, seconds: float) -> Recording:
    """The record without its first seconds."""
    first, axis = round(seconds * r.rate_Hz), r.axes["x"]
    assert axis.u_V is not None
    assert axis.x_um is not None
    return replace(r, t_s=r.t_s[first:], axes={"x": AxisRecord(axis.u_V[first:], axis.x_um[first:])})


def test_of_two_records_none_is_the_odd_one(few):
    pair = [few[0], changed(few[1], x=lambda x_um: 1.5 * x_um)]
    assert not any("is it of this stage" in line for line in fit(pair)[1].messages)


def test_a_record_behind_a_mode_is_no_odd_one():
    t = np.arange(4000) / 2000
    made = []
    for i, f_Hz in enumerate((10.0, 12.0, 15.0, 90.0)):
        u = 5 + 2 * np.sin(2 * np.pi * f_Hz * t)
        x = 20 * resonant(u, 60.0, 0.05, 5e-4) + np.random.default_rng(i).normal(0, 0.01, len(t))
        made.append(Recording(t_s=t, axes={"x": AxisRecord(u, x)}, source=f"{f_Hz:g} Hz"))
    assert not any("about as slowly" in line for line in fit(made)[1].messages)


def test_a_set_without_a_loop_is_refused():
    one_way, another = (record_of(NO_MODE, ramp(10.0, 500.0), 500.0, seed, "ramp") for seed in (0, 2))
    with pytest.raises(BadInput, match=r"ramp: .* turns round less than twice"):
        fit([one_way, another])
    loop = record_of(NO_MODE, slow_sine(10.0, 500.0, 1.0), 500.0, 1, "loop")
    assert fit([one_way, loop])[1].left_out == []


def test_a_sensor_that_counts_backwards_has_a_negative_gain(few):
    stage, report = fit([changed(r, x=lambda x: -x) for r in few])
    view = stage.axis("x").time
    assert view.gain_um_per_V < 0
    assert max(view.play_w_um_per_V) <= 0
    assert parse_stage(stage_text(stage)) == stage
    assert any("rises with the voltage" in line for line in report.messages)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("mechanics", ["one mode", "slow"])
def test_a_line_has_the_gain_of_slow_motion(mechanics, sign):
    """On broadband records too, where the position mostly runs against the voltage; signed."""
    stage = AnyStage(MECHANICS[mechanics], um_per_V=20.0 * sign, memory=lambda u, span: u)
    (record,) = laboratory(stage, RATE_HZ, only=("multisine",))
    u = record.axes["x"].u_V
    alone = Recording(record.t_s[5000:], {"x": AxisRecord(u[5000:], record.axes["x"].x_um[5000:])}, source="multisine")
    fitted, _ = fit([alone], base="linear")
    assert fitted.axis("x").time.gain_um_per_V == pytest.approx(20.0 * sign, rel=0.01)
    assert fitted.axis("x").effects == ()


@pytest.mark.parametrize("base", ["operator", "linear"])
def test_a_slow_answer_stays_below_the_longest_delay(base):
    """Once a ValidationError: a tenth of a period of 1000 s is more than a stage file takes."""
    stage = AnyStage(delay_s=30.0)
    waves = [slow_sine(10.0, 0.2, share, f_Hz) for share, f_Hz in ((1.0, 1e-3), (0.5, 2e-3))]
    records = [record_of(stage, u, 0.2, i, f"{i}") for i, u in enumerate(waves)]
    fitted, _ = fit(records, base=base)
    assert fitted.axis("x").time.delay_s <= LONGEST_DELAY_S


@pytest.mark.parametrize("um_per_V", [0.1, -0.1])
@pytest.mark.parametrize("noise_um", [0.0, 0.01])
@pytest.mark.parametrize("memory", [lambda u, span: u, AnyStage.memory])
def test_loops_of_800_V(um_per_V, noise_um, memory):
    """Once a division by zero behind an operator that did not move at all; an exact line once was singular."""
    stage = AnyStage(um_per_V=um_per_V, span_V=800.0, noise_um=noise_um, memory=memory, delay_s=0.0)
    t = np.arange(1500) / 500.0
    waves = [share * 800.0 * (1 - np.abs(2 * (t % 1) - 1)) for share in (1.0, 0.5)]
    fitted, _ = fit([record_of(stage, u, 500.0, i, f"{i}") for i, u in enumerate(waves)])
    assert fitted.axis("x").time.residual_um_rms < 0.05
    assert np.sign(fitted.axis("x").time.gain_um_per_V) == np.sign(um_per_V)


@pytest.mark.parametrize(
    ("modes", "left_um"),
    [
        (((1.0, 40.0, 0.7),), 0.6),  # 2.3 um without it
        (((0.9, 150.0, 0.55), (0.1, 400.0, 0.02)), 0.1),  # 1.5 um
        (((2.3, 60.0, 0.05),), 1.0),  # 8 um
    ],
    ids=["damped", "damped beside another", "more than all of the motion"],
)
def test_what_a_stage_shows_is_kept_at_the_end_of_what_is_searched_and_beyond(modes, left_um):
    fitted, _ = fit(laboratory(AnyStage(modes), COARSE_HZ, only=QUICK))
    assert [mode[1] for mode in modes_of(fitted)] == [pytest.approx(f_Hz, rel=0.05) for _, f_Hz, _ in modes]
    assert fitted.axis("x").time.residual_um_rms < left_um
