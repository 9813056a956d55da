"""A controller against a simulated stage: the ticks, converters, latency and noise that the firmware meets."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from phaselead.device import TICK_HZ
from phaselead.model import Stage
from phaselead.sim import load_library, plant_parameters
from phaselead.sim.device import Plant
from rivals.evidence import TICK_S, Samples
from rivals.paths import Path

assert round(1 / TICK_S) == TICK_HZ
RAIL_SAMPLES = 3
"""At a rail of the sensor: the same in the firmware."""


class Controller(Protocol):
    """Made from evidence for a path; ``step`` gets a tick (0 where the path begins, negative on the way into it) and
    the measured position, and gives volts before limits."""

    def step(self, tick: int, measured_um: float) -> float: ...


@dataclass(frozen=True)
class Driven:
    """Path and true position in um (n,) at each tick from the begin of the path; what ended it early."""

    asked_um: Samples
    true_um: Samples
    ended: str | None


class Reference:
    """A path with a way into it: before 0 s it grows out of the rest over ``enter_s`` with position, speed and
    acceleration that do not jump. The device joins its paths in the same way."""

    def __init__(self, path: Path, enter_s: float, late_s: float = 0.0) -> None:
        self._path, self._enter_s, self._late_s = path, enter_s, late_s

    def __call__(self, t_s: float | Samples) -> Samples:
        """um at these times, which may be ahead."""
        t = np.asarray(t_s, np.float64) - self._late_s
        s = np.clip(1 + t / self._enter_s, 0.0, 1.0)
        return np.asarray(s**3 * (10 - 15 * s + 6 * s**2) * self._path(t))

    def by_tick(self, ahead_s: float = 0.0) -> Callable[[int], float]:
        """um at each tick of a run, looked up so far ahead."""
        first = round(self._enter_s / TICK_S) + 1
        ticks = np.arange(-first, round(self._path.seconds / TICK_S) + 2)
        values = self(ticks * TICK_S + ahead_s).tolist()
        return lambda tick: values[tick + first]


def drive(stage: Stage, controller: Controller, path: Path, *, enter_s: float, seed: int = 1) -> Driven:
    """Axis x from rest into the path and along it for as long as it takes. Limits of voltage and slew are the stage's;
    a sensor at its rail ends it."""
    library = load_library()
    parameters = plant_parameters(stage, seed)
    plant = Plant(parameters, library)
    axis, limits = parameters.axes[0], stage.axis("x").limits
    first, ticks = round(enter_s / TICK_S), round(path.seconds / TICK_S)
    plant.trace(first + ticks)
    adc, dac = (ctypes.c_uint16 * 3)(), (ctypes.c_uint16 * 3)()
    for i in range(3):
        dac[i] = round(parameters.axes[i].dac_zero_code)
    largest_step_V = limits.slew_V_per_s * TICK_S
    u_V, at_rail, ended = 0.0, 0, None
    sample, latch, handle = library.plant_sample, library.plant_drive, ctypes.c_void_p(plant.handle)
    sample.restype = latch.restype = None
    for tick in range(-first, ticks):
        sample(handle, adc)
        code = adc[0]
        at_rail = at_rail + 1 if code in (0, int(axis.adc_code_max)) else 0
        if at_rail >= RAIL_SAMPLES:
            ended = "rail"
            break
        wanted_V = controller.step(tick, axis.adc_x_min_um + code / axis.adc_codes_per_um)
        u_V += min(max(wanted_V - u_V, -largest_step_V), largest_step_V)
        u_V = min(max(u_V, limits.u_min_V), limits.u_max_V)
        dac[0] = round(axis.dac_zero_code + u_V / axis.dac_V_per_code)
        latch(handle, dac)
    true_um = plant.take_trace()[1][first:, 0]
    plant.close()
    return Driven(path(np.arange(len(true_um)) * TICK_S), true_um, ended)
