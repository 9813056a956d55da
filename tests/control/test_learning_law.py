"""The law of learning by itself: what shrinks an error, and what of it is noise, chance or another loop."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from learned_paths import GAINS
from one_mode_model import AXIS

from phaselead.control.feedback_loop import local_gains, pid_response
from phaselead.control.learning import lines as of_lines
from phaselead.control.learning.law import MARGIN, next_step
from phaselead.control.learning.learned import one_period
from phaselead.control.learning.lines import Lines, error_lines, rest_of, values_of
from phaselead.control.learning.look import Look
from phaselead.control.learning.quieter import larger, scaled
from phaselead.control.learning.response import (
    Response,
    in_other_loop,
    model_response,
    other_loop,
    others_peak,
    same_voltage,
    turns_of,
)
from phaselead.model import small_signal
from phaselead.waveforms.catalogue import parse_wave
from phaselead.waveforms.waveform import POINTS

complexes = st.builds(lambda size, turn: size * np.exp(2j * np.pi * turn), st.floats(0.01, 3), st.floats(0, 1))


def one_line(error, gain, deviation, noise=0.0):
    lines = Lines(np.array([1]), np.array([error]), np.array([noise**2]))
    return lines, response_of([gain], [deviation])


def response_of(gain, deviation, voltage=1.0, bends=0.0):
    ones = np.ones(len(gain))
    return Response(
        np.array(gain, complex), np.array(deviation), voltage * ones, bends * ones, np.full(len(gain), True)
    )


@given(
    error=complexes,
    gain=complexes,
    doubt=st.floats(0, 1.5),
    off=st.sampled_from([0.0, 0.5, 1.0]),
    turn=st.sampled_from([0.0, 0.2, 0.4, 0.5, 0.7]),
)
def test_a_learned_error_shrinks_wherever_the_response_may_be(error, gain, doubt, off, turn):
    """Anywhere within twice its deviation."""
    step = next_step(*one_line(error, gain, doubt * abs(gain) / 2))
    true_gain = gain * (1 + off * doubt * np.exp(2j * np.pi * turn))
    left = abs(error - true_gain * step.change[0])
    if step.learned[0]:
        assert left <= (1 - MARGIN / 2) * abs(error)
    elif step.probed[0]:
        assert abs(step.change[0]) <= 0.11 * abs(error / gain)
    else:
        assert step.change[0] == 0


@given(error=complexes, noise=st.floats(1.0, 100.0))
def test_noise_is_not_learned(error, noise):
    step = next_step(*one_line(error, 1.0 + 0j, 0.1, noise=abs(error) * noise))
    assert not step.change.any()


@given(error=complexes, noise=st.floats(0.01, 0.3))
def test_of_a_noisy_line_less_is_learned(error, noise):
    """Wiener's share of it."""
    step = next_step(*one_line(error, 1.0 + 0j, 0.0, noise=abs(error) * noise))
    assert abs(step.change[0]) == pytest.approx((1 - noise**2) * abs(error))


@given(true_gain=complexes, gain=complexes, deviation=st.floats(0.1, 2))
def test_a_trial_without_noise_tells_the_response(true_gain, gain, deviation):
    known = response_of([gain], [deviation])
    found = known.measured(np.array([0.5j]), np.array([0.5j * true_gain]), np.zeros(1))
    assert found.gain[0] == pytest.approx(true_gain, abs=1e-9)
    assert found.deviation[0] == pytest.approx(0, abs=1e-9)
    unmoved = known.measured(np.zeros(1, complex), np.array([error := 1.0 + 0j]) * error, np.ones(1))
    assert unmoved.gain[0] == gain
    assert unmoved.deviation[0] == deviation


@given(turn=st.floats(0, 1), voltage=st.floats(1.0, 20.0), bends=st.floats(0.01, 0.2))
def test_what_bends_the_stage_elsewhere_is_no_answer_of_a_line(turn, voltage, bends):
    """A few nanometres at 1500 Hz are a tenth of a micrometre in the voltage, whose extremes the hysteresis keeps: they
    moved 50 Hz by 64 nm, and 250 Hz was then taken for a line that the stage does not follow, for good."""
    known = response_of([1.0, 1.0], [0.5, 0.5], voltage=np.array([1.0, voltage]), bends=bends)
    gain, change = 1 + 0.5 * np.exp(2j * np.pi * turn), np.array([0.02, 0.2], complex)
    found = known.measured(change, gain * change + bends * voltage * abs(change[1]), np.zeros(2))
    assert abs(found.gain[0] - gain) <= 2 * found.deviation[0]
    alone = known.measured(np.array([0.02, 0]), np.array([0.02 * gain, 0]), np.zeros(2))
    assert alone.gain[0] == pytest.approx(gain)


