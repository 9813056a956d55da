"""What is wrong with a device, in words: link, timing, converters, noise, limits, model, faults. Nothing moves."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from statistics import median
from typing import Any

import numpy as np

from phaselead.control.held import held_stage
from phaselead.device import TICK_HZ, Channel, Device, looser_than, read_limits, recording_of, status_in_units
from phaselead.device import Limits as HardLimits
from phaselead.model import AxisModel, Stage
from phaselead.record import AXES, Recording, Samples
from phaselead.result import Result, Table

ROUND_TRIPS = 32
SLOW_S = 0.012
"""FTDI's USB converters hold short answers back for 16 ms unless told otherwise (FT232R data sheet, section 8.4), USB
itself for 1 or 2 ms: the middle, as a ratio and a bit, tells them apart."""
LISTENED_TICKS = 2 * TICK_HZ // 5
"""A whole number of periods of 50 and of 60 Hz."""
RAIL_CODES = 64
"""From the end of a converter's range: docs/faults.md, adc_rail."""
MAINS_Hz = (50.0, 60.0)
HUM_SHARE = 0.5
"""Of the power of what a sensor at rest says."""


@dataclass(frozen=True)
class Check:
    """One thing that was looked at."""

    name: str
    ok: bool
    said: str


@dataclass(frozen=True)
class Diagnosis(Result):
    """All that was looked at; prints as a table."""

    checks: tuple[Check, ...]

    @property
    def healthy(self) -> bool:
        """Whether nothing is wrong."""
        return all(check.ok for check in self.checks)

    def as_dict(self) -> dict[str, Any]:
        """As ``phaselead doctor --json`` writes it."""
        return {"healthy": self.healthy, "checks": [vars(check) for check in self.checks]}

    @property
    def columns(self) -> dict[str, list[Any]]:
        """One entry for each check: name, ok, said."""
        return {name: [getattr(check, name) for check in self.checks] for name in ("name", "ok", "said")}

    def tables(self) -> list[Table | str]:
        rows = tuple((check.name, "good" if check.ok else "LOOK", check.said) for check in self.checks)
        wrong = sum(not check.ok for check in self.checks)
        said = "nothing is wrong" if not wrong else f"{wrong} of {len(rows)} want a look"
        return [Table(("", "", ""), rows), said]


def diagnose(device: Device) -> Diagnosis:
    """Asks the device and listens to its sensors for 0.4 s, without moving anything."""
    return Diagnosis(tuple(_checks(device)))


def _checks(device: Device) -> Iterator[Check]:
    info = device.info()
    yield _link(device)
    yield _timing(info)
    yield _fault(device, info)
    stage = held_stage(device)
    yield _model(info, stage)
    axes: Mapping[Any, AxisModel] = stage.axes if stage is not None else {}
    yield from (_limits(name, model) for name, model in axes.items())
    yield _hard_limits(read_limits(device), axes)
    status = status_in_units(device)
    if status.state != "parked":
        yield Check("sensors", False, f"the device is {status.state}; `phaselead park` it, then look again")
        return
    capture = device.capture(
        LISTENED_TICKS, axes="".join(AXES), channels=Channel.ADC | Channel.DAC, start=False, park=False
    )
    recording = recording_of(capture)
    for axis in AXES:
        codes = capture.axes[axis].adc
        assert codes is not None
        yield _sensor(axis, codes, recording)
    lost = capture.missing
    yield Check("stream", lost == 0, f"{lost} of {LISTENED_TICKS} ticks were lost" + (LOST if lost else ""))


LOST = "; use a shorter cable, another hub, or close what else uses the port"


def _link(device: Device) -> Check:
    session = device.session
    times_s = []
    before = session.retries
    for _ in range(ROUND_TRIPS):
        start_s = session.now_s()
        status = device.status()
        times_s.append(session.now_s() - start_s)
    usual_s, again = median(times_s), session.retries - before
    said = f"{session.name} answers within {1e3 * usual_s:.2g} ms"
    if again or status.rx_errors:
        return Check("link", False, f"{said}, {again} commands sent again, {status.rx_errors} frames damaged{LOST}")
    if usual_s > SLOW_S:
        return Check("link", False, f"{said}: an FTDI adapter holds answers back; set its latency timer to 1 ms")
    return Check("link", True, f"{said}, nothing sent twice")


