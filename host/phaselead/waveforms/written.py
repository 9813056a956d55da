"""What a user wrote for a waveform: levels, frequencies, durations with their units, and the line that refuses them."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal

from phaselead.errors import BadInput

Unit = Literal["um", "V"]

_UNITS: dict[str, tuple[Unit, float]] = {
    "um": ("um", 1.0), "µm": ("um", 1.0), "μm": ("um", 1.0), "nm": ("um", 1e-3), "mm": ("um", 1e3),
    "V": ("V", 1.0), "mV": ("V", 1e-3),
}  # fmt: skip
_FREQUENCIES = {"Hz": 1.0, "mHz": 1e-3, "kHz": 1e3}
_DURATIONS = {"s": 1.0, "ms": 1e-3}
_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_QUANTITY = re.compile(rf"\s*([+-]?{_NUMBER})\s*([A-Za-zµμ]*)\s*")
_LEVELS = re.compile(rf"\s*([+-]?{_NUMBER}\s*[A-Za-zµμ]*)\s*(?:([+-]\s*{_NUMBER}\s*[A-Za-zµμ]*))?\s*")


@dataclass(frozen=True)
class Written:
    """``text`` is the whole waveform, ``rest`` what follows its colon, ``example`` one that would do, ``takes`` the
    units."""

    text: str
    rest: str
    example: str
    what: str = "waveform"
    takes: str = "um or V"

    def refusal(self, what: str, example: str | None = None) -> BadInput:
        """The one line that says what is wrong and shows how to write it."""
        return BadInput(f"{self.what} {short(self.text)}: {what}; write it as in {example or self.example}")

    def at_frequency(self) -> tuple[str, float]:
        """What stands before the last ``@``, and the frequency in Hz behind it. Raises BadInput."""
        body, at, given = self.rest.rpartition("@")
        if not at:
            raise self.refusal("has no frequency")
        match = _QUANTITY.fullmatch(given)
        if not match or match[2] not in _FREQUENCIES:
            raise self.refusal(f"{short(given)} is no frequency in Hz")
        return body, self._positive(given, float(match[1]) * _FREQUENCIES[match[2]], "frequency")

    def duration_s(self, given: str, example: str) -> float:
        """A duration in seconds. Raises BadInput."""
        match = _QUANTITY.fullmatch(given)
        if not match or match[2] not in _DURATIONS:
            raise self.refusal(f"{short(given)} is no duration", example)
        return self._positive(given, float(match[1]) * _DURATIONS[match[2]], "duration")

    def levels(self, body: str) -> tuple[float, float, Unit]:
        """``SWING`` or ``SWING+OFFSET`` as swing, offset and their unit. Raises BadInput."""
        match = _LEVELS.fullmatch(body)
        if not match:
            raise self.refusal(f"{short(body)} is no swing with a unit and an optional offset (60um+20um)")
        swing, unit = self.level(match[1])
        if match[2] is None:
            return swing, 0.0, unit
        offset, offset_unit = self.level(match[2].replace(" ", ""))
        if offset_unit != unit:
            raise self.refusal(f"swing in {unit} and offset in {offset_unit}: give both in the same unit")
        return swing, offset, unit

    def level(self, quantity: str) -> tuple[float, Unit]:
        """A number with its unit, in um or V. Raises BadInput."""
        match = _QUANTITY.fullmatch(quantity)
        if not match:
            raise self.refusal(f"{short(quantity)} is no number with a unit")
        if match[2] not in _UNITS:
            what = f"has the unit {short(match[2])}" if match[2] else f"{short(quantity)} has no unit"
            raise self.refusal(f"{what}: use {self.takes}")
        unit, scale = _UNITS[match[2]]
        value = float(match[1]) * scale
        if not math.isfinite(value):
            raise self.refusal(f"{short(quantity)} is not finite")
        return value, unit

    def _positive(self, given: str, value: float, what: str) -> float:
        if not (math.isfinite(value) and value > 0 and math.isfinite(1 / value)):
            raise self.refusal(f"its {what} {short(given)} must be above 0 and finite")
        return value


def short(text: str) -> str:
    """Quoted, and cut where it would fill the line of a message."""
    quoted = repr(text)
    return quoted if len(quoted) <= 70 else quoted[:66] + "...'"
