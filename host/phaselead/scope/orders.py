"""What a tab may ask for, by name: each an ordinary call of the Python API."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from math import isfinite
from pathlib import PurePath
from typing import Any

from phaselead.control import HOST_TIMEOUT_S, MODES, best_mode, gains_of, loop_of
from phaselead.device import TICK_HZ
from phaselead.errors import BadInput
from phaselead.model import Stage, load_stage
from phaselead.record import t0_facts
from phaselead.scope.hub import Hub, Order
from phaselead.scope.jobs import JOBS
from phaselead.scope.saving import save
from phaselead.scope.settings import HARD, changed, changed_hard
from phaselead.scope.trigger import Trigger

Arguments = Mapping[str, Any]


def text(given: Arguments, name: str, default: str = "") -> str:
    """A word of an order. Raises BadInput."""
    value = given.get(name, default)
    if not isinstance(value, str):
        raise BadInput(f"{name}: {value!r} is no text")
    return value.strip()


def number(given: Arguments, name: str, default: float | None = None) -> float | None:
    """A number of an order. Raises BadInput."""
    value = given.get(name)
    if value is None or value == "":
        return default
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        raise BadInput(f"{name}: {value!r} is no number")
    return float(value)


def by_axis(given: Arguments, name: str) -> dict[str, str]:
    """Texts by axis, those that are empty left out. Raises BadInput."""
    found = given.get(name, {})
    if not isinstance(found, Mapping) or not set(found) <= set("xyz"):
        raise BadInput(f"{name}: give a text for x, y or z")
    return {axis: text(found, axis) for axis in sorted(found) if text(found, axis)}


def _gains(given: Arguments) -> dict[str, str] | None:
    return by_axis(given, "gains") or None


def _mode(given: Arguments) -> str | None:
    mode = text(given, "mode")
    if mode and mode not in MODES:
        raise BadInput(f"mode {mode!r}: must be one of {', '.join(MODES)}")
    return mode or None


def arm(hub: Hub, given: Arguments) -> str:
    hub.about_to_move()
    hub.dev.arm(timeout=HOST_TIMEOUT_S)
    return "armed: the output is live, at its safe value"


def park(hub: Hub, given: Arguments) -> str:
    hub.dev.park()
    return "parked"


def hold(hub: Hub, given: Arguments) -> str:
    hub.about_to_move()
    hub.dev.hold()
    hub.restream()
    return "held where it stands"


def move(hub: Hub, given: Arguments) -> str:
    """Set-points: um, "+5um" relative; behind what is under way."""
    targets = by_axis(given, "targets")
    hub.about_to_move()
    moved = hub.dev.move(
        **targets,  # type: ignore[arg-type]
        mode=_mode(given),
        model=hub.stage,
        gains=_gains(given),
        duration=number(given, "duration"),
        speed=number(given, "speed"),
        wait=False,
    )
    if hub.where is None or hub.where.state != "running":
        hub.restream()
    said = (f"{axis} to {one.to_um:.3f} um in {one.duration_s * 1e3:.0f} ms" for axis, one in moved.axes.items())
    return "moving " + ", ".join(said)


def play(hub: Hub, given: Arguments) -> str:
    """Waveforms, until held, parked or stopped. What runs is parked first."""
    waves = by_axis(given, "waves")
    if hub.dev.where().state == "running":
        hub.dev.park()
    mode = _mode(given)
    if mode is None and all(wave.partition("@")[0].endswith("V") for wave in waves.values()):
        mode = "open"
    if mode is None:
        mode = best_mode(hub.stage, "".join(waves))
    hub.about_to_move()
    hub.dev.play(waves or None, mode=mode, model=hub.stage, gains=_gains(given))
    hub.restream()
    return f"playing {', '.join(f'{axis}={wave}' for axis, wave in waves.items())} in mode {mode}"


def model(hub: Hub, given: Arguments) -> str:
    """A stage file of this computer, uploaded."""
    stage = load_stage(text(given, "path"))
    hub.dev.upload(stage)
    hub.stage = stage
    hub.restream()
    return f"uploaded {stage.name} (axes {', '.join(sorted(stage.axes))})"


def settings(hub: Hub, given: Arguments) -> str:
    """Settings of an axis changed, while parked: those of the stage file are uploaded, and kept as one of their own;
    the hard limits go to the device alone."""
    if hub.dev.where().state != "parked":
        raise BadInput("settings are changed while the device is parked; park it first")
    values = given.get("values")
    if not isinstance(values, Mapping) or not values:
        raise BadInput("nothing was changed")
    axis = text(given, "axis", "x")
    hard = {name: value for name, value in values.items() if str(name).startswith(f"{HARD}.")}
    of_file = {name: value for name, value in values.items() if name not in hard}
    stage = None if not of_file else _changed_file(hub, axis, of_file)
    said = []
    if hard:
        wanted = changed_hard(hub.dev.limits()[axis], hard)
        hub.hard = hub.dev.set_limits(axis, **vars(wanted), remove=True)
        said.append(f"{axis}: {', '.join(hard)} set on the device")
    if stage is not None:
        hub.dev.upload(stage)
        hub.stage = stage
        name = f"settings-{datetime.now():%Y%m%d-%H%M%S}.toml"
        stage.save(hub.new_file(name))
        said.append(f"{axis}: {', '.join(of_file)} changed and uploaded; the stage file is {hub.folder / name}")
        hub.restream()
    return "; ".join(said)


def _changed_file(hub: Hub, axis: str, values: Arguments) -> Stage:
    if hub.stage is None:
        raise BadInput("there is no stage file to change; upload one, or identify the stage")
    return changed(hub.stage, axis, values)


def loop(hub: Hub, given: Arguments) -> str:
    """What the model says of gains, before anything moves."""
    if hub.stage is None:
        raise BadInput("without a model nothing can be said of gains; upload one, or identify the stage")
    axis = text(given, "axis", "x")
    gains = gains_of(by_axis(given, "gains").get(axis), hub.stage, axis)
    found = loop_of(axis, hub.stage.axis(axis), gains)
    words = f"Kp {gains.kp_V_per_um:g}, Ki {gains.ki_V_per_um_s:g}, Kd {gains.kd_V_s_per_um:g}: "
    if not found.stable:
        return f"{axis}: {words}unstable on the model; refused"
    return (
        f"{axis}: {words}peak sensitivity {found.peak_sensitivity:.2f} (above 6 it is refused), gain margin "
        f"{found.gain_margin_dB:.1f} dB, bandwidth {max(found.bandwidth_Hz):.0f} Hz"
    )


def trigger(hub: Hub, given: Arguments) -> str:
    """Where a trace of an axis passes a level; off, normal or single."""
    axis = text(given, "axis", "x")
    if axis not in hub.samples.axes or len(axis) != 1:
        raise BadInput(f"axis {axis!r} is not streamed; there are {', '.join(hub.samples.axes)}")
    hub.trigger = Trigger(
        text(given, "run", "off"),
        axis,
        text(given, "trace", "x_um"),
        number(given, "level", 0.0) or 0.0,
        text(given, "edge", "rising"),
        number(given, "before", 0.25) or 0.0,
        number(given, "window_s", 0.5) or 0.0,
    )
    return "" if hub.trigger.run == "off" else f"trigger {hub.trigger.run}: waiting for {axis}"


def save_samples(hub: Hub, given: Arguments) -> str:
    """The last seconds of every tick, or the trigger's stretch, as HDF5."""
    name = text(given, "name") or f"scope-{datetime.now():%Y%m%d-%H%M%S}.h5"
    if PurePath(name).name != name or not name.endswith(".h5") or name.startswith("."):
        raise BadInput(f"{name!r}: give a name that ends in .h5, without a folder")
    seconds = number(given, "seconds", 2.0) or 0.0
    shot = hub.trigger.shot if hub.trigger.run != "off" else None
    if shot is None and not 0 < seconds <= hub.samples.seconds:
        raise BadInput(f"{seconds:g} s: the last {hub.samples.seconds:g} s are kept")
    # No lock: samples are added by this thread alone, and a page that waits for a file could not send STOP.
    state = hub.dev.where().state
    ticks = shot.ticks if shot else round(seconds * TICK_HZ)
    ticks = min(ticks, hub.samples.end - hub.samples.begin)
    first = shot.first_tick if shot else hub.samples.end - ticks
    zero = shot.trigger_tick if shot else first
    session = hub.dev.device.session
    facts = {"scope_state": state} | t0_facts(session.tick_0_unix_s, zero / TICK_HZ, session.nonce)
    recording = save(hub.samples, first, ticks, zero, hub.folder / name, facts)
    hub.new_file(name)
    lacks = recording.meta["missing_ticks"]
    return f"saved {len(recording.t_s)} ticks to {hub.folder / name}" + (f", {lacks} are missing" if lacks else "")


ORDERS: dict[str, Order] = {
    "arm": arm,
    "park": park,
    "hold": hold,
    "move": move,
    "play": play,
    "model": model,
    "settings": settings,
    "loop": loop,
    "trigger": trigger,
    "save": save_samples,
    **{name: job.run for name, job in JOBS.items()},
}
"""By the name that a tab sends. STOP is none of them: it waits for nobody."""
