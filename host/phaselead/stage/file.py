"""The stage file: everything known about a stage, as TOML that a person can read and edit.

Two views of the same measurements per axis (``table`` and ``time``), limits, converter calibration, adopted
effects, the cross-coupling of the axes, and where it all came from. Every key is described by its ``Field``;
the same words become the comments of a saved file.
"""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import (
    AfterValidator,
    Field,
    StringConstraints,
    ValidationError,
    field_validator,
    model_validator,
)

from phaselead.errors import BadInput
from phaselead.record.atomic import write_text
from phaselead.stage.fields import (
    Interval95,
    Matrix3,
    NotNegative,
    Number,
    Numbers,
    Parameter,
    Part,
    Positive,
    Span,
    explain,
    fault,
)
from phaselead.stage.layout import toml_text
from phaselead.stage.table import TableView

FORMAT: Literal["phaselead-stage"] = "phaselead-stage"
VERSION: Literal[1] = 1
LARGEST_FILE = 16 * 2**20

EFFECT_NAMES = (
    "hysteresis", "asymmetric_hysteresis", "rate_dependence", "softening", "creep", "resonance",
    "load_change", "amplifier_lowpass", "slew_limit", "saturation", "delay", "charge_leakage",
    "sensor_lowpass", "sensor_nonlinearity", "gain_change", "offset", "quantisation", "thermal_drift",
    "mains_hum", "vibration", "cross_coupling", "backlash", "sampling_jitter", "dac_nonlinearity",
)  # fmt: skip


def _axis_name(name: str) -> str:
    if name not in ("x", "y", "z"):
        fault("is no axis; there are x, y and z")
    return name


AxisName = Annotated[str, AfterValidator(_axis_name)]
Sha256 = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
Bits = Annotated[int, Field(strict=True, ge=1, le=32)]


def _catalogue() -> Collection[str]:
    """All effects, those of files added since included; imported late, for they know this module."""
    from phaselead.effects import catalogue

    return catalogue()


class DataSource(Part):
    """A recording the stage was fitted on."""

    file: str = Field(description="name of the recording")
    sha256: Sha256 = Field(description="SHA-256 of its bytes")


class Provenance(Part):
    """Where the stage file came from."""

    parent_sha256: Sha256 | None = Field(None, description="hash of the stage file this one was derived from")
    data: tuple[DataSource, ...] = Field((), description="recordings it was fitted on")
    tool: str = Field("", description="program and version that wrote it")
    created: str = Field("", description="when, ISO 8601")

    @field_validator("parent_sha256", mode="before")
    @classmethod
    def _empty_is_none(cls, value: object) -> object:
        return None if value == "" else value


class Limits(Part):
    """What the device may put out. They apply at upload, never to a fit or a prediction."""

    u_min_V: Number = Field(-2.0, description="lowest output, V")
    u_max_V: Number = Field(10.0, description="highest output, V")
    u_park_V: Number = Field(0.0, description="safe value, V: reached on park, stop and faults")
    slew_V_per_s: Positive = Field(1000.0, description="largest rate of the output, V/s")
    ramp_V_per_s: Positive = Field(50.0, description="rate of parking, V/s; at most slew_V_per_s")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if not self.u_min_V < self.u_max_V:
            fault(f"= {self.u_max_V:g} is not above u_min_V = {self.u_min_V:g}; raise it", ".u_max_V")
        if not self.u_min_V <= self.u_park_V <= self.u_max_V:
            fault(f"= {self.u_park_V:g} is outside u_min_V..u_max_V; park inside the limits", ".u_park_V")
        if self.ramp_V_per_s > self.slew_V_per_s:
            fault(f"= {self.ramp_V_per_s:g} is faster than slew_V_per_s; lower it", ".ramp_V_per_s")
        return self


class Sensor(Part):
    """Position sensor and its converter."""

    x_min_um: Number = Field(-10.0, description="position of the lowest code, um")
    x_max_um: Number = Field(270.0, description="position one past the highest code, um")
    bits: Bits = Field(16, description="resolution of the converter, bits")
    noise_um_rms: NotNegative = Field(0.01, description="noise, um rms")
    bandwidth_Hz: Positive = Field(10000.0, description="bandwidth, Hz")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if not self.x_min_um < self.x_max_um:
            fault(f"= {self.x_max_um:g} is not above x_min_um = {self.x_min_um:g}", ".x_max_um")
        return self


