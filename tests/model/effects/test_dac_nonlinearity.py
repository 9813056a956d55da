"""A converter's errors in its own codes: which codes a record has, what their bits add, and how it is undone."""

from __future__ import annotations

import numpy as np
import pytest
from benchtop import LINEAR, PIEZO, axis, rich, run, signal
from hypothesis import example, given, settings
from hypothesis import strategies as st

from phaselead.model.axis import Actuator
from phaselead.model.effects import effect
from phaselead.model.effects.code_grid import calibrated, code_grid, common_step
from phaselead.model.effects.dac_nonlinearity import BITS, SIZES, predistorted

LSB_V = 20.48 / 65536
sizes = st.fixed_dictionaries({name: st.floats(-4, 4) for name in SIZES})
laws = settings(max_examples=25, deadline=None)


def converter(codes, bow_LSB=0.0, **bits_LSB):
    """The voltages of a 16-bit converter, added up bit by bit with their errors, less those at 0 V."""
    weights = [2.0 ** (15 - i) + bits_LSB.get(f"bit{i + 1}_LSB", 0.0) for i in range(16)]

    def out(code):
        total = sum(w * (code >> (15 - i) & 1) for i, w in enumerate(weights)) + 4 * bow_LSB * code / 65535 * (
            1 - code / 65535
        )
        return total - sum(weights) * code / 65535 + code  # end points as the ideal converter's

    return np.array([(out(int(c)) - out(32768)) * LSB_V for c in codes])


@laws
@given(params=sizes, seed=st.integers(0, 2**31))
def test_it_is_a_converter_with_wrong_bits(params, seed):
    codes = np.random.default_rng(seed).integers(0, 65536, 200)
    u = (codes - 32768) * LSB_V
    e = effect("dac_nonlinearity")
    put_out = e.apply(signal(axis(PIEZO), u, e.name), e.complete(params))[1:]
    assert np.allclose(put_out, converter(codes, **params), atol=1e-9)


@laws
@given(params=sizes)
def test_the_largest_error_is_what_a_data_sheet_says(params):
    codes = np.arange(0, 65536, 13)
    error_LSB = converter(codes, **params) / LSB_V - (codes - 32768)
    line = error_LSB + np.interp(0, [0, 1], [0, 0])
    ends = converter(np.array([0, 65535]), **params) / LSB_V - np.array([-32768, 32767])
    departure = line - np.interp(codes, [0, 65535], ends)
    (inl,) = effect("dac_nonlinearity").derived
    assert inl.unit == "LSB"
    assert inl.value(params, None) == pytest.approx(np.abs(departure).max(), abs=0.02)


@laws
@given(params=sizes, seed=st.integers(0, 2**31))
@example(params={"bow_LSB": -3.0280935479850104} | dict.fromkeys(BITS, 0.0), seed=0)
def test_predistortion_undoes_it_to_a_code(params, seed):
    model, e = axis(LINEAR), effect("dac_nonlinearity")
    wished = np.random.default_rng(seed).uniform(-9, 9, 300)
    asked = predistorted(model, e.complete(params), wished)
    put_out = converter(np.rint(asked / LSB_V).astype(int) + 32768, **params)
    # Half a step away is the nearest that there is: a bow makes it a little larger at one end, a heavy bit some codes.
    largest = 0.5 * (1 + 4 * abs(params["bow_LSB"]) / 65535) + sum(abs(params[name]) for name in BITS) / 2
    assert np.abs(put_out - wished).max() < largest * LSB_V
    assert np.median(np.abs(put_out - wished)) < 0.5 * LSB_V


def test_a_record_is_predistorted_back_to_itself():
    model, params = axis(LINEAR), {"bow_LSB": 6.0, "bit2_LSB": -5.0, "bit3_LSB": 4.0}
    u = np.round(rich() / LSB_V) * LSB_V
    wrong = run(model, u, "dac_nonlinearity", **params) - run(model, u)
    asked = predistorted(model, effect("dac_nonlinearity").complete(params), u)
    left = run(model, asked, "dac_nonlinearity", **params) - run(model, u)
    assert np.std(left) < 0.2 * np.std(wrong)
    assert np.abs(left).max() < 10 * 5 * LSB_V


@given(span_V=st.floats(1, 300), bits=st.integers(12, 18), unipolar=st.booleans(), seed=st.integers(0, 2**31))
@laws
def test_the_codes_are_those_of_the_records_own_step(span_V, bits, unipolar, seed):
    """Whatever the stage file says of volts: the record's voltages are multiples of the converter's LSB."""
    rng = np.random.default_rng(seed)
    codes = np.concatenate([[0, 2**bits - 1], rng.integers(0, 2**bits, 300), rng.integers(0, 40, 60)])
    low_V = 0.0 if unipolar else -span_V / 2
    u = low_V + codes * (span_V / 2**bits)
    written = np.array([float(f"{v:.9g}") for v in u])
    found = code_grid(Actuator(bits=bits), written)
    assert found.step_V == pytest.approx(span_V / 2**bits, rel=1e-6)
    assert np.array_equal(found.codes(written), codes)


@given(scale=st.sampled_from([1e-3, 1.0, 1e3]))
@laws
def test_volts_or_millivolts_are_the_same_codes(scale):
    codes = np.random.default_rng(0).integers(0, 65536, 400)
    u = (codes - 32768) * (20 / 65536) * scale
    assert np.array_equal(code_grid(Actuator(), u).codes(u), codes)


@pytest.mark.parametrize(
    "u",
    [
        np.random.default_rng(0).uniform(-1, 1, 500),  # computed, or measured
        np.round(np.random.default_rng(0).uniform(-1, 1, 500), 3),  # written with three decimals
        np.zeros(300),
        np.linspace(0, 1, 20),
    ],
)
def test_without_a_step_of_its_own_the_stage_file_counts(u):
    assert common_step(u) is None
    assert code_grid(Actuator(), u) == calibrated(Actuator())
    assert code_grid(Actuator(u_min_V=-5, u_max_V=5, bits=12), u) == calibrated(
        Actuator(u_min_V=-5, u_max_V=5, bits=12)
    )


def test_voltages_of_the_stage_files_codes_are_taken_as_these():
    """Even where they use every fourth code only."""
    u = np.arange(-2000, 2000, 4) * LSB_V
    assert code_grid(Actuator(), u) == calibrated(Actuator())


def test_the_error_is_the_same_at_every_visit():
    e, model = effect("dac_nonlinearity"), axis(PIEZO)
    params = e.complete({"bow_LSB": 3.0, "bit2_LSB": 2.0})
    slow, fast = (signal(model, u, e.name) for u in (np.linspace(0, 9, 901), np.linspace(0, 9, 91)))
    errors = [e.apply(s, params) - s.value for s in (slow, fast)]
    assert errors[0][1::10] == pytest.approx(errors[1][1:])
