"""Runs a capture again: from its state, model, waveforms, commands and converter codes to the same DAC codes."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from phaselead.device import AXES, Capture, FrameReader, axes_of, encode_frame, wire
from phaselead.errors import BadInput
from phaselead.result import Result, Table
from phaselead.sim.device import Codes, Firmware

SETUP_SESSION = 1
MODEL_CHUNK = 512
WAVE_CHUNK = 1024
UNSEEN_CODE = 0x8000
"""For axes that were not recorded; they must not have moved, so nothing hangs on it."""
FROM_OUTSIDE = (
    wire.Fault.HOST_TIMEOUT,  # retries feed it too, and a recording does not hold them
    wire.Fault.TICK_OVERRUN,
    wire.Fault.CONVERTER_SILENT,
    wire.Fault.INTERLOCK,
    wire.Fault.FLASH_ERROR,
    wire.Fault.TICK_LOST,
)
"""Faults that do not follow from codes and commands: they are raised again in the tick in which they were."""


@dataclass(frozen=True)
class Replay(Result):
    """A run that was executed again. True when every DAC code is the same."""

    run: str
    ticks: int
    first_difference: int | None
    """The first tick whose DAC code differs."""

    @property
    def equal(self) -> bool:
        """Whether every DAC code is the same."""
        return self.first_difference is None

    def __bool__(self) -> bool:
        return self.equal

    def as_dict(self) -> dict[str, Any]:
        """As ``phaselead replay --json`` writes it."""
        return {"run": self.run, "ticks": self.ticks, "equal": self.equal, "first_difference": self.first_difference}

    @property
    def columns(self) -> dict[str, list[Any]]:
        """One row."""
        return {name: [value] for name, value in self.as_dict().items()}

    def tables(self) -> list[Table | str]:
        if self.equal:
            return [f"{self.run}: {self.ticks} ticks executed again, every DAC code is the same"]
        return [f"{self.run}: the DAC code of tick {self.first_difference} differs; it is the first that does"]


def replay(capture: Capture, library: ctypes.CDLL | None = None) -> int | None:
    """The first tick whose DAC code differs from the recorded one, or None when there is none.

    ``library`` is another build of the firmware than the installed one.

    Raises:
        BadInput: something is missing that the ticks depend on; the message names it.
    """
    _refuse_incomplete(capture)
    adc = np.full((len(capture.ticks), 3), UNSEEN_CODE, np.uint16)
    for axis, stream in capture.axes.items():
        assert stream.adc is not None
        adc[:, AXES.index(axis)] = stream.adc
    with Firmware(library=library) as firmware:
        _set_up(firmware, capture)
        firmware.restore(capture.session, capture.state)
        if firmware.tick != capture.first_tick:
            raise BadInput("the recording's control state is of another tick; record again")
        return _first_difference(firmware, capture, adc)


def _refuse_incomplete(capture: Capture) -> None:
    stream = capture.stream
    if capture.hello.schema_fingerprint != wire.FINGERPRINT:
        raise BadInput(
            f"the recording was made with another wire schema (0x{capture.hello.schema_fingerprint:08X}, "
            f"this is 0x{wire.FINGERPRINT:08X}); replay it with the phaselead that made it"
        )
    if stream.decimation != 1:
        raise BadInput(
            f"the recording is decimated by {stream.decimation}: {stream.decimation - 1} of "
            f"{stream.decimation} ADC codes are missing; record every tick"
        )
    if not len(capture.ticks) or not capture.axes:
        raise BadInput("the recording holds no ticks; record again")
    for axis, data in capture.axes.items():
        for name in ("adc", "dac"):
            if getattr(data, name) is None:
                raise BadInput(f"the recording lacks the {name.upper()} codes of axis {axis}; record that channel too")
    steps = np.flatnonzero(np.diff(capture.ticks) != 1)
    if capture.gaps or len(steps) or capture.ticks[0] != capture.first_tick:
        first = capture.gaps[0].first_tick if capture.gaps else _missing(capture, steps)
        raise BadInput(f"the recording has a gap: ticks from {first} on are missing; record without drops")
    if not capture.state:
        raise BadInput("the recording lacks the control state it began with; record again")


def _missing(capture: Capture, steps: NDArray[np.intp]) -> int:
    return int(capture.ticks[steps[0]]) + 1 if len(steps) else capture.first_tick


def _send(firmware: Firmware, number: int, command: wire.Command[Any]) -> None:
    firmware.write(encode_frame(wire.HEADER.pack(command.NUMBER, number, SETUP_SESSION) + command.pack()))
    firmware.run_codes(np.full((1, 3), UNSEEN_CODE, np.uint16))
    for body in FrameReader().feed(firmware.read(firmware.readable)):
        status = body[wire.HEADER.size]
        if body[0] == command.NUMBER | wire.REPLY_BIT and status != wire.Status.OK:
            raise BadInput(
                f"the recording's model or waveform is refused by this firmware ({command.NAME}: "
                f"{wire.Status(status).name.lower()}); replay it with the version that made it"
            )


def _set_up(firmware: Firmware, capture: Capture) -> None:
    """Model and waveforms, by ordinary commands of a session of their own."""
    for number, command in enumerate(_set_up_commands(capture), 1):
        _send(firmware, number, command)


def _set_up_commands(capture: Capture) -> Iterator[wire.Command[Any]]:
    yield wire.HelloRequest()
    model = capture.model
    if model is not None:
        yield wire.ModelBeginRequest(len(model), crc32(model))
        for at in range(0, len(model), MODEL_CHUNK):
            yield wire.ModelChunkRequest(at, model[at : at + MODEL_CHUNK])
        yield wire.ModelCommitRequest()
    for axis, points in capture.waves.items():
        for at in range(0, len(points), WAVE_CHUNK):
            yield wire.WaveChunkRequest(AXES.index(axis), at // 4, points[at : at + WAVE_CHUNK])
        yield wire.WaveCommitRequest(AXES.index(axis), crc32(points))


def _happenings(capture: Capture) -> list[tuple[int, bytes | int | None]]:
    """Commands (frames), faults (numbers) and edges at the trigger input (None) that were waited for, each with the
    tick before which it took effect."""
    faults = [
        (event.tick, event.value)
        for event in capture.events
        if event.kind == wire.EventKind.FAULT and event.value in FROM_OUTSIDE
    ]
    edges = [(event.tick, None) for event in capture.events if event.kind == wire.EventKind.TRIGGER]
    all_: list[tuple[int, bytes | int | None]] = [*capture.command_log, *faults, *edges]
    return sorted(all_, key=lambda happening: happening[0])


def _first_difference(firmware: Firmware, capture: Capture, adc: Codes) -> int | None:
    recorded = sum(1 << AXES.index(axis) for axis in capture.axes)
    first, at = capture.first_tick, 0
    end: list[tuple[int, bytes | int | None]] = [(first + len(adc), b"")]
    for tick, happening in _happenings(capture) + end:
        to = min(max(tick - first, at), len(adc))
        _refuse_unseen(firmware, recorded)
        difference = _compare(capture, at, firmware.run_codes(adc[at:to]))
        if difference is not None:
            return difference
        at = to
        if happening is None:
            firmware.trigger_at(firmware.tick)
        elif isinstance(happening, int):
            firmware.inject(happening)
        else:
            firmware.write(happening)
    return None


def _refuse_unseen(firmware: Firmware, recorded: int) -> None:
    unseen = firmware.driven_axes & ~recorded
    if unseen:
        raise BadInput(f"the recording lacks axis {axes_of(unseen)}, which moved too; record every axis that moves")


def _compare(capture: Capture, at: int, dac: Codes) -> int | None:
    wrong = np.zeros(len(dac), bool)
    for axis, stream in capture.axes.items():
        assert stream.dac is not None
        wrong |= dac[:, AXES.index(axis)] != stream.dac[at : at + len(dac)]
    rows = np.flatnonzero(wrong)
    return int(capture.ticks[at + rows[0]]) if len(rows) else None
