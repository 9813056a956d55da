"""Common modes of several axes: from records to a frequency response, to poles, to a model that predicts."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shared_structure import F_HZ, PERIOD, RATE_HZ, ZETA, Structure

from phaselead.errors import BadInput
from phaselead.identify.modal.frequency_domain import JointExperiment, common_poles, frequency_response
from phaselead.identify.modal.model import Drive
from phaselead.identify.modal.time_domain import LEAST_ZETA, Shaping, fit_modes, stable, stable_shift
from phaselead.model.effects import mode_bank
from phaselead.model.effects.filters import resonant
from phaselead.record.recording import Recording

STEP = 1 / RATE_HZ
frequencies = st.floats(0.5, 900.0)
dampings = st.floats(0.003, 0.9)


def experiment(record: Recording) -> JointExperiment:
    u, x = (np.stack([getattr(a, part) for a in record.axes.values()], axis=1) for part in ("u_V", "x_um"))
    return JointExperiment(u, x, record.scored, STEP)


def drive(record: Recording) -> Drive:
    e = experiment(record)
    front = np.zeros((1, 3))
    rows = slice(e.rows.start + 1, e.rows.stop + 1)
    return Drive(np.vstack([front, e.u_V]), None, np.vstack([front, e.x_um]), rows, STEP)


def plain(records: list[Recording]) -> Shaping:
    none, drives = np.zeros(0), [drive(r) for r in records]
    return Shaping(lambda _: drives, none, none, none, none)


def nearest(found: np.ndarray, wanted: float) -> int:
    return int(np.argmin(np.abs(found - wanted)))


@pytest.fixture(scope="module")
def records() -> list[Recording]:
    return Structure(1).experiments(3, 1.0, "r")


@pytest.fixture(scope="module")
def fitted(records):
    poles = common_poles(frequency_response([experiment(r) for r in records]))
    return fit_modes(poles, plain(records), most_steps=6)


@given(f_Hz=frequencies, zeta=dampings, seed=st.integers(0, 1000))
@settings(max_examples=30, deadline=None)
def test_a_state_spans_displacement_and_velocity(f_Hz, zeta, seed):
    rng = np.random.default_rng(seed)
    x = 5 + np.cumsum(rng.normal(size=400))
    p = mode_bank.poles(np.array([f_Hz]), np.array([zeta]))
    states = mode_bank.states(x, p, STEP)
    c, v = rng.normal(size=2)
    weights = mode_bank.state_weights(np.array([c]), np.array([v]), np.array([zeta]))
    moved = states @ mode_bank.state_weights(np.ones(1), np.zeros(1), np.array([zeta]))
    assert moved == pytest.approx(resonant(x, f_Hz, zeta, STEP), abs=1e-6 * np.abs(x).max())
    velocity = (states @ weights - c * moved) / v
    w = 2 * np.pi * f_Hz
    assert velocity[0] == pytest.approx(0, abs=1e-9)
    # w y = dx/dt of the displacement: its integral over the record is the way travelled, to second order in the step
    if f_Hz < 50:
        way = np.sum((velocity[1:] + velocity[:-1]) / 2) * STEP * w
        assert way == pytest.approx(moved[-1] - moved[0], abs=2e-2 * np.ptp(x))
    back = mode_bank.shares(weights, np.array([zeta]))
    assert np.concatenate(back) == pytest.approx([c, v])


@given(f_Hz=frequencies, zeta=dampings, seed=st.integers(0, 1000))
@settings(max_examples=20, deadline=None)
def test_slopes_are_derivatives(f_Hz, zeta, seed):
    x = np.cumsum(np.random.default_rng(seed).normal(size=300))
    p = mode_bank.poles(np.array([f_Hz]), np.array([zeta]))
    size, h = abs(p[0]), 1e-5
    _, slopes = mode_bank.states_and_slopes(x, p, STEP)
    for turn in (1, 1j):
        up, down = (mode_bank.states(x, p + s * h * size * turn, STEP) for s in (1, -1))
        up, down = up * size / abs(p[0] + h * size * turn), down * size / abs(p[0] - h * size * turn)
        numeric = ((up - down) / (2 * h)) @ [1, 1j]
        wanted = (slopes @ [1, 1j]) * turn
        assert np.abs(numeric - wanted).max() < 1e-4 * np.abs(wanted).max()


@given(drop=st.floats(-0.03, 0.03), level=st.floats(0.0, 1.0), f_Hz=st.floats(20, 900), zeta=st.floats(0.005, 0.1))
@settings(max_examples=20, deadline=None)
def test_a_level_moves_the_pole(drop, level, f_Hz, zeta):
    x = np.random.default_rng(2).normal(size=400)
    p = mode_bank.poles(np.array([f_Hz]), np.array([zeta]))
    by = np.array([[drop * (1 + 0.2j)]])
    moved = mode_bank.states(x, p, STEP, np.full((400, 1), level), by)
    there = mode_bank.states(x, p * (1 - by[0] * level), STEP) / abs(1 - by[0, 0] * level)
    assert moved == pytest.approx(there, abs=3e-3 * np.abs(there).max())


def test_the_frequency_response_is_the_structures():
    structure = Structure(1, noise_um=0.0)
    records = structure.experiments(4, 1.0, "r")
    seen = frequency_response([experiment(r) for r in records])
    assert seen.period_rows == PERIOD
    low = seen.f_Hz < 600
    true = structure.response(seen.f_Hz[low])
    # a voltage that runs straight between rows is smaller by sinc^2 than its samples say
    held = np.sinc(seen.f_Hz[low] / RATE_HZ) ** 2
    error = np.abs(seen.matrix[low] - true * held[:, None, None])
    assert np.median(error / np.abs(true)) < 0.02
    assert np.isfinite(seen.variance).all()


def test_its_variance_is_that_of_the_noise():
    structure = Structure(2, noise_um=0.2)
    seen = frequency_response([experiment(r) for r in structure.experiments(8, 1.0, "r")])
    quiet = frequency_response([experiment(r) for r in Structure(2, noise_um=0.0).experiments(8, 1.0, "r")])
    assert np.array_equal(quiet.f_Hz, seen.f_Hz)
    error = np.mean(np.abs(seen.matrix - quiet.matrix) ** 2)
    assert np.mean(seen.variance) == pytest.approx(error, rel=0.25)


@pytest.mark.parametrize("kind", ["together", "noise", "alone"])
def test_poles_are_found_however_it_was_driven(kind):
    structure = Structure(3)
    if kind == "together":
        records = structure.experiments(3, 1.0, "r")
    elif kind == "alone":
        records = []
        for i in range(3):
            u = np.zeros((2 * PERIOD, 3))
            u[:, i] = np.tile(structure.multisine(1.0)[:, i], 2)
            records.append(structure.record(u, f"r{i}", warm_rows=PERIOD))
    else:
        noise = np.random.default_rng(5).normal(size=(3, 8 * PERIOD, 3))
        records = [structure.record(u, f"r{i}") for i, u in enumerate(noise)]
    poles = common_poles(frequency_response([experiment(r) for r in records]))
    assert (poles.real < 0).all()
    f_Hz, zeta = mode_bank.modes_of(poles)
    for f, z in zip(F_HZ, ZETA, strict=True):
        found = nearest(f_Hz, f)
        assert f_Hz[found] == pytest.approx(f, rel=1e-2 if kind == "noise" else 2e-3)
        assert zeta[found] == pytest.approx(z, rel=0.5 if kind == "noise" else 0.1)


def test_drives_in_one_proportion_are_refused():
    structure = Structure(4)
    u = np.tile(structure.multisine(1.0)[:, :1], (2, 3))
    with pytest.raises(BadInput, match="same proportion"):
        frequency_response([experiment(structure.record(u * s, f"r{s}", warm_rows=PERIOD)) for s in (1, 2, 3)])


def test_too_few_experiments_are_refused(records):
    with pytest.raises(BadInput, match="2 experiments do not tell 3 inputs apart"):
        frequency_response([experiment(r) for r in records[:2]])


def test_modes_lie_inside_their_intervals():
    inside = tried = 0
    for seed in range(4):
        structure = Structure(10 + seed, noise_um=0.05)
        records = structure.experiments(3, 1.0, "r")
        fit = fit_modes(mode_bank.poles(F_HZ * 1.004, ZETA * 1.2), plain(records), most_steps=8)
        f_Hz, zeta = fit.model.f_Hz, fit.model.zeta
        # with light damping the imaginary part of a pole is its frequency and the real part its damping
        off = np.concatenate([(f_Hz - F_HZ) / F_HZ / fit.pole_std[1::2], (zeta - ZETA) / fit.pole_std[0::2]])
        inside += int(np.count_nonzero(np.abs(off) < 1.96))
        tried += len(off)
    assert inside >= 0.8 * tried


def test_it_predicts_what_it_was_not_fitted_to(fitted):
    structure = Structure(1)
    (record,) = structure.experiments(1, 2.0, "other")
    d = drive(record)
    left = (d.x_um - fitted.model.answer(d))[d.rows]
    left -= left.mean(axis=0)
    assert np.sqrt(np.mean(left**2)) < 0.01 * np.sqrt(np.mean(d.x_um[d.rows] ** 2))


def test_shares_of_actuators_are_the_shapes(fitted):
    shape = np.abs(Structure(1).actuators) ** 2
    shape /= shape.sum(axis=1, keepdims=True)
    found = fitted.model.participation()
    for i, f in enumerate(F_HZ):
        assert found[nearest(fitted.model.f_Hz, f)] == pytest.approx(shape[i], abs=0.03)


@given(re=st.floats(-2.0, 1.0), im=st.floats(0.001, 3.0))
def test_a_step_never_leaves_a_pole_unstable(re, im):
    p = stable(np.array([complex(re, im)]))
    zeta = mode_bank.modes_of(p)[1]
    assert p.real < 0
    assert LEAST_ZETA * 0.999 <= zeta[0] < 1


@given(re=st.floats(-3, 3), im=st.floats(-3, 3), zeta=st.floats(LEAST_ZETA, 0.9), level=st.floats(0.01, 3.0))
def test_no_level_makes_a_shifted_pole_unstable(re, im, zeta, level):
    p = mode_bank.poles(np.array([300.0]), np.array([zeta]))
    shift = stable_shift(p, np.array([complex(re, im)]), level)
    for share in (0.0, 0.3, 1.0):
        assert (p * (1 - shift * level * share)).real < 0


@given(f_Hz=st.floats(20, 900), zeta=st.floats(0.005, 0.1))
@settings(max_examples=10, deadline=None)
def test_without_a_level_a_drop_does_nothing(f_Hz, zeta):
    x = np.random.default_rng(3).normal(size=200)
    p = mode_bank.poles(np.array([f_Hz]), np.array([zeta]))
    drop = np.array([[0.02 + 0.01j]])
    for moved, plain in zip(
        mode_bank.states_and_slopes(x, p, STEP, np.zeros((200, 1)), drop),
        mode_bank.states_and_slopes(x, p, STEP),
        strict=True,
    ):
        assert moved == pytest.approx(plain, rel=1e-9, abs=1e-12)
