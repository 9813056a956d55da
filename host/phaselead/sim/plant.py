"""A stage file as parameters of the plant kernel."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Sequence
from importlib import resources
from pathlib import Path

from phaselead.errors import BadInput
from phaselead.stage.file import AxisModel, Effect, Stage, load_stage, parse_stage

TICK_S = 1 / 5000
LATCH_S = 20e-6
"""From the sample of a tick to its DAC output, in every build of the firmware."""
AXES = "xyz"
PLAYS, DEADZONES, CREEPS, MODES, DELAY_TICKS = 64, 32, 8, 4, 63
"""Bounds of the kernel, as in plant.h."""


class AxisParameters(ctypes.Structure):
    """struct plant_axis_parameters of plant.h; the meanings are there."""

    _fields_ = (
        ("dac_zero_code", ctypes.c_double),
        ("dac_V_per_code", ctypes.c_double),
        ("adc_x_min_um", ctypes.c_double),
        ("adc_codes_per_um", ctypes.c_double),
        ("adc_code_max", ctypes.c_double),
        ("delay_ticks", ctypes.c_double),
        ("gain_um_per_V", ctypes.c_double),
        ("offset_um", ctypes.c_double),
        ("play_r_V", ctypes.c_double * PLAYS),
        ("play_w_um_per_V", ctypes.c_double * PLAYS),
        ("play_start_V", ctypes.c_double * PLAYS),
        ("deadzone_d_V", ctypes.c_double * DEADZONES),
        ("deadzone_s_um_per_V", ctypes.c_double * DEADZONES),
        ("creep_k", ctypes.c_double * CREEPS),
        ("creep_tau_s", ctypes.c_double * CREEPS),
        ("mode_c", ctypes.c_double * MODES),
        ("mode_f_Hz", ctypes.c_double * MODES),
        ("mode_zeta", ctypes.c_double * MODES),
        ("sensor_corner_Hz", ctypes.c_double),
        ("noise_um_rms", ctypes.c_double),
        ("plays", ctypes.c_uint32),
        ("deadzones", ctypes.c_uint32),
        ("creeps", ctypes.c_uint32),
        ("modes", ctypes.c_uint32),
    )


class PlantParameters(ctypes.Structure):
    """struct plant_parameters of plant.h."""

    _fields_ = (
        ("tick_s", ctypes.c_double),
        ("coupling", ctypes.c_double * 3 * 3),
        ("seed", ctypes.c_uint64),
        ("axes", AxisParameters * 3),
    )


class _Terms:
    """The parameters of one effect, taken out by name, each checked and each used once."""

    def __init__(self, effect: Effect, where: str) -> None:
        self._left = dict(effect.params)
        self._where = f"{where}: effect {effect.name!r}"

    def numbers(self, name: str, *, default: Sequence[float] | None = None, most: int) -> list[float]:
        value = self._left.pop(name, None)
        if value is None:
            if default is None:
                raise BadInput(f"{self._where} has no parameter {name}; add it")
            return list(default)
        values = [float(value)] if isinstance(value, (int, float)) else [float(item) for item in value]
        if len(values) > most:
            raise BadInput(f"{self._where}: {name} has {len(values)} terms, the simulator takes {most}")
        return values

    def number(self, name: str) -> float:
        return self.numbers(name, most=1)[0]

    def positive(self, name: str, values: Sequence[float]) -> None:
        if not all(value > 0 for value in values):
            raise BadInput(f"{self._where}: {name} must be above 0")

    def alike(self, name: str, values: Sequence[float], count: int) -> None:
        if len(values) != count:
            raise BadInput(f"{self._where}: {name} has {len(values)} terms, its partner has {count}; give one for each")

    def done(self) -> None:
        if self._left:
            raise BadInput(f"{self._where}: unknown parameter {', '.join(sorted(self._left))}; remove it")


def _creep(axis: AxisParameters, terms: _Terms) -> None:
    room = CREEPS - axis.creeps
    k, tau_s = terms.numbers("k", most=room), terms.numbers("tau_s", most=room)
    terms.alike("tau_s", tau_s, len(k))
    terms.positive("tau_s", tau_s)
    for i in range(len(k)):
        axis.creep_k[axis.creeps] = k[i]
        axis.creep_tau_s[axis.creeps] = tau_s[i]
        axis.creeps += 1


def _resonance(axis: AxisParameters, terms: _Terms) -> None:
    room = MODES - axis.modes
    f_Hz, zeta = terms.numbers("f_Hz", most=room), terms.numbers("zeta", most=room)
    c = terms.numbers("c", default=[1.0] if len(f_Hz) == 1 else None, most=room)
    terms.alike("zeta", zeta, len(f_Hz))
    terms.alike("c", c, len(f_Hz))
    terms.positive("f_Hz", f_Hz)
    terms.positive("zeta", zeta)
    if any(value >= 1 for value in zeta):
        raise BadInput("effect 'resonance': zeta must be below 1 to be simulated")
    for i in range(len(f_Hz)):
        axis.mode_c[axis.modes] = c[i]
        axis.mode_f_Hz[axis.modes] = f_Hz[i]
        axis.mode_zeta[axis.modes] = zeta[i]
        axis.modes += 1


def _sensor_lowpass(axis: AxisParameters, terms: _Terms) -> None:
    corner_Hz = terms.number("corner_Hz")
    terms.positive("corner_Hz", [corner_Hz])
    axis.sensor_corner_Hz = corner_Hz


def _delay(axis: AxisParameters, terms: _Terms) -> None:
    axis.delay_ticks += terms.number("delay_s") / TICK_S


def _offset(axis: AxisParameters, terms: _Terms) -> None:
    axis.offset_um += terms.number("offset_um")


EFFECTS: dict[str, Callable[[AxisParameters, _Terms], None]] = {
    "creep": _creep,
    "resonance": _resonance,
    "sensor_lowpass": _sensor_lowpass,
    "delay": _delay,
    "offset": _offset,
}
"""Effects the simulator knows, by their name in a stage file."""


def built_in(name: str) -> Stage:
    """A stage of the package, by name. Raises BadInput when there is none of that name."""
    text = resources.files("phaselead.sim").joinpath(f"{name}.toml")
    if not name.isidentifier() or not text.is_file():
        raise BadInput(f"there is no built-in stage {name!r}; use sim://xyz250 or sim://FILE.toml")
    return parse_stage(text.read_text("utf-8"), name)


def load_any(place: str) -> Stage:
    """A stage by the name of a built-in one or the path of a stage file (one with a slash or a suffix)."""
    return load_stage(Path(place)) if "/" in place or place.endswith(".toml") else built_in(place)


def plant_parameters(stage: Stage, seed: int = 0) -> PlantParameters:
    """Kernel parameters of a stage at rest. Axes the file does not have stand still at 0 um.

    Raises:
        BadInput: an axis has no time view, or an effect the simulator does not know.
    """
    parameters = PlantParameters(tick_s=TICK_S, seed=seed)
    coupling = stage.cross_coupling
    for i in range(3):
        for j in range(3):
            parameters.coupling[i][j] = float(i == j) if coupling is None else coupling[i][j]
    for i, name in enumerate(AXES):
        model = stage.axes.get(name)
        _fill_axis(parameters.axes[i], model, f"stage {stage.name!r}, axis {name}")
    return parameters


def _fill_axis(axis: AxisParameters, model: AxisModel | None, where: str) -> None:
    _fill_converters(axis, model or AxisModel(), where)
    axis.delay_ticks = LATCH_S / TICK_S
    if model is None:
        return
    if model.time is None:
        raise BadInput(f"{where}: only a table view, which cannot be simulated; give a stage file with a time view")
    _fill_time_view(axis, model, where)
    for effect in model.effects:
        add = EFFECTS.get(effect.name)
        if add is None:
            raise BadInput(
                f"{where}: the simulator does not know effect {effect.name!r}; it knows {', '.join(EFFECTS)}"
            )
        terms = _Terms(effect, where)
        add(axis, terms)
        terms.done()
    if not 0 <= axis.delay_ticks < DELAY_TICKS:
        raise BadInput(f"{where}: a delay of {axis.delay_ticks * TICK_S:g} s; the simulator takes up to 12 ms")


def _fill_converters(axis: AxisParameters, model: AxisModel, where: str) -> None:
    sensor, actuator = model.sensor, model.actuator
    if sensor.bits > 16 or actuator.bits != 16:
        raise BadInput(f"{where}: the simulator has 16-bit converters (the sensor may have fewer bits)")
    codes = 65536
    axis.dac_V_per_code = (actuator.u_max_V - actuator.u_min_V) / codes
    axis.dac_zero_code = -actuator.u_min_V / axis.dac_V_per_code
    axis.adc_x_min_um = sensor.x_min_um
    axis.adc_codes_per_um = codes / (sensor.x_max_um - sensor.x_min_um)
    axis.adc_code_max = codes - 1
    axis.noise_um_rms = sensor.noise_um_rms


def _fill_time_view(axis: AxisParameters, model: AxisModel, where: str) -> None:
    view = model.time
    assert view is not None
    if len(view.play_r_V) > PLAYS or len(view.deadzone_d_V) > DEADZONES:
        raise BadInput(f"{where}: more plays or dead zones than the simulator takes ({PLAYS}, {DEADZONES})")
    axis.gain_um_per_V, axis.offset_um = view.gain_um_per_V, view.offset_um
    axis.delay_ticks = (LATCH_S + view.delay_s) / TICK_S
    axis.plays, axis.deadzones = len(view.play_r_V), len(view.deadzone_d_V)
    for i, (r_V, w) in enumerate(zip(view.play_r_V, view.play_w_um_per_V, strict=True)):
        axis.play_r_V[i], axis.play_w_um_per_V[i] = r_V, w
        axis.play_start_V[i] = view.rest_fraction * r_V
    for i, (d_V, s) in enumerate(zip(view.deadzone_d_V, view.deadzone_s_um_per_V, strict=True)):
        axis.deadzone_d_V[i], axis.deadzone_s_um_per_V[i] = d_V, s
    if not math.isfinite(axis.delay_ticks):
        raise BadInput(f"{where}: delay_s must be finite")
