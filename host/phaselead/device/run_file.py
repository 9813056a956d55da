"""A capture of the device as a recording file: positions and volts to read, raw codes and commands to replay.

The recording's rows are the ticks between the start of the paths and their end; the raw numbers of the whole capture,
parking included, are under ``/device``, and what a replay needs besides is under ``/replay``.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phaselead.device import wire
from phaselead.device.quantities import TICK_HZ, converters
from phaselead.device.status import name_of, target_of
from phaselead.device.stream import AxisStream, Capture, Gap, Stream
from phaselead.errors import BadInput
from phaselead.record import AxisRecord, Recording, Samples, read_hdf5, t0_facts, write_hdf5

RAIL_CODES = np.array([0, 65535], np.uint16)
CHANNELS = tuple(field.name for field in fields(AxisStream))


def recording_of(
    capture: Capture,
    *,
    axes: str | None = None,
    closed_loop: frozenset[str] = frozenset(),
    meta: dict[str, Any] | None = None,
) -> Recording:
    """The capture in units, from the start of the paths to their end; t_s = 0 is the first tick of the paths.

    ``axes``: of these alone; None: of all. ``closed_loop`` names the axes whose reference is a position (it is volts in
    mode open, and then left out).
    """
    first = capture.recorded_from
    rows = (capture.ticks >= first) & (capture.ticks < capture.end_tick)
    if not rows.any():
        raise BadInput("the capture holds no ticks; record for longer")
    calibration = converters(capture.model)
    records = {}
    for name, stream in capture.axes.items():
        if axes is not None and name not in axes:
            continue
        u_V = None if stream.dac is None else calibration[name].u_V(stream.dac[rows])
        x_um = None if stream.adc is None else calibration[name].x_um(stream.adc[rows])
        asked = stream.reference is not None and name in closed_loop
        records[name] = AxisRecord(u_V, x_um, stream.reference[rows] / 2.0**16 if asked else None)  # type: ignore[index]
    facts: dict[str, Any] = {
        "build_id": capture.hello.build_id.hex(),
        "target": target_of(capture.hello.target),
        "gaps": [[gap.first_tick, gap.ticks] for gap in capture.gaps],
        "dropped_ticks": capture.stream.dropped_ticks,
        "missing_ticks": capture.missing,
        "start_tick": capture.start_tick,
        **t0_facts(capture.tick_0_unix_s, first / TICK_HZ, capture.session),
        "rails_um": {name: calibration[name].x_um(RAIL_CODES).tolist() for name in records},
    }
    if capture.status.state == wire.State.FAULT:
        facts["ended"] = f"fault {name_of(wire.Fault, capture.status.fault)}"
    trigger = next((stream.trigger[rows] for stream in capture.axes.values() if stream.trigger is not None), None)
    t_s = (capture.ticks[rows] - first) / TICK_HZ
    return Recording(t_s=t_s, axes=records, trigger=trigger, meta=facts | (meta or {}))


def write_run(
    path: str | os.PathLike[str],
    capture: Capture,
    recording: Recording,
    true_um: Mapping[str, Samples] | None = None,
) -> None:
    """Writes recording and capture as one HDF5 file, whole or not at all; ``true_um``: where a virtual stage truly was
    at the rows of the recording, (n,) by axis, which is kept under ``/device/true_um``."""
    replay = replay_facts(capture) | {"command_ticks": np.array([tick for tick, _ in capture.command_log], np.int64)}
    if capture.command_log:
        replay["command_frames"] = [frame for _, frame in capture.command_log]
    device: dict[str, Any] = {"tick": capture.ticks} | ({} if true_um is None else {"true_um": dict(true_um)})
    for place, data in channels_of(capture.stream).items():
        axis, channel = place.split("/")
        device.setdefault(axis, {})[channel] = data
    write_hdf5(path, recording, device=device, replay=replay)


def channels_of(stream: Stream) -> dict[str, NDArray[Any]]:
    """Raw numbers by axis and channel, "x/adc"; shape (n,) each."""
    found = ((f"{axis}/{name}", getattr(one, name)) for axis, one in stream.axes.items() for name in CHANNELS)
    return {place: data for place, data in found if data is not None}


def replay_facts(capture: Capture) -> dict[str, Any]:
    """What a replay needs besides the ticks and the commands."""
    facts: dict[str, Any] = {
        "schema_fingerprint": wire.FINGERPRINT,
        "hello": capture.hello.pack(),
        "session": f"{capture.session:016x}",
        "first_tick": capture.first_tick,
        "start_tick": capture.start_tick,
        "end_tick": capture.end_tick,
        "state": capture.state,
        "waves": dict(capture.waves),
        "channels": capture.stream.channels,
        "axis_mask": capture.stream.axis_mask,
        "decimation": capture.stream.decimation,
        "lost_batches": capture.stream.lost_batches,
        "dropped_ticks": capture.stream.dropped_ticks,
        "gaps": [[gap.first_tick, gap.ticks] for gap in capture.gaps],
        "status": capture.status.pack(),
        **({} if capture.tick_0_unix_s is None else {"tick_0_unix_s": capture.tick_0_unix_s}),
        "events": [event.pack() for event in capture.events],
    }
    return facts | ({} if capture.model is None else {"model": capture.model})


def read_capture(path: str | os.PathLike[str]) -> Capture:
    """The capture in a run file.

    Raises:
        BadInput: not HDF5, or without what a replay needs; the line names what is missing.
    """
    content = read_hdf5(path)
    device, replay = content.device, content.replay
    if device is None or replay is None:
        raise BadInput(
            f"{path}: holds no {'/replay' if device else '/device and /replay'}: it is a recording but was not taken "
            "by phaselead from a device, so it cannot be executed again"
        )
    if replay.get("schema_fingerprint") != wire.FINGERPRINT:
        raise BadInput(
            f"{path}: was recorded with another version of the wire (0x{replay.get('schema_fingerprint', 0):08X}, this "
            f"phaselead 0x{wire.FINGERPRINT:08X}); replay it with the phaselead that made it"
        )
    try:
        return _capture(device, replay)
    except (KeyError, ValueError, TypeError, AttributeError) as error:
        raise BadInput(f"{path}: its /device or /replay is incomplete ({error}); record again") from None


def _capture(device: dict[str, Any], replay: dict[str, Any]) -> Capture:
    axes = {name: AxisStream(**device[name]) for name in "xyz" if name in device}
    stream = Stream(
        ticks=np.asarray(device["tick"], np.int64),
        axes=axes,
        channels=int(replay["channels"]),
        axis_mask=int(replay["axis_mask"]),
        decimation=int(replay["decimation"]),
        gaps=[Gap(*gap) for gap in replay["gaps"]],
        lost_batches=int(replay["lost_batches"]),
        dropped_ticks=int(replay["dropped_ticks"]),
    )
    frames = replay.get("command_frames", [])
    return Capture(
        hello=wire.HelloReply.unpack(replay["hello"]),
        session=int(replay["session"], 16),
        stream=stream,
        first_tick=int(replay["first_tick"]),
        start_tick=int(replay["start_tick"]),
        end_tick=int(replay["end_tick"]),
        state=replay["state"],
        model=replay.get("model"),
        waves={name: replay["waves"][name] for name in replay["waves"]},
        command_log=list(zip((int(tick) for tick in replay["command_ticks"]), frames, strict=True)),
        events=[wire.Event.unpack(event) for event in replay["events"]],
        status=wire.StatusReply.unpack(replay["status"]),
        tick_0_unix_s=replay.get("tick_0_unix_s"),
    )