def _timing(info: Mapping[str, Any]) -> Check:
    late = {name: info[name] for name in ("overruns", "latched_late", "lost_ticks") if info[name]}
    if late:
        said = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in late.items())
        return Check("tick", False, f"{said} since power-on; `phaselead explain tick_overrun`")
    return Check("tick", True, f"no tick of {info['tick_rate_Hz']} Hz late or lost")


def _fault(device: Device, info: Mapping[str, Any]) -> Check:
    status = device.status()
    if status.fault != "none":
        return Check("fault", False, f"{status.fault} is latched; `phaselead explain {status.fault}`, `phaselead park`")
    if info["last_fault"] != "none":
        return Check("fault", True, f"none now; the last was {info['last_fault']}")
    return Check("fault", True, f"none; last reset: {info['reset_cause'].replace('_', ' ')}")


def _model(info: Mapping[str, Any], stage: Stage | None) -> Check:
    if stage is None:
        return Check("model", False, "none: `phaselead identify`, then `phaselead upload M --persist`")
    if info["model_is_fallback"]:
        return Check("model", False, "the older of two in flash, the newer is damaged; upload and persist it again")
    views = {
        name: " and ".join(kind for kind, view in (("tables", m.table), ("inverse", m.time)) if view is not None)
        for name, m in stage.axes.items()
    }
    has = "; ".join(f"{name}: {what or 'limits only'}" for name, what in views.items())
    kept = "kept in flash" if info["model_persisted"] else "in memory only, gone at power-off (`upload --persist`)"
    return Check("model", bool(info["model_persisted"]), f"{info['model_crc']}, {kept}; {has}")


def _limits(axis: str, model: AxisModel) -> Check:
    limits, actuator = model.limits, model.actuator
    said = f"{limits.u_min_V:g}..{limits.u_max_V:g} V, {limits.slew_V_per_s:g} V/s, parked at {limits.u_park_V:g} V"
    if limits.u_max_V > actuator.u_max_V or limits.u_min_V < actuator.u_min_V:
        return Check(
            f"limits {axis}", False, f"{said}: beyond the converter's {actuator.u_min_V:.4g}..{actuator.u_max_V:.4g} V"
        )
    return Check(f"limits {axis}", True, said)


def _hard_limits(hard: HardLimits, axes: Mapping[str, AxisModel]) -> Check:
    if hard.lost:
        said = "were set and cannot be read any more, so nothing is armed: set them again with `phaselead limits`"
        return Check("hard limits", False, said)
    held = {axis: looser_than(model, hard[axis]) for axis, model in axes.items()}
    if any(held.values()):
        said = "; ".join(f"{axis}: {', '.join(phrases)}" for axis, phrases in held.items() if phrases)
        return Check("hard limits", False, f"{said}; bring the model's within them, or `phaselead limits`")
    own = "".join(axis for axis, limits in hard.axes.items() if limits)
    return Check("hard limits", True, f"set for {own}, none tighter than the model's" if own else "none are set")


def _sensor(axis: str, codes: Samples | Any, recording: Recording) -> Check:
    name, x_um = f"sensor {axis}", recording.axes[axis].x_um
    assert x_um is not None
    if codes.min() < RAIL_CODES or codes.max() > 65535 - RAIL_CODES:
        return Check(
            name, False, f"stands at the rail of its converter ({x_um.mean():.4g} um): is it connected and on?"
        )
    if np.ptp(codes) == 0:
        return Check(name, False, f"says {x_um[0]:.4g} um without any noise: it hangs, or its input is shorted")
    noise_um = float(x_um.std())
    said = f"at {x_um.mean():.4g} um, noise {1e3 * noise_um:.2g} nm rms ({codes.std():.2g} codes)"
    for f_Hz in MAINS_Hz:
        if hum_share(x_um, f_Hz) > HUM_SHARE:
            return Check(name, False, f"{said}, most of it mains hum at {f_Hz:g} Hz: look for ground loops and shields")
    return Check(name, True, said)


def hum_share(values: Samples, f_Hz: float) -> float:
    """Of the power of (n,) samples at the tick rate about their mean: what a line and its first two overtones have."""
    spectrum = np.abs(np.fft.rfft(values - values.mean())) ** 2
    lines = [round(k * f_Hz * len(values) / TICK_HZ) for k in (1, 2, 3)]
    total = float(spectrum.sum())
    return float(sum(spectrum[line] for line in lines)) / total if total > 0 else 0.0
