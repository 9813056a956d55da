"""A stage file as parameters of the plant kernel."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from importlib import resources
from pathlib import Path

import numpy as np

from phaselead.errors import BadInput
from phaselead.model import AxisModel, Stage, load_stage, parse_stage
from phaselead.sim.linked import creep_terms, linked_parameters, mode_terms
from phaselead.sim.structures import LinkedParameters
from phaselead.sim.terms import Terms

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
        ("linked", ctypes.POINTER(LinkedParameters)),
        ("axes", AxisParameters * 3),
    )


def _creep(axis: AxisParameters, terms: Terms) -> None:
    for k, tau_s in zip(*creep_terms(terms), strict=True):
        axis.creep_k[axis.creeps] = k
        axis.creep_tau_s[axis.creeps] = tau_s
        axis.creeps += 1


def _resonance(axis: AxisParameters, terms: Terms) -> None:
    for c, f_Hz, zeta in zip(*mode_terms(terms), strict=True):
        axis.mode_c[axis.modes] = c
        axis.mode_f_Hz[axis.modes] = f_Hz
        axis.mode_zeta[axis.modes] = zeta
        axis.modes += 1


def _sensor_lowpass(axis: AxisParameters, terms: Terms) -> None:
    axis.sensor_corner_Hz = terms.corner_Hz()


def _delay(axis: AxisParameters, terms: Terms) -> None:
    axis.delay_ticks += terms.one("delay_s", low=0.0) / TICK_S


def _offset(axis: AxisParameters, terms: Terms) -> None:
    axis.offset_um += terms.one("offset_um")


EXACT: dict[str, Callable[[AxisParameters, Terms], None]] = {
    "creep": _creep,
    "resonance": _resonance,
    "sensor_lowpass": _sensor_lowpass,
    "delay": _delay,
    "offset": _offset,
}
"""Effects of the exact kernel; a stage with any other is stepped by the linked one."""


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
    for name, axis in stage.axes.items():
        if axis.time is None:
            raise BadInput(
                f"stage {stage.name!r}, axis {name}: only a table view, which cannot be simulated; "
                "give a stage file with a time view"
            )
    linked = not all(_is_exact(model) for model in stage.axes.values())
    for i, name in enumerate(AXES):
        where, model = f"stage {stage.name!r}, axis {name}", stage.axes.get(name)
        _fill_converters(parameters.axes[i], model or AxisModel(), where)
        parameters.axes[i].delay_ticks = LATCH_S / TICK_S
        if model is not None and not linked:
            _fill_axis(parameters.axes[i], model, where)
    if linked:
        parameters.linked = ctypes.pointer(linked_parameters(stage, TICK_S, LATCH_S, seed))
    return parameters


def _is_exact(model: AxisModel) -> bool:
    """Whether the exact kernel can be this axis: a short delay, and each of its effects once, with room for it."""
    names = [effect.name for effect in model.effects]
    once = all(names.count(name) == 1 for name in names if name not in ("delay", "offset"))
    modes = [np.size(effect.params.get("f_Hz", 0)) for effect in model.effects if effect.name == "resonance"]
    delays = [effect.params.get("delay_s", 0.0) for effect in model.effects if effect.name == "delay"]
    assert model.time is not None
    delay_s = LATCH_S + model.time.delay_s + sum(float(d) for d in delays if isinstance(d, (int, float)))
    return set(names) <= set(EXACT) and once and sum(modes) <= MODES and delay_s / TICK_S < DELAY_TICKS - 1


def _fill_axis(axis: AxisParameters, model: AxisModel, where: str) -> None:
    _fill_time_view(axis, model, where)
    for effect in model.effects:
        EXACT[effect.name](axis, Terms(effect.name, effect.params, where))


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
