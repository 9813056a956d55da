"""What is known of one axis: its time-domain view, limits, converters, gains and adopted effects.

The parts of a stage file (``stage_file``) that the operator and the effects work with. Every key is described by its
``Field``; the same words become the comments of a saved file.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from phaselead.model.field import LARGEST_BEND, EffectiveField
from phaselead.model.fields import Interval95, NotNegative, Number, Numbers, ParameterValue, Part, Positive, Span
from phaselead.model.loop_filter import SECTIONS_IN_LOOP, LoopFilter
from phaselead.model.play_density import MOST_UNEVEN, PlayDensity
from phaselead.model.table import TableView
from phaselead.model.validation_errors import fault

LONGEST_DELAY_S = 10.0
"""No sensor, amplifier or converter is dead for longer: a slower answer is creep or drift. Fits stay below it too."""

Bits = Annotated[int, Field(strict=True, ge=1, le=32)]


class Limits(Part):
    """What the device may put out. They apply at upload, never to a fit or a prediction."""

    u_min_V: Number = Field(-2.0, description="lowest output, V")
    u_max_V: Number = Field(10.0, description="highest output, V")
    u_park_V: Number = Field(0.0, description="safe value, V: reached on park, stop and faults")
    slew_V_per_s: Positive = Field(1000.0, description="largest rate of the output, V/s")
    ramp_V_per_s: Positive = Field(50.0, description="rate of parking, V/s; at most slew_V_per_s")
    error_um: NotNegative = Field(0.0, description="under feedback: so far off is a fault; 0: a quarter of the sensor")
    error_s: Positive = Field(0.1, description="once it has lasted this long, s")
    oscillation_um: NotNegative = Field(
        0.0,
        description="under feedback, rms above the loop's band: growing to more is a fault; 0: a 256th of the sensor",
    )

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
    bandwidth_Hz: Positive | None = Field(None, description="bandwidth (-3 dB, first order), Hz; left out: not known")

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
    """x(t) = offset + gain v + sum w_i read(play_ri[v]) + sum s_j max(v - d_j, 0), with v(t) = field(u(t - delay))."""

    gain_um_per_V: Number = Field(description="linear gain, um/V")
    play_r_V: Numbers = Field((), description="thresholds of the plays, V, rising")
    play_w_um_per_V: Numbers = Field((), description="their weights, um/V, not negative but with a negative gain")
    deadzone_d_V: Numbers = Field((), description="thresholds of the one-sided dead zones, V, rising")
    deadzone_s_um_per_V: Numbers = Field((), description="their slopes, um/V")
    offset_um: Number = Field(0.0, description="offset, um")
    delay_s: Annotated[NotNegative, Field(le=LONGEST_DELAY_S)] = Field(0.0, description="dead time, s")
    rest_fraction: Annotated[Number, Field(ge=-1, le=1)] = Field(
        0.0, description="plays of a stage at rest at 0 V stand at this fraction of their thresholds"
    )
    field_bend: Annotated[Number, Field(ge=-LARGEST_BEND, le=LARGEST_BEND)] = Field(
        0.0, description="how far the field lags behind the voltage at mid-range, of half the range; 0: it rises evenly"
    )
    play_tilt: Number = Field(
        0.0, description="how much more plays weigh that stand at the top of the range than at mid-range, as a share"
    )
    play_taper: Number = Field(
        0.0, description="how much less they weigh at both ends than at mid-range; 0 and 0: the same at all levels"
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

    @field_validator("play_r_V")
    @classmethod
    def _none_negative(cls, values: tuple[float, ...]) -> tuple[float, ...]:
        for i, value in enumerate(values):
            if value < 0:
                fault(f"= {value:g} is negative; it must be 0 or more", f"[{i}]")
        return values

    @model_validator(mode="after")
    def _one_direction(self) -> Self:
        """Weights are negative where the sensor counts backwards: all of them, and the gain."""
        falls = self.gain_um_per_V < 0 and max(self.play_w_um_per_V, default=0.0) <= 0
        for i, w in enumerate(self.play_w_um_per_V):
            if w < 0 and not falls:
                fault(f"= {w:g} is negative; it must be 0 or more", f".play_w_um_per_V[{i}]")
        return self

    @model_validator(mode="after")
    def _paired(self) -> Self:
        pairs = (("play_w_um_per_V", "play_r_V"), ("deadzone_s_um_per_V", "deadzone_d_V"))
        for name, thresholds in pairs:
            have, wanted = len(getattr(self, name)), len(getattr(self, thresholds))
            if have != wanted:
                fault(f"has {have} elements but {thresholds} has {wanted}; give one for each", f".{name}")
        return self

    @model_validator(mode="after")
    def _plays_weigh(self) -> Self:
        uneven = abs(self.play_tilt) + abs(self.play_taper)
        if uneven > MOST_UNEVEN:
            fault(
                f"= {self.play_tilt:g} and play_taper = {self.play_taper:g} take more than {MOST_UNEVEN:g} of the "
                "weight together; make them smaller",
                ".play_tilt",
            )
        return self

    @property
    def field(self) -> EffectiveField:
        """What gain, plays and dead zones answer to; their volts are its volts."""
        return EffectiveField(self.field_bend, self.u_range_V)

    @property
    def is_even(self) -> bool:
        """Whether it is the same at all levels: its field is the voltage, and its plays weigh the same everywhere."""
        return not (self.field_bend or self.play_tilt or self.play_taper)

    @property
    def density(self) -> PlayDensity:
        """How the weight of a play depends on where it stands in that field."""
        low_V, high_V = self.u_range_V
        return PlayDensity(self.play_tilt, self.play_taper, (self.field.at(low_V), self.field.at(high_V)))


class Gains(Part):
    """PID gains (Xu & Li 2010, eq. 13), as ``track`` takes them.

    >>> import phaselead as pl
    >>> gains = pl.Gains(kp_V_per_um=0, ki_V_per_um_s=2.0, kd_V_s_per_um=0)
    >>> with pl.connect() as dev:
    ...     run = dev.track("sine:20um@5Hz", mode="pid", gains=gains, duration=0.4)
    """

    kp_V_per_um: Number = Field(description="proportional, V/um")
    ki_V_per_um_s: Number = Field(description="integral, V/(um s)")
    kd_V_s_per_um: Number = Field(description="derivative, V s/um")
    derivative_filter_Hz: Positive | None = Field(None, description="derivative filter, Hz; left out: none")
    origin: str | None = Field(None, description="where they come from; left out: somebody's choice")
    filters: tuple[LoopFilter, ...] | None = Field(
        None,
        min_length=1,
        max_length=SECTIONS_IN_LOOP,
        description="second-order filters behind the PID, one after the other; left out: none",
    )

    def sent(self) -> dict[str, Any]:
        """What a device is given of them, by name."""
        return {name: getattr(self, name) for name in type(self).model_fields if name != "origin"}


AdoptedStatus = Literal["named", "provisional"]
"""Whether the data demand an effect by name, or a model with it merely predicts better."""


class AdoptedEffect(Part):
    """One adopted effect: what it is, how large, how sure, and what it bought."""

    name: str = Field(description="which effect")
    status: AdoptedStatus = Field("named", description="named, or provisional: it predicts better, but may not be it")
    params: dict[str, ParameterValue] = Field({}, description="its parameters, units in the names")
    ci95: dict[str, Interval95] = Field({}, description="their 95 % intervals, [low, high]")
    share: Annotated[Number, Field(ge=0, le=1)] | None = Field(
        None, description="share of the unexplained power it explains"
    )

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
    effects: tuple[AdoptedEffect, ...] = ()
