"""A stage file as parameters of the plant kernel."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from urllib.parse import parse_qsl

from phaselead.device import AXES
from phaselead.errors import BadInput
from phaselead.model import (
    HOLD_S,
    LATCH_S,
    TICK_S,
    AxisModel,
    NotPlayed,
    Place,
    Provenance,
    Stage,
    VirtualAxis,
    load_stage,
    parse_stage,
)
from phaselead.serial_ports import behind_line
from phaselead.sim.linked import add_effects, linked_parameters
from phaselead.sim.structures import LinkedParameters

DEFAULT_STAGE = "xyz250"
"""Behind an emulated board, unless another is named."""
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


class ExactParts(VirtualAxis):
    """The parts that the exact kernel plays: one set of lags, modes and a low-pass, any number of delays and offsets.

    Nothing is written before it is known that the kernel can be the axis.
    """

    def __init__(self, model: AxisModel, where: str) -> None:
        super().__init__(model, where)
        self._creep: list[tuple[float, float]] = []
        self._modes: list[tuple[float, float, float]] = []
        self._corner_Hz = 0.0
        self._delays_s: list[float] = []
        self._offsets_um: list[float] = []
        self._taken: set[Place] = set()

    def lags(self, k: Sequence[float], tau_s: Sequence[float]) -> None:
        self._only_at(Place.CREEP)
        self._creep = list(zip(k, tau_s, strict=True))

    def modes(self, c: Sequence[float], f_Hz: Sequence[float], zeta: Sequence[float]) -> None:
        self._only_at(Place.MECHANICS)
        self.has_modes = True
        self._modes = list(zip(c, f_Hz, zeta, strict=True))

    def lowpass(self, tau_s: float, corner_Hz: float | None = None) -> None:
        self._only_at(Place.SENSOR)
        own_Hz = 1 / (2 * math.pi * tau_s) if tau_s > 0 else 0.0
        self._corner_Hz = own_Hz if corner_Hz is None else corner_Hz

    def delay(self, delay_s: float) -> None:
        self._delays_s.append(delay_s)

    def offset(self, offset_um: float) -> None:
        self._offsets_um.append(offset_um)

    def _only_at(self, place: Place) -> None:
        """The kernel has one of these, there."""
        if self.place != place or place in self._taken:
            raise NotPlayed
        self._taken.add(place)

    def refuse_more_than_it_holds(self) -> None:
        """Raises NotPlayed for a bent field or uneven plays, too many lags or modes, or a delay that its ring of ticks
        cannot hold."""
        assert self.model.time is not None
        if not self.model.time.is_even:
            raise NotPlayed
        delay_s = LATCH_S + self.model.time.delay_s + sum(self._delays_s)
        if len(self._creep) > CREEPS or len(self._modes) > MODES or not delay_s / TICK_S < DELAY_TICKS - 1:
            raise NotPlayed

    def fill(self, axis: AxisParameters) -> None:
        """Write it all. Raises BadInput when the time view is larger than the kernel's."""
        _fill_time_view(axis, self.model, self.where)
        axis.creeps, axis.modes, axis.sensor_corner_Hz = len(self._creep), len(self._modes), self._corner_Hz
        for i, (k, tau_s) in enumerate(self._creep):
            axis.creep_k[i], axis.creep_tau_s[i] = k, tau_s
        for i, (c, f_Hz, zeta) in enumerate(self._modes):
            axis.mode_c[i], axis.mode_f_Hz[i], axis.mode_zeta[i] = c, f_Hz, zeta
        for delay_s in self._delays_s:
            axis.delay_ticks += delay_s / TICK_S
        for offset_um in self._offsets_um:
            axis.offset_um += offset_um


def built_in(name: str) -> Stage:
    """A stage of the package, by name. Raises BadInput when there is none of that name."""
    folder = resources.files("phaselead.sim")
    text = folder.joinpath(f"{name}.toml")
    if not name.replace("-", "_").isidentifier() or not text.is_file():
        names = sorted(one.name.removesuffix(".toml") for one in folder.iterdir() if one.name.endswith(".toml"))
        ports = ", ".join(f"sim://{known}" for known in names)
        raise BadInput(f"there is no built-in stage {name!r}; use sim://FILE.toml, or one of {ports}")
    return parse_stage(text.read_text("utf-8"), name)


def data_sheet(url: str) -> Stage | None:
    """Limits, sensor and converter of the built-in stage that a port's URL names, and nothing else of it; None for
    another port. What its user would read on paper."""
    scheme, _, place = behind_line(url).partition("://")
    name, _, query = place.partition("?")
    if scheme == "qemu":
        name = dict(parse_qsl(query)).get("stage", DEFAULT_STAGE)
    if scheme not in ("sim", "qemu") or _is_file(name):
        return None
    known = {
        axis: AxisModel(limits=m.limits, sensor=m.sensor, actuator=m.actuator)
        for axis, m in built_in(name).axes.items()
    }
    return Stage(name=name, axes=known)


def stage_at(url: str) -> Stage:
    """The stage that answers at a port ``sim://NAME`` or ``sim://FILE.toml``. Raises BadInput when there is none."""
    return load_any(url.partition("://")[2].partition("?")[0])


def load_any(place: str) -> Stage:
    """A stage by the name of a built-in one or the path of a stage file (one with a slash or a suffix)."""
    return load_stage(Path(place)) if _is_file(place) else built_in(place)


def _is_file(place: str) -> bool:
    return "/" in place or place.endswith(".toml")


def virtual_stage(model: Stage) -> Stage:
    """The virtual stage that answers as a model says. The delay of a model counts from the straight lines between the
    rows of recordings; that of a virtual stage from where the output is latched, since the simulator holds and latches
    by itself. A stage file that names recordings it was fitted on is a model, any other a virtual stage."""
    axes = {name: _from_latch(axis) for name, axis in model.axes.items()}
    return model.model_copy(update={"axes": axes, "provenance": Provenance()})


def _from_latch(axis: AxisModel) -> AxisModel:
    if axis.time is None:
        return axis
    delay_s = max(axis.time.delay_s - HOLD_S, 0.0)
    return axis.model_copy(update={"time": axis.time.model_copy(update={"delay_s": delay_s})})


def plant_parameters(stage: Stage, seed: int = 0) -> PlantParameters:
    """Kernel parameters of a stage at rest. Axes the file does not have stand still at 0 um. Of a model, those of its
    ``virtual_stage``.

    Raises:
        BadInput: an axis has no time view, or an effect the simulator does not know.
    """
    stage = virtual_stage(stage) if stage.provenance.data else stage
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
    for i, name in enumerate(AXES):
        _fill_converters(parameters.axes[i], stage.axes.get(name) or AxisModel(), _where(stage, name))
        parameters.axes[i].delay_ticks = LATCH_S / TICK_S
    exact = _exact_parts(stage)
    if exact is None:
        parameters.linked = ctypes.pointer(linked_parameters(stage, TICK_S, LATCH_S, seed))
    for name, parts in (exact or {}).items():
        parts.fill(parameters.axes[AXES.index(name)])
    return parameters


def _where(stage: Stage, axis: str) -> str:
    return f"stage {stage.name!r}, axis {axis}"


def _exact_parts(stage: Stage) -> dict[str, ExactParts] | None:
    """Of every axis; None when the exact kernel cannot be all of them and the linked one steps the stage."""
    found = {name: ExactParts(model, _where(stage, name)) for name, model in stage.axes.items()}
    try:
        for parts in found.values():
            add_effects(parts)
            parts.refuse_more_than_it_holds()
    except NotPlayed:
        return None
    return found


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
