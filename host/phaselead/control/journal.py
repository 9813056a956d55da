"""Runs whose data survive the death of this program: an append-only journal beside the output until it is finished."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import Any

from phaselead.control.rehearsal import rehearse
from phaselead.control.run import Run
from phaselead.control.tracking import MODES, run_recording, track
from phaselead.device import (
    TICK_HZ,
    Capture,
    Device,
    DeviceFault,
    FrameReader,
    decode_samples,
    device_model,
    recording_of,
    wire,
    write_run,
)
from phaselead.errors import BadInput, PhaseleadError
from phaselead.model import Gains, Stage, parse_stage, stage_text
from phaselead.record import (
    RUN_SUFFIXES,
    JournalWriter,
    Recording,
    check_output,
    read_journal,
    write_hdf5,
)
from phaselead.waveforms import Waveform

Progress = Callable[[float], None]
LISTEN_S = 1.0
"""How long a device is listened to when nobody says."""


class RunFile:
    """The output of one run, and beside it, from the first received chunk until it is written, OUTPUT.journal."""

    def __init__(self, output: str | None, header: dict[str, Any], *, driven: bool) -> None:
        self.output = output
        self.path = f"{output}.journal"
        self._header = header
        self._driven = driven
        self._writer: JournalWriter | None = None
        if output is not None:
            check_output(output, suffixes=RUN_SUFFIXES)
            if os.path.lexists(self.path):
                raise BadInput(
                    f"{self.path}: is left from a run that was not finished; recover it first (phaselead log recover "
                    f"{self.path} -o OTHER.h5), delete it, or choose another output"
                )

    @property
    def sink(self) -> Callable[[bytes], None] | None:
        """What takes the received chunks, or None when nothing is to be kept."""
        return None if self.output is None else self._append

    def _append(self, chunk: bytes) -> None:
        if self._writer is None:  # only now: a command that is refused before it streams leaves nothing
            self._writer = JournalWriter(self.path, self._header)
        self._writer.append("rx", chunk)

    def write(self, capture: Capture, recording: Recording) -> None:
        """Writes the finished run and drops the journal, which it makes superfluous."""
        if self.output is not None:
            write_run(self.output, capture, recording)
            self._remove()

    def _remove(self) -> None:
        if self._writer is not None:
            self._writer.close()
            os.remove(self.path)
            self._writer = None

    def recovery_hint(self) -> str:
        """After an error: how to get at what was received, or nothing when there is nothing to get at."""
        if self._writer is None:
            return ""
        self._writer.close()
        if not holds_run(self.path, driven=self._driven):
            self._remove()
            return ""
        return f"what was received is kept: phaselead log recover {self.path} -o {self.output}"


def holds_run(journal_path: str, *, driven: bool) -> bool:
    """Whether a journal holds more than the talk before a run: paths that started or, if none drove, samples."""
    _, entries, _ = read_journal(journal_path)
    bodies = FrameReader().feed(b"".join(entry.payload for entry in entries if entry.kind == "rx"))
    if not driven:
        return any(body[0] == wire.Samples.NUMBER for body in bodies)
    started = wire.StartRequest.NUMBER | wire.REPLY_BIT
    return any(body[0] == started and body[wire.HEADER.size] == wire.Status.OK for body in bodies)


@contextmanager
def run_file(output: str | None, device: Device, mode: str, stage: Stage | None, *, driven: bool) -> Iterator[RunFile]:
    """A ``RunFile``; an error that leaves a journal behind names it in its message.

    Raises:
        BadInput: the output cannot be written, or has a journal from a run that was not finished.
    """
    run = RunFile(output, journal_header(device, mode, stage), driven=driven)
    try:
        yield run
    except (PhaseleadError, KeyboardInterrupt) as error:
        said = [str(error)] if isinstance(error, PhaseleadError) else [after_interrupt(device)]
        error.args = ("; ".join(part for part in (*said, run.recovery_hint()) if part),)
        raise
    except BaseException:
        run.recovery_hint()
        raise


def after_interrupt(device: Device) -> str:
    """What has become of the output: the capture parks it on Ctrl-C, which a broken line can prevent."""
    with suppress(PhaseleadError, OSError):
        if device.status().state == "parked":
            return "the output is parked"
    return "whether the output is parked is not known: look with phaselead status"


def journal_header(device: Device, mode: str, stage: Stage | None) -> dict[str, Any]:
    """What is needed, besides the received bytes, to turn them into a recording."""
    return {
        "schema_fingerprint": wire.FINGERPRINT,
        "hello": device.hello.pack().hex(),
        "session": device.session.nonce,
        "mode": mode,
        "stage": stage_text(stage) if stage is not None else "",
    }


def track_to_file(
    device: Device,
    waveforms: Mapping[str, Waveform],
    mode: str,
    *,
    output: str | None,
    stage: Stage | None = None,
    gains: Mapping[str, Gains] | None = None,
    duration_s: float | None = None,
    force: bool = False,
    on_progress: Progress | None = None,
) -> Run:
    """``track`` with its data written to ``output`` (None: kept nowhere), beside which a journal grows meanwhile.

    A run that ends in a fault is written too. One that does so on the model is refused before anything moves
    (``rehearse``), unless ``force``.
    """
    if not force:
        rehearse(waveforms, mode, stage, gains or {}, duration_s)
    with run_file(output, device, mode, stage, driven=True) as file:
        try:
            run = track(
                device,
                waveforms,
                mode,
                stage=stage,
                gains=gains,
                duration_s=duration_s,
                force=force,
                on_progress=on_progress,
                sink=file.sink,
            )
        except DeviceFault as fault:
            file.write(fault.capture, run_recording(fault.capture, mode, stage))
            raise
        file.write(run.capture, run.recording)
    return run


def listen_to_file(
    device: Device, axes: str, duration_s: float, *, output: str | None, on_progress: Progress | None = None
) -> Recording:
    """Records what the device does without driving it; written as by ``track_to_file``."""
    ticks = round(duration_s * TICK_HZ)
    if ticks < 1:
        raise BadInput(f"a duration of {duration_s:g} s is shorter than one tick of 0.2 ms; use a longer one")
    with run_file(output, device, "open", None, driven=False) as file:
        progress = None if on_progress is None else lambda done: on_progress(done / ticks)
        capture = device.capture(ticks, axes=axes, start=False, park=False, progress=progress, sink=file.sink)
        recording = recording_of(capture)
        file.write(capture, recording)
    return recording


def record_open_loop(
    device: Device,
    waveforms: Mapping[str, Waveform] | None,
    axis: str = "x",
    *,
    output: str | None,
    stage: Stage | None = None,
    duration_s: float | None = None,
    on_progress: Progress | None = None,
) -> Recording:
    """Records what the device does while the waveforms, in volts, are played; without any it only listens on ``axis``.

    ``stage`` has limits and calibration; it is uploaded before anything is played. ``duration_s`` is by default ten
    periods, or 1 s when only listening. Raises as ``track``.
    """
    if waveforms is None:
        seconds = LISTEN_S if duration_s is None else duration_s
        return listen_to_file(device, axis, seconds, output=output, on_progress=on_progress)
    run = track_to_file(
        device, waveforms, "open", output=output, stage=stage, duration_s=duration_s, on_progress=on_progress
    )
    return run.recording


def recover_run(journal_path: str, output: str) -> dict[str, Any]:
    """Finishes a journal whose program died: writes what it holds to ``output`` and says what was lost.

    The recording cannot be replayed (the commands sent are not in what was received), only read. The journal is
    removed once the recording is written.

    Raises:
        BadInput: no journal, of another version, or without a single batch of samples.
    """
    check_output(output, suffixes=RUN_SUFFIXES, inputs=[journal_path])
    header, entries, torn_bytes = read_journal(journal_path)
    if header.get("schema_fingerprint") != wire.FINGERPRINT or header.get("mode") not in MODES:
        raise BadInput(f"{journal_path}: was written by another version of phaselead; recover it with that one")
    reader = FrameReader()
    received = b"".join(entry.payload for entry in entries if entry.kind == "rx")
    samples = [body for body in reader.feed(received) if body[0] == wire.Samples.NUMBER]
    if not samples:
        raise BadInput(f"{journal_path}: holds no samples, there is nothing to recover; delete it")
    recording = _recovered(header, decode_samples(samples))
    write_hdf5(output, recording)
    os.remove(journal_path)
    return recording.facts() | {
        "output": output,
        "torn_bytes": torn_bytes,
        "damaged_frames": reader.errors,
    }


def _recovered(header: dict[str, Any], stream: Any) -> Recording:
    stage = parse_stage(header["stage"], "journal") if header["stage"] else None
    first, last = int(stream.ticks[0]), int(stream.ticks[-1])
    capture = Capture(
        hello=wire.HelloReply.unpack(bytes.fromhex(header["hello"])),
        session=header["session"],
        stream=stream,
        first_tick=first,
        start_tick=-1,
        end_tick=last + 1,
        state=b"",
        model=device_model(stage) if stage is not None else None,
        waves={},
        command_log=[],
        events=[],
        status=wire.StatusReply.unpack(bytes(wire.StatusReply.SIZE)),
    )
    recording = run_recording(capture, header["mode"], stage)
    return replace(recording, meta=recording.meta | {"ended": "broken off"})
