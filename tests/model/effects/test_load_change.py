"""A load slows the largest mode by its mass, the others by what they feel of it."""

from __future__ import annotations

import numpy as np
import pytest

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
