"""A load slows the largest mode by its mass, the others by what they feel of it."""

from __future__ import annotations

import numpy as np
import pytest

from phaselead.model.axis import AdoptedEffect, AxisModel
from phaselead.model.effects import effect
from phaselead.model.effects.interface import rewritten

LOAD = effect("load_change")


def loaded(shares, **params):
    """Frequencies of modes of 200, 300 ... Hz with these shares of the motion."""
    mode = effect("resonance")
    given = {"c": tuple(shares), "f_Hz": tuple(200.0 + 100 * np.arange(len(shares))), "zeta": (0.02,) * len(shares)}
    (_, moved), _ = rewritten([(mode, given), (LOAD, LOAD.complete({"mass": 0.44, **params}))])
    assert np.allclose(np.divide(moved["zeta"], 0.02), np.divide(moved["f_Hz"], given["f_Hz"]))
    return np.divide(moved["f_Hz"], given["f_Hz"])


@pytest.mark.parametrize("shares", [(0.9, 0.1), (-0.9, 0.1), (0.1, -0.9), (0.3, 0.6, 0.1)])
def test_the_largest_mode_feels_all_of_it(shares):
    largest = np.abs(shares) == np.abs(shares).max()
    assert np.allclose(loaded(shares, others=0.0), np.where(largest, 1 / 1.2, 1.0))
    assert np.allclose(loaded(shares, others=0.5), np.where(largest, 1 / 1.2, 1.22**-0.5))


def test_all_modes_feel_it_where_nobody_says_otherwise():
    assert np.allclose(loaded((0.9, 0.1)), 1 / 1.2)


def test_the_largest_of_several_effects_counts():
    mode = effect("resonance")
    small, large = ((mode, mode.complete({"c": c, "f_Hz": 200.0, "zeta": 0.02})) for c in (0.2, 0.7))
    moved = rewritten([small, large, (LOAD, LOAD.complete({"mass": 0.44, "others": 0.0}))])
    assert [params["f_Hz"] for _, params in moved[:2]] == pytest.approx([200.0, 200 / 1.2])


@pytest.mark.parametrize(("shares", "others"), [((0.9, 0.1), 0.5), ((0.1, 0.9), 0.0), ((0.5, 0.5), 1.0)])
def test_a_damper_raises_the_damping_of_the_modes_that_feel_it_and_moves_none(shares, others):
    mode, felt = effect("resonance"), np.where(np.abs(shares) == np.max(shares), 1.0, others)
    given = mode.complete({"c": shares, "f_Hz": (200.0, 300.0), "zeta": (0.02, 0.03)})
    load = LOAD.complete({"damping": 0.5, "others": others})
    (_, moved), _ = rewritten([(mode, given), (LOAD, load)])
    assert moved["f_Hz"] == pytest.approx([200.0, 300.0])
    assert np.allclose(np.divide(moved["zeta"], [0.02, 0.03]), 1 + 0.5 * felt)


def test_a_load_of_nothing_changes_nothing():
    mode = effect("resonance")
    given = mode.complete({"c": 0.9, "f_Hz": 200.0, "zeta": 0.02})
    (_, moved), _ = rewritten([(mode, given), (LOAD, LOAD.complete({}))])
    assert moved == given


def test_no_mode_is_damped_beyond_ringing():
    mode = effect("resonance")
    given = mode.complete({"c": 0.9, "f_Hz": 200.0, "zeta": 0.4})
    (_, moved), _ = rewritten([(mode, given), (LOAD, LOAD.complete({"damping": 10.0}))])
    assert moved["zeta"] < 1


def test_a_load_of_nothing_leaves_a_mode_that_is_damped_beyond_that():
    mode = effect("resonance")
    given = mode.complete({"c": 0.9, "f_Hz": 200.0, "zeta": 1.2})
    (_, moved), _ = rewritten([(mode, given), (LOAD, LOAD.complete({}))])
    assert moved["zeta"] == 1.2


def test_of_a_model_without_modes_there_is_nothing_to_say():
    assert LOAD.reads(LOAD.complete({"mass": 0.44}), AxisModel()) == ""


def test_in_words_it_says_where_the_largest_mode_was_and_is():
    modes = AdoptedEffect(name="resonance", params={"c": (0.1, 0.9), "f_Hz": (90.0, 220.0), "zeta": (0.02, 0.03)})
    before = AdoptedEffect(name="load_change", params={"mass": 0.21})
    words = LOAD.reads(LOAD.complete({"mass": 0.44, "damping": 0.2}), AxisModel(effects=(modes, before)))
    assert words == "the mode at 200 Hz (zeta 0.0273) is at 166.7 Hz (0.0273)"
