"""Waveforms as a user writes them: ``sine:60um@5Hz``, ``file:p.csv@10Hz``, ``goto:120um``, ``sine:5V@5Hz``.

Amplitudes are peak-to-peak and rise from zero, or from the offset after the plus sign.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phaselead.errors import BadInput
from phaselead.model import AxisModel

POINTS = 1024
"""Of one period of a waveform that is no sine."""
SPEED = {"um": 1000.0, "V": 50.0}
"""Peak speed of a move without a duration, per second: about what parking does."""
SHORTEST_MOVE_s = 0.05
PEAK_SPEED = 1.875
"""Of the least-jerk move, in ways per duration."""

Unit = Literal["um", "V"]
Kind = Literal["sine", "triangle", "file", "goto"]

_UNITS: dict[str, tuple[Unit, float]] = {
    "um": ("um", 1.0), "µm": ("um", 1.0), "μm": ("um", 1.0), "nm": ("um", 1e-3), "mm": ("um", 1e3),
    "V": ("V", 1.0), "mV": ("V", 1e-3),
}  # fmt: skip
_TIMES = {"Hz": 1.0, "mHz": 1e-3, "kHz": 1e3, "s": 1.0, "ms": 1e-3}
_EXAMPLES = {
    "sine": "sine:60um@5Hz",
    "triangle": "triangle:100um@20Hz",
    "file": "file:path.csv@10Hz",
    "goto": "goto:120um",
}
_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_QUANTITY = re.compile(rf"\s*([+-]?{_NUMBER})\s*([A-Za-zµμ]*)\s*")
_LEVELS = re.compile(rf"\s*([+-]?{_NUMBER}\s*[A-Za-zµμ]*)\s*(?:([+-]\s*{_NUMBER}\s*[A-Za-zµμ]*))?\s*")
_COLUMN_UNITS: dict[str, Unit] = {"x_um": "um", "r_um": "um", "u_V": "V"}


@dataclass(frozen=True, eq=False)
class Waveform:
    """A reference path of one axis.

    ``swing`` is peak-to-peak and ``offset`` the lowest value, in ``unit``; of a ``goto`` they are the way
    to go (signed) and its start, and ``f_Hz`` is 1 / duration. ``points`` (1024 values of 0..1, one period)
    unless sine or goto.
    """

    kind: Kind
    swing: float
    offset: float
    unit: Unit
    f_Hz: float
    points: NDArray[np.float64] | None = None

    @property
    def periodic(self) -> bool:
        return self.kind != "goto"

    @property
    def duration_s(self) -> float:
        """Of a move, or of one period."""
        return 1 / self.f_Hz

    @property
    def lowest(self) -> float:
        return min(self.offset, self.offset + self.swing)

    @property
    def highest(self) -> float:
        return max(self.offset, self.offset + self.swing)

    def value(self, t_s: ArrayLike) -> NDArray[np.float64]:
        """Values in ``unit`` at times from the start, shape of ``t_s``. Outside a move: its ends."""
        turns = np.asarray(t_s, dtype=np.float64) * self.f_Hz
        if self.kind == "goto":
            s = np.clip(turns, 0.0, 1.0)
            share = s**3 * (10 - 15 * s + 6 * s**2)
        elif self.points is None:
            share = (1 - np.cos(2 * np.pi * turns)) / 2
        else:
            period = np.append(self.points, self.points[0])
            share = np.interp(turns % 1.0 * POINTS, np.arange(POINTS + 1), period)
        return np.asarray(self.offset + self.swing * share)

    def from_start(self, start: float) -> Waveform:
        """A goto to the same target from ``start`` at the same mean speed; others are returned as is."""
        if self.kind != "goto":
            return self
        way = self.offset + self.swing - start
        duration = self.duration_s * (abs(way / self.swing) if self.swing else 1.0)
        return replace(self, swing=way, offset=start, f_Hz=1 / max(duration, SHORTEST_MOVE_s))


def parse_waves(text: str, axis: str = "x") -> dict[str, Waveform]:
    """``WAVE`` for ``axis``, or ``x=WAVE,y=WAVE`` for several, by axis."""
    parts = re.split(r",\s*(?=[A-Za-z]\w*=)", text.strip())
    if not re.match(r"[A-Za-z]\w*=", parts[0]):
        if axis not in ("x", "y", "z"):
            raise BadInput(f"axis {axis!r}: there are x, y and z")
        return {axis: parse_wave(text)}
    waves: dict[str, Waveform] = {}
    for part in parts:
        name, _, wave = part.partition("=")
        if name not in ("x", "y", "z"):
            raise BadInput(
                f"waveform {_short(part)}: there is no axis {name}; "
                "use x, y or z, as in x=sine:60um@5Hz,y=sine:30um@5Hz"
            )
        if name in waves:
            raise BadInput(f"waveform {_short(text)}: axis {name} is given twice; give it one waveform")
        waves[name] = parse_wave(wave)
    return waves


def parse_wave(text: str) -> Waveform:
    """One waveform. Raises BadInput with what is wrong and an example."""
    kind, colon, rest = text.strip().partition(":")
    if kind not in _EXAMPLES:
        raise BadInput(
            f"waveform {_short(text)}: {_short(kind)} is no kind of waveform; one of {', '.join(_EXAMPLES.values())}"
        )
    if not colon or not rest.strip():
        raise _refusal(text, kind, "nothing follows the kind")
    if kind == "goto":
        return _goto(text, rest)
    body, at, frequency_text = rest.rpartition("@")
    if not at:
        raise _refusal(text, kind, "has no frequency")
    f_Hz = _frequency(text, kind, frequency_text)
    if kind == "file":
        return _from_file(body, f_Hz)
    swing, offset, unit = _levels(text, kind, body)
    if swing <= 0:
        raise _refusal(text, kind, f"its swing {swing:g} {unit} must be above 0 (peak-to-peak)")
    if kind == "sine":
        return Waveform("sine", swing, offset, unit, f_Hz)
    phase = np.arange(POINTS) / POINTS
    return Waveform("triangle", swing, offset, unit, f_Hz, 1 - np.abs(2 * phase - 1))


def _short(text: str) -> str:
    quoted = repr(text)
    return quoted if len(quoted) <= 70 else quoted[:66] + "...'"


def _refusal(text: str, kind: str, what: str) -> BadInput:
    return BadInput(f"waveform {_short(text)}: {what}; write it as in {_EXAMPLES[kind]}")


def _levels(text: str, kind: str, body: str) -> tuple[float, float, Unit]:
    match = _LEVELS.fullmatch(body)
    if not match:
        raise _refusal(text, kind, f"{_short(body)} is no swing with a unit and an optional offset (60um+20um)")
    swing, unit = _level(text, kind, match[1])
    if match[2] is None:
        return swing, 0.0, unit
    offset, offset_unit = _level(text, kind, match[2].replace(" ", ""))
    if offset_unit != unit:
        raise _refusal(text, kind, f"swing in {unit} and offset in {offset_unit}: give both in the same unit")
    return swing, offset, unit


def _level(text: str, kind: str, quantity: str) -> tuple[float, Unit]:
    match = _QUANTITY.fullmatch(quantity)
    if not match:
        raise _refusal(text, kind, f"{_short(quantity)} is no number with a unit")
    if match[2] not in _UNITS:
        what = f"has the unit {_short(match[2])}" if match[2] else f"{_short(quantity)} has no unit"
        raise _refusal(text, kind, f"{what}: use um or V")
    unit, scale = _UNITS[match[2]]
    value = float(match[1]) * scale
    if not math.isfinite(value):
        raise _refusal(text, kind, f"{_short(quantity)} is not finite")
    return value, unit


def _frequency(text: str, kind: str, given: str) -> float:
    match = _QUANTITY.fullmatch(given)
    if not match or match[2] not in ("Hz", "mHz", "kHz"):
        raise _refusal(text, kind, f"{_short(given)} is no frequency in Hz")
    return _positive(text, kind, given, float(match[1]) * _TIMES[match[2]], "frequency")


def _positive(text: str, kind: str, given: str, value: float, what: str) -> float:
    if not (math.isfinite(value) and value > 0 and math.isfinite(1 / value)):
        raise _refusal(text, kind, f"its {what} {_short(given)} must be above 0 and finite")
    return value


def _goto(text: str, rest: str) -> Waveform:
    target_text, at, duration_text = rest.partition("@")
    target, unit = _level(text, "goto", target_text)
    if not at:
        return Waveform("goto", target, 0.0, unit, 1 / move_duration_s(target, unit))
    match = _QUANTITY.fullmatch(duration_text)
    if not match or match[2] not in ("s", "ms"):
        raise BadInput(
            f"waveform {_short(text)}: {_short(duration_text)} is no duration; write it as in goto:120um@0.5s"
        )
    duration = _positive(text, "goto", duration_text, float(match[1]) * _TIMES[match[2]], "duration")
    return Waveform("goto", target, 0.0, unit, 1 / duration)


def refuse_out_of_range(wave: Waveform, axis: AxisModel, *, table: bool = False) -> None:
    """Refuse a waveform that leaves what the axis can do; ``table``: also what table feed-forward covers.

    Volts must stay inside the limits and below the slew limit; positions inside what the sensor sees, and the
    measured range if there is one.
    """
    if wave.unit == "V":
        limits = axis.limits
        _inside(wave, limits.u_min_V, limits.u_max_V, "the limits of the output")
        rate = steepest(wave)
        if rate > limits.slew_V_per_s:
            slower = wave.f_Hz * limits.slew_V_per_s / rate
            raise BadInput(
                f"waveform: it needs {rate:.4g} V/s, the slew limit is {limits.slew_V_per_s:g} V/s; "
                f"stay below {slower:.3g} Hz or lower the swing"
            )
        return
    sensor = axis.sensor
    _inside(wave, sensor.x_min_um, sensor.x_max_um, "what the sensor sees")
    if axis.table is not None:
        _inside(wave, -math.inf, axis.table.range_um[1], "what the stage reaches")
        if table and wave.periodic:
            axis.table.phase_deg(axis.table.swing_for_range(wave.swing), wave.f_Hz)


def _inside(wave: Waveform, lowest: float, highest: float, what: str) -> None:
    if not lowest <= wave.lowest <= wave.highest <= highest:
        span = f"{lowest:.6g}..{highest:.6g}" if math.isfinite(lowest) else f"up to {highest:.6g}"
        raise BadInput(
            f"waveform: {wave.lowest:g}..{wave.highest:g} {wave.unit} is outside {what} "
            f"({span} {wave.unit}); choose a smaller swing or another offset"
        )


def steepest(wave: Waveform) -> float:
    """Largest rate, in units per second."""
    if wave.kind == "goto":
        return PEAK_SPEED * abs(wave.swing) * wave.f_Hz
    if wave.points is None:
        return math.pi * wave.swing * wave.f_Hz
    steps = np.abs(np.diff(np.append(wave.points, wave.points[0])))
    return float(steps.max()) * POINTS * wave.swing * wave.f_Hz


def move_duration_s(way: float, unit: Unit) -> float:
    """Duration of a least-jerk move of this way at a safe peak speed."""
    return max(SHORTEST_MOVE_s, PEAK_SPEED * abs(way) / SPEED[unit])


def _from_file(path: str, f_Hz: float) -> Waveform:
    """One period from a file: a column of values, or times and values; a header may name them."""
    source = f"waveform file {path}"
    labels, rows = _numbers(path, source)
    unit: Unit = "um"
    if labels:
        stranger = next((label for label in labels if label not in _COLUMN_UNITS and label != "t_s"), None)
        if stranger is not None:
            raise BadInput(f"{source}: column {_short(stranger)} is none of t_s, x_um, r_um, u_V; rename it")
        if labels[-1] == "t_s" or "t_s" in labels[1:] or (len(labels) == 2 and labels[0] != "t_s"):
            raise BadInput(
                f"{source}: its columns are {','.join(labels)}; expected t_s,x_um or t_s,u_V or one of them alone"
            )
        unit = _COLUMN_UNITS[labels[-1]]
    if rows.shape[1] == 2:
        times, values = rows[:, 0], rows[:, 1]
        if (np.diff(times) <= 0).any():
            raise BadInput(
                f"{source}: row {int(np.argmax(np.diff(times) <= 0)) + 2}: time does not advance; sort the rows"
            )
    else:
        times, values = np.arange(len(rows), dtype=np.float64), rows[:, 0]
    with np.errstate(over="ignore", invalid="ignore"):
        period = times[-1] - times[0] + (times[-1] - times[0]) / (len(times) - 1)
        swing = float(np.ptp(values))
    if not (np.isfinite(period) and np.isfinite(swing)):
        raise BadInput(f"{source}: its numbers are too large; check their unit")
    grid = times[0] + period * np.arange(POINTS) / POINTS
    resampled = np.interp(grid, np.append(times, times[0] + period), np.append(values, values[0]))
    lowest, swing = float(resampled.min()), float(np.ptp(resampled))
    if swing == 0:
        raise BadInput(f"{source}: its values are all {values[0]:g}; use goto to hold a position")
    return Waveform("file", swing, lowest, unit, f_Hz, np.clip((resampled - lowest) / swing, 0, 1))


def _numbers(path: str, source: str) -> tuple[list[str], NDArray[np.float64]]:
    """Header labels (empty without a header) and the rows, shape (n, 1 or 2)."""
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not text"
        raise BadInput(f"{source}: cannot be read ({reason}); give a CSV file of one period") from None
    lines = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.lstrip()[:1] not in ("", "#", "%")]
    labels: list[str] = []
    rows: list[list[float]] = []
    for number, line in lines:
        fields = [field.strip() for field in re.split(r"[;,\t]|\s+", line.strip())]
        try:
            row = [float(field) for field in fields]
        except ValueError:
            if not labels and not rows:
                labels = [field.strip("\"'") for field in fields]
                continue
            raise BadInput(f"{source}: line {number}: {_short(line)} is no number; repair it") from None
        width = len(rows[0]) if rows else len(labels) or len(row)
        if len(row) != width or width > 2:
            raise BadInput(
                f"{source}: line {number}: has {len(row)} columns; "
                "one period is one column of values, or times and values"
            )
        if not all(map(math.isfinite, row)):
            raise BadInput(f"{source}: line {number}: {_short(line)} is not finite; repair it")
        rows.append(row)
    if len(rows) < 2:
        raise BadInput(f"{source}: has {len(rows)} values; one period takes at least 2")
    return labels, np.array(rows)