def test_the_largest_sum_of_all_others_is_found():
    amplitude = np.array([0.0, 1.0, 2.0j, 0.5])
    t = np.arange(4096) / 4096
    for left_out, peak in enumerate(others_peak(amplitude)):
        rest = sum((a * np.exp(2j * np.pi * k * t)).real for k, a in enumerate(amplitude) if k != left_out)
        assert peak == pytest.approx(np.abs(rest).max(), rel=1e-4)


def test_a_line_that_may_still_be_followed_is_not_given_up():
    error = Lines(np.arange(3), np.full(3, 0.3 + 0j), np.full(3, 1e-8))
    known = response_of([0.17, 0.17, 1.0], [0.15, 0.001, 0.1])
    step = next_step(error, known)
    assert list(step.probed) == [True, False, False]
    assert list(step.learned) == [False, False, True]
    never = next_step(error, replace(known, followed=np.array([False, True, True])))
    assert not never.probed[0]


def test_the_loop_bends_lines_no_further_than_the_turns_of_a_path_reach():
    f_Hz = 20.0 * np.arange(60)
    few, many = (model_response(AXIS, GAINS["x"], f_Hz, turns).bends for turns in (2, 40))
    assert (few <= many).all()
    assert few[1] == many[1]
    assert few[20] < many[20] / 10


@pytest.mark.parametrize(("wave", "turns"), [("sine:30um@20Hz", 2), ("triangle:30um@20Hz", 2), ("square:30um@20Hz", 4)])
def test_turns_are_counted(wave, turns):
    assert turns_of(one_period(parse_wave(wave))) == turns


@given(f_Hz=st.floats(1.0, 200.0), seed=st.integers(0, 99))
def test_lines_are_those_of_the_path(f_Hz, seed):
    """Amplitudes put into a period come out of a record of it, whatever its period in ticks."""
    rng = np.random.default_rng(seed)
    count = min(8, int(2400 / f_Hz))
    put = rng.normal(size=count + 1) + 1j * rng.normal(size=count + 1)
    put[0] = put[0].real
    t_s = np.arange(round(6 * 5000 / f_Hz)) / 5000
    signal = np.real(np.exp(2j * np.pi * f_Hz * np.outer(t_s, np.arange(count + 1))) @ put)
    found = error_lines(t_s, signal, f_Hz, count, 5000)
    assert found.amplitude == pytest.approx(put, abs=np.abs(put).sum() * f_Hz / 5000 + 1e-6)
    points = values_of(np.arange(count + 1), put)
    assert points[:: POINTS // 4] == pytest.approx(
        np.real(np.exp(2j * np.pi * np.outer(np.arange(4) / 4, np.arange(count + 1))) @ put), abs=1e-9
    )


def test_an_error_of_another_loop_is_that_of_its_sensitivity():
    """A path through both loops on the model: what one leaves tells what the other would."""
    f_Hz, less = np.array([0.0, 20.0, 150.0, 400.0]), scaled(GAINS["x"], 0.25)
    before, after = (1 - model_response(AXIS, own, f_Hz).gain for own in (GAINS["x"], less))
    assert (before * other_loop(AXIS, GAINS["x"], less, f_Hz))[1:] == pytest.approx(after[1:])


def test_more_is_told_from_chance():
    rng = np.random.default_rng(1)
    quiet = rng.normal(0, 10e-3, 2000)
    assert not any(larger(rng.normal(0, 10e-3, 2000), quiet) for _ in range(50))
    assert larger(rng.normal(0, 12e-3, 2000), quiet)
    assert not larger(rng.normal(0, 5e-3, 2000), quiet)


