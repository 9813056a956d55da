"""The excitation that would best tell the members of a tie apart, or the sensor that is needed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from phaselead.effects import Effect, Place
from phaselead.gap.compare import TIE, Rival
from phaselead.gap.evidence import evidence
from phaselead.gap.grow import Growth, Named
from phaselead.gap.records import Run
from phaselead.gap.refit import fresh_columns
from phaselead.gap.residual import track
from phaselead.gap.result import NextExperiment
from phaselead.record.recording import Samples
from phaselead.stage.file import AxisModel

ROWS = 12_000
SECONDS = (2.0, 20.0)
SENSORS = {
    Place.AMPLIFIER: "a voltage monitor at the amplifier's output",
    Place.MECHANICS: "a second, faster position sensor (an interferometer)",
    Place.SENSOR: "a second position sensor of another kind",
    Place.ENVIRONMENT: "a temperature sensor and an accelerometer beside the stage",
}


@dataclass(frozen=True)
class Option:
    """One excitation: how it is called and its voltage at times (n,)."""

    waveform: str
    level_V: float
    band_Hz: tuple[float, float]
    bias_V: float
    seconds: float

    def voltage(self, t_s: Samples) -> Samples:
        """(n,) in V."""
        low = self.bias_V - self.level_V / 2
        return low + self.level_V * SHAPES[self.waveform](t_s, self)


def _multisine(t_s: Samples, option: Option) -> Samples:
    low, high = option.band_Hz
    f = np.unique(np.round(np.geomspace(max(low, 1 / option.seconds), high, 40) * option.seconds)) / option.seconds
    phases = np.pi * np.arange(len(f)) ** 2 / len(f)  # Schroeder 1970
    wave = np.sum([np.cos(2 * np.pi * a * t_s + p) / np.sqrt(a) for a, p in zip(f, phases, strict=True)], axis=0)
    fade = np.minimum(1.0, np.minimum(t_s, option.seconds - t_s) / (0.05 * option.seconds)).clip(min=0)
    return np.asarray(0.5 + 0.5 * fade * wave / np.abs(wave).max())


def _sine(t_s: Samples, option: Option) -> Samples:
    return np.asarray(0.5 - 0.5 * np.cos(2 * np.pi * option.band_Hz[0] * t_s))


def _triangle(t_s: Samples, option: Option) -> Samples:
    """Decaying: five loops, each four fifths of the one before."""
    corners, size = [0.5], 0.5
    for _ in range(5):
        corners += [0.5 + size, 0.5 - size]
        size *= 0.8
    return np.interp(t_s, np.linspace(0, option.seconds, len(corners) + 1), [*corners, 0.5])


def _steps(t_s: Samples, option: Option) -> Samples:
    levels = np.array([0.0, 1.0, 0.25, 0.75, 0.0])
    return np.asarray(levels[np.minimum((t_s / option.seconds * len(levels)).astype(int), len(levels) - 1)])


SHAPES = {"multisine": _multisine, "sine": _sine, "triangle": _triangle, "steps": _steps}


def options(axis: AxisModel, step_s: float) -> list[Option]:
    """A few dozen excitations within the limits of voltage and slew."""
    view, limits = axis.time, axis.limits
    assert view is not None
    low, high = max(view.u_range_V[0], limits.u_min_V), min(view.u_range_V[1], limits.u_max_V)
    if not low < high:
        low, high = view.u_range_V
    rate_Hz, found = 1 / step_s, []
    for share in (0.9, 0.3):
        level = share * (high - low)
        for bias in (0.5, 0.25, 0.75) if share < 0.5 else (0.5,):
            middle = low + bias * (high - low)
            if middle - level / 2 < low or middle + level / 2 > high:
                continue
            for seconds in SECONDS:
                for top in (0.02, 0.2):
                    found.append(Option("multisine", level, (1 / seconds, top * rate_Hz), middle, seconds))
                found.append(Option("triangle", level, (5 / seconds, 5 / seconds), middle, seconds))
                found.append(Option("steps", level, (1 / seconds, rate_Hz / 2), middle, seconds))
                found += [Option("sine", level, (f, f), middle, seconds) for f in (2 / seconds, 0.01 * rate_Hz)]
    t = np.arange(0, 1, step_s)
    slew = limits.slew_V_per_s
    return [o for o in found if o.waveform == "steps" or np.abs(np.diff(o.voltage(t))).max() / step_s <= slew]


def propose(growth: Growth, tied: Named, label: str | None) -> NextExperiment | None:
    """The option with the largest predicted least squared distance per second between the members of a tie."""
    members = [r for r in tied.rivals if r.effect.name in tied.tied]
    model = growth.bench.axis
    if len(members) < 2 or model.time is None:
        return None
    step_s = growth.bench.tracks()[0].run.step_s
    best: tuple[float, Option, float] | None = None
    for option in options(model, step_s):
        apart = min(_separation(growth, option, members[0], other, step_s) for other in members[1:])
        value = apart / option.seconds
        if best is None or value > best[0]:
            best = (value, option, apart)
    if best is None:
        return None
    _, option, apart = best
    sensor = None if apart >= TIE else sensor_for([m.effect for m in members])
    return NextExperiment(
        option.waveform, option.level_V, option.band_Hz, option.bias_V, label, option.seconds, apart, sensor
    )


def _separation(growth: Growth, option: Option, best: Rival, other: Rival, step_s: float) -> float:
    """Predicted squared distance after the other has been fitted to what the best would show."""
    n = min(round(option.seconds / step_s), ROWS)
    t = np.asarray(np.arange(n) * step_s, dtype=np.float64)  # of a long one the first rows, counted up
    u = option.voltage(t)
    run = Run("x", "train", t, u, np.zeros(n), None, 0, n, "proposed", "", {}, {})
    if not run.driven:
        return 0.0
    made = track(growth.bench.axis, run)
    made = replace(made, plays_V=None)
    metric = evidence([made], growth.bench.noise)
    columns = fresh_columns(made, other.fitted.entries, other.fitted.free)
    columns[:, -1] = made.answer(best.fitted.entries) - made.answer(other.fitted.entries)
    white = metric.project(0, columns)
    amounts, *_ = np.linalg.lstsq(white[:, :-1], white[:, -1], rcond=1e-8)
    left = white[:, -1] - white[:, :-1] @ amounts
    shown_s = n * step_s
    return float(left @ left) / growth.inflation * option.seconds / shown_s


def sensor_for(effects: Sequence[Effect]) -> str:
    """A sensor between the places where the members act."""
    places = sorted({e.place for e in effects})
    for place, words in SENSORS.items():
        if places[0] <= place and (places[-1] > place or place == places[-1]):
            return words
    return SENSORS[Place.SENSOR]