class Actuator(Part):
    """Output converter, scaled to control volts."""

    u_min_V: Number = Field(-10.24, description="voltage of the lowest code, V")
    u_max_V: Number = Field(10.24, description="voltage one past the highest code, V")
    bits: Bits = Field(16, description="resolution of the converter, bits")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if not self.u_min_V < self.u_max_V:
            fault(f"= {self.u_max_V:g} is not above u_min_V = {self.u_min_V:g}", ".u_max_V")
        return self


class TimeView(Part):
    """x(t) = offset + gain v + sum w_i play_ri[v] + sum s_j max(v - d_j, 0), with v(t) = u(t - delay)."""

    gain_um_per_V: Number = Field(description="linear gain, um/V")
    play_r_V: Numbers = Field((), description="thresholds of the plays, V, rising")
    play_w_um_per_V: Numbers = Field((), description="their weights, um/V, not negative")
    deadzone_d_V: Numbers = Field((), description="thresholds of the one-sided dead zones, V, rising")
    deadzone_s_um_per_V: Numbers = Field((), description="their slopes, um/V")
    offset_um: Number = Field(0.0, description="offset, um")
    delay_s: Annotated[NotNegative, Field(le=10)] = Field(0.0, description="dead time, s")
    rest_fraction: Annotated[Number, Field(ge=-1, le=1)] = Field(
        0.0, description="plays of a stage at rest at 0 V stand at this fraction of their thresholds"
    )
    u_range_V: Span = Field(description="voltages it was fitted on, V")
    rate_Hz: Positive = Field(description="sampling rate it was fitted at, Hz")
    residual_um_rms: NotNegative = Field(0.0, description="what the fit left over, um rms")

    @field_validator("play_r_V", "deadzone_d_V")
    @classmethod
    def _strictly_rising(cls, values: tuple[float, ...]) -> tuple[float, ...]:
        for i in range(1, len(values)):
            if not values[i - 1] < values[i]:
                fault(f"= {values[i]:g} is not above the threshold before it; sort them, each once", f"[{i}]")
        return values

    @field_validator("play_r_V", "play_w_um_per_V")
    @classmethod
    def _none_negative(cls, values: tuple[float, ...]) -> tuple[float, ...]:
        for i, value in enumerate(values):
            if value < 0:
                fault(f"= {value:g} is negative; it must be 0 or more", f"[{i}]")
        return values

    @model_validator(mode="after")
    def _paired(self) -> Self:
        pairs = (("play_w_um_per_V", "play_r_V"), ("deadzone_s_um_per_V", "deadzone_d_V"))
        for name, thresholds in pairs:
            have, wanted = len(getattr(self, name)), len(getattr(self, thresholds))
            if have != wanted:
                fault(f"has {have} elements but {thresholds} has {wanted}; give one for each", f".{name}")
        return self


class Gains(Part):
    """PID gains (Xu & Li 2010, eq. 13)."""

    kp_V_per_um: Number = Field(description="proportional, V/um")
    ki_V_per_um_s: Number = Field(description="integral, V/(um s)")
    kd_V_s_per_um: Number = Field(description="derivative, V s/um")
    derivative_filter_Hz: Positive | None = Field(None, description="derivative filter, Hz; left out: none")


class Effect(Part):
    """One adopted effect: what it is, how large, how sure, and what it bought."""

    name: str = Field(description="which effect")
    params: dict[str, Parameter] = Field({}, description="its parameters, units in the names")
    ci95: dict[str, Interval95] = Field({}, description="their 95 % intervals, [low, high]")
    share: Annotated[Number, Field(ge=0, le=1)] | None = Field(
        None, description="share of the unexplained power it explains"
    )

    @field_validator("name")
    @classmethod
    def _known(cls, name: str) -> str:
        if name not in EFFECT_NAMES and name not in _catalogue():
            fault(f"is no known effect; one of: {', '.join(EFFECT_NAMES)}")
        return name

    @model_validator(mode="after")
    def _intervals_belong(self) -> Self:
        for name in self.ci95:
            if name not in self.params:
                fault("is an interval of no parameter; remove it or name it like its parameter", f".ci95.{name}")
        return self