def test_what_is_left_without_its_lines_has_none():
    t_s, number = np.arange(1000) / 5000, np.arange(5)
    signal = 3.0 + np.cos(2 * np.pi * 50 * t_s + 1) + np.cos(2 * np.pi * 33 * t_s)
    lines = error_lines(t_s, signal, 50.0, 4, 5000)
    again = error_lines(t_s, rest_of(lines, t_s, signal, 50.0), 50.0, 4, 5000)
    assert lines.number == pytest.approx(number)
    assert np.abs(again.amplitude).max() < 1e-9


def test_what_repeats_is_weighed_against_what_does_not():
    lines = Lines(np.arange(3), np.array([0.0, 1.0, 0.0]) + 0j, np.zeros(3))
    for rest_um, mostly in ((0.6, True), (0.8, False)):  # 1/sqrt(2) um rms repeats
        look = Look({}, {"x": lines}, {"x": np.full(10, rest_um)}, {}, {}, 0.0)
        assert look.mostly_repeats is mostly


def test_other_gains_ask_for_the_same_voltage_whatever_the_stage_is():
    """A stage that the model has wrong: the reference alone makes up for less feedback."""
    f_Hz, less = 20.0 * np.arange(1.0, 12), scaled(GAINS["x"], 0.125)
    model = model_response(AXIS, GAINS["x"], f_Hz)
    middle = local_gains(small_signal(AXIS))[1]
    before, after = (middle * pid_response(own, f_Hz) for own in (GAINS["x"], less))
    plant = 0.7 * np.exp(-0.4j * np.arange(1, 12))
    reference = 3.0 * np.exp(0.3j * np.arange(1, 12))
    voltage = (model.voltage + before) * reference / (1 + before * plant)
    apart_um = reference - plant * voltage
    other = reference + same_voltage(AXIS, (GAINS["x"], less), f_Hz, model.voltage, apart_um)
    assert (model.voltage + after) * other / (1 + after * plant) == pytest.approx(voltage)


def test_what_was_learned_of_the_response_holds_in_another_loop():
    f_Hz, less = 20.0 * np.arange(1.0, 12), scaled(GAINS["x"], 0.125)
    known, other = (model_response(AXIS, own, f_Hz) for own in (GAINS["x"], less))
    told = replace(known, deviation=np.full(11, 0.01))
    found = in_other_loop(AXIS, (GAINS["x"], less), f_Hz, told, other)
    assert found.gain == pytest.approx(other.gain)
    nudged = in_other_loop(AXIS, (GAINS["x"], less), f_Hz, replace(told, gain=known.gain + 1e-6), other)
    change = np.minimum(np.abs(nudged.gain - found.gain) / 1e-6 * 0.01, other.deviation)
    assert found.deviation == pytest.approx(change, rel=1e-3)


def test_noise_is_compared_axis_by_axis():
    lines, sizes = Lines(np.arange(1), np.zeros(1) + 0j, np.zeros(1)), ((1.0, 10.0), (0.5, 11.0), (0.9, 20.0))
    before, less, more = (
        Look({}, {"x": lines}, {"x": np.full(9, x), "y": np.full(9, y)}, {}, {}, 0.0) for x, y in sizes
    )
    assert less.rests_less_than(before)  # though the larger of the two has grown
    assert not more.rests_less_than(before)
    assert not before.rests_less_than(before)


def test_a_record_is_worked_on_in_pieces_to_the_same_end(monkeypatch):
    """A path of 0.01 Hz has millions of rows: all turns of 257 lines at once filled 19 GB."""
    t_s = np.arange(4000) / 1000
    rng = np.random.default_rng(3)
    error_um = np.sin(2 * np.pi * t_s) + rng.normal(size=4000)
    whole = error_lines(t_s, error_um, 1.0, 20, 1000.0)
    rest_um = rest_of(whole, t_s, error_um, 1.0)
    monkeypatch.setattr(of_lines, "PIECE_ROWS", 300)
    pieces = error_lines(t_s, error_um, 1.0, 20, 1000.0)
    np.testing.assert_allclose(pieces.amplitude, whole.amplitude, atol=1e-12)
    np.testing.assert_allclose(rest_of(pieces, t_s, error_um, 1.0), rest_um, atol=1e-12)
    shown = sum((a * np.exp(2j * np.pi * k * t_s)).real for k, a in zip(whole.number, whole.amplitude, strict=True))
    np.testing.assert_allclose(rest_um + shown, error_um, atol=1e-12)
