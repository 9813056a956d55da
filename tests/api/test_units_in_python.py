"""Numbers with a unit in Python: as the command line takes them, and nothing but BadInput for what is none."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import phaselead as pl
from phaselead.quantity import IN_SECONDS, SHARES, UM, UM_PER_S, V_PER_S, VOLTS, quantities, quantity


@pytest.mark.parametrize(
    ("value", "units", "found"),
    [
        (None, VOLTS, None),
        (2, VOLTS, 2.0),
        (np.float32(0.5), VOLTS, 0.5),
        ("500mV", VOLTS, 0.5),
        (" 2 s ", IN_SECONDS, 2.0),
        ("1e3ms", IN_SECONDS, 1.0),
        ("1", IN_SECONDS, 1.0),
        ("5 %", SHARES, 0.05),
        ("-1.5mm/s", UM_PER_S, -1500.0),
        ("90µm", UM, 90.0),
        ("0.5V/ms", V_PER_S, 500.0),
    ],
)
def test_a_number_or_text_with_a_unit(value: Any, units: dict[str, float], found: float | None) -> None:
    assert quantity("it", value, units) == pytest.approx(found)


@pytest.mark.parametrize("text", ["1e400um", "-1e400", "1e306mm", "1um 2um", "1e400um,2um", "nan", "inf"])
def test_text_that_is_no_finite_number_is_refused(text: str) -> None:
    """What overflows, also by its unit, and what is not of that form."""
    with pytest.raises(pl.BadInput, match=r"is no (finite )?number with a unit of um or nm or mm$"):
        quantities("it", text, UM)


def test_several_are_a_list_or_one_text() -> None:
    expected = pytest.approx([1.0, 0.5])
    assert quantities("levels", "1V,500mV", VOLTS) == expected
    assert quantities("levels", [1, "500mV"], VOLTS) == expected
    assert quantities("levels", np.array([1.0, 0.5]), VOLTS) == expected


CALLS = {
    "track": lambda dev, value: dev.track("sine:2V@5Hz", mode="open", duration=value),
    "track's wait": lambda dev, value: dev.track("sine:2V@5Hz", mode="open", trigger_in=value),
    "record": lambda dev, value: dev.record("sine:2V@5Hz", duration=value),
    "play": lambda dev, value: dev.play("sine:2V@5Hz", mode="open", duration=value),
    "move": lambda dev, value: dev.move(x=20, duration=value),
    "move's speed": lambda dev, value: dev.move(x=20, speed=value),
    "move's wait": lambda dev, value: dev.move(x=20, trigger_in=value),
    "arm": lambda dev, value: dev.arm(timeout=value),
    "tune": lambda dev, value: dev.tune("x", level=value),
    "tune's middle": lambda dev, value: dev.tune("x", middle=value),
    "tune's peak": lambda dev, value: dev.tune("x", peak=value),
    "tune's share": lambda dev, value: dev.tune("x", gain_share=value),
    "identify": lambda dev, value: dev.identify(levels=[1, value]),
    "identify's frequencies": lambda dev, value: dev.identify(frequencies=[value]),
    "identify's top": lambda dev, value: dev.identify(u_max=value),
    "identify's time": lambda dev, value: dev.identify(duration=value),
}


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("value", ["0.5um", "soon", "", [1, 2], True, math.nan], ids=repr)
def test_what_is_no_such_number_is_bad_input_and_nothing_moves(call: str, value: Any) -> None:
    with pl.connect() as dev:
        with pytest.raises(pl.BadInput) as refusal:
            CALLS[call](dev, value)
        assert dev.status().state == "parked"
    assert "\n" not in str(refusal.value)


def test_a_path_is_driven_for_as_long_as_the_text_says() -> None:
    with pl.connect() as dev:
        assert len(dev.track("sine:2V@50Hz", mode="open", duration="200ms").t_s) == 1000
        assert len(dev.record("sine:2V@50Hz", duration="0.1s").t_s) == 500
        assert dev.move(x=20, duration="50ms").axes["x"].duration_s == pytest.approx(0.05)
        dev.park()
        moved = dev.move(x=40, speed="0.5mm/s").axes["x"]
        assert moved.duration_s == pytest.approx(dev.plan(x=moved.from_um, speed=500).duration_s)