class AxisModel(Part):
    """One axis of the stage."""

    limits: Limits = Limits()
    sensor: Sensor = Sensor()
    actuator: Actuator = Actuator()
    gains: Gains | None = None
    table: TableView | None = None
    time: TimeView | None = None
    effects: tuple[Effect, ...] = ()


class Stage(Part):
    """A stage file. ``axes`` is keyed "x", "y", "z"; ``cross_coupling[i][j]`` is what i sees of j."""

    format: Literal["phaselead-stage"] = FORMAT
    version: Literal[1] = VERSION
    name: str = Field(description="name of the stage")
    provenance: Provenance = Provenance()
    cross_coupling: Matrix3 | None = Field(
        None, description="row: responding axis, column: driven axis (x, y, z); diagonal 1"
    )
    axes: dict[AxisName, AxisModel] = Field(min_length=1)

    @field_validator("cross_coupling")
    @classmethod
    def _diagonal_is_one(cls, matrix: Matrix3 | None) -> Matrix3 | None:
        for i, row in enumerate(matrix or ()):
            if row[i] != 1:
                fault(f"= {row[i]:g}: must be 1; an axis' own gain belongs to its own model", f"[{i}][{i}]")
        return matrix

    @property
    def sha256(self) -> str:
        """Hash of the content: keys and exact values, not comments or layout."""
        content = self.model_dump(mode="json", exclude_none=True)
        canonical = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
        return hashlib.sha256(canonical.encode()).hexdigest()

    def axis(self, name: str) -> AxisModel:
        """The model of one axis; BadInput when the stage has none."""
        if name not in self.axes:
            raise BadInput(
                f"stage {self.name!r} has no axis {name}; it has {', '.join(sorted(self.axes))}: "
                f"choose one of these, or identify {name}"
            )
        return self.axes[name]


def load_stage(path: str | Path) -> Stage:
    """Read a stage file. Raises BadInput with one line that names the file, the key and the fix."""
    try:
        with open(path, "rb") as file:
            content = file.read(LARGEST_FILE + 1)
    except OSError as error:
        raise BadInput(f"{path}: cannot be read ({error.strerror}); give a stage file (.toml)") from None
    except ValueError:  # a NUL in the path
        raise BadInput(f"{path!r}: is no file name; give a stage file (.toml)") from None
    if len(content) > LARGEST_FILE:
        raise BadInput(f"{path}: is larger than any stage file (16 MiB); is it one?")
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError:
        raise BadInput(f"{path}: is not text; a stage file is TOML in UTF-8") from None
    return parse_stage(text, str(path))


def parse_stage(text: str, source: str = "stage") -> Stage:
    """A stage from the text of its file; ``source`` names it in messages."""
    try:
        content = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())[:200]
        raise BadInput(f"{source}: is not TOML: {reason}; repair the line, or fit the stage file again") from None
    if content.get("format") != FORMAT:
        raise BadInput(f'{source}: is no stage file; one begins with format = "{FORMAT}"')
    version = content.get("version")
    if isinstance(version, int) and version > VERSION:
        raise BadInput(
            f"{source}: was written by a newer phaselead (format version {version}; this one knows "
            f"{VERSION}); update phaselead"
        )
    try:
        return Stage.model_validate(content)
    except ValidationError as error:
        raise BadInput(f"{source}: {explain(error, Stage)}") from None


def save_stage(path: str | Path, stage: Stage, *, overwrite: bool = True) -> None:
    """Write a commented stage file, whole or not at all. ``load_stage`` gives back an equal Stage."""
    write_text(path, stage_text(stage), overwrite=overwrite)


def stage_text(stage: Stage) -> str:
    """The commented TOML of a stage."""
    return toml_text(stage)
