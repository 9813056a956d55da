"""Runs whose data survive the death of this program: an append-only journal beside the output until it is finished."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any, Unpack

from phaselead.control.converting import ANSWERED, RECEIVED, convert
from phaselead.control.rehearsal import OnRehearsed, Predicted, rehearse, unlike_predicted
from phaselead.control.room import refuse_without_room
from phaselead.control.run import Run
from phaselead.control.run_away import tell_of
from phaselead.control.tracking import Asked, MakesWay, SetUp, run_recording, set_up, ticks_of, track
from phaselead.control.triggers import parse_outputs
from phaselead.control.true_position import Follows, followed
from phaselead.device import (
    Capture,
    Device,
    DeviceFault,
    FrameReader,
    after_interrupt,
    recording_of,
    wire,
    write_run,
)
from phaselead.errors import BadInput, PhaseleadError
from phaselead.model import Stage, stage_text
from phaselead.record import (
    RUN_SUFFIXES,
    JournalReader,
    JournalWriter,
    Recording,
    Samples,
    alone,
    check_output,
    read_hdf5,
    what_to_do,
)
from phaselead.waveforms import Waveform

Progress = Callable[[float], None]
LISTEN_S = 1.0
"""How long a device is listened to when nobody says."""


class RunFile:
    """The output of one run, and beside it, from the first received chunk until it is written, OUTPUT.journal."""

    def __init__(self, output: str | None, header: dict[str, Any], *, driven: bool, at_trigger: bool = False) -> None:
        self.output = output
        self.path = f"{output}.journal"
        self._header = header
        self._driven, self._at_trigger = driven, at_trigger
        self._writer: JournalWriter | None = None
        if output is not None:
            check_output(output, suffixes=RUN_SUFFIXES)
            if os.path.lexists(self.path):
                raise BadInput(f"{self.path}: {what_to_do(self.path)}")

    @property
    def sink(self) -> Callable[[bytes], None] | None:
        """What takes the received chunks, or None when nothing is to be kept."""
        return None if self.output is None else self.received

    def received(self, chunk: bytes) -> None:
        """Keeps a chunk as it came off the line. Raises BadInput when the disk does not take it."""
        with self._told():
            if self._writer is None:  # only now: a command that is refused before it streams leaves nothing
                self._writer = JournalWriter(self.path, self._header)
            self._writer.append(RECEIVED, chunk)

    @contextmanager
    def _told(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise BadInput(f"{self.path}: cannot be written ({error.strerror or error}); make room") from None

    def answered(self, tick: int, frame: bytes) -> None:
        """Keeps a command and the tick before which it took effect."""
        if self._writer is not None:
            with self._told():
                self._writer.append(ANSWERED, tick.to_bytes(8, "little") + frame)

    def convert(self, capture: Capture) -> dict[str, Any]:
        """Writes the finished run from its journal, drops that, and gives the facts of the recording."""
        assert self.output is not None
        facts = convert(self.path, self.output, capture)
        self._remove()
        return facts

    def write(self, capture: Capture, recording: Recording, true_um: Mapping[str, Samples] | None = None) -> None:
        """Writes the finished run and drops the journal, which it makes superfluous."""
        if self.output is not None:
            write_run(self.output, capture, recording, true_um)
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
        with suppress(OSError):  # of a disk that is full
            self._writer.close()
        if not holds_run(self.path, driven=self._driven, at_trigger=self._at_trigger):
            self._remove()
            return ""
        return f"what was received is kept: phaselead log recover {self.path} -o {self.output}"


def holds_run(journal_path: str, *, driven: bool, at_trigger: bool = False) -> bool:
    """Whether a journal holds more than the talk before a run: samples and, if it drove, paths that started: with
    ``at_trigger`` not before the edge that they waited for came."""
    reader, sampled, queued, started = FrameReader(), False, False, not driven
    with JournalReader(journal_path) as journal:
        for kind, payload in journal:
            for body in reader.feed(payload) if kind == RECEIVED else ():
                sampled = sampled or body[0] == wire.Samples.NUMBER
                queued = queued or _is_taken(body, wire.QueueRequest)
                if at_trigger:
                    started = started or (queued and _tells_of_edge(body))
                else:
                    started = started or queued or _is_taken(body, wire.StartRequest)
                if sampled and started:
                    return True
    return False


def _is_taken(body: bytes, command: type[wire.Command[Any]]) -> bool:
    """Whether it is the device's yes to this command."""
    return body[0] == command.NUMBER | wire.REPLY_BIT and body[wire.HEADER.size] == wire.Status.OK


def _tells_of_edge(body: bytes) -> bool:
    """Of what came since paths were queued that wait for an edge. The event may have been lost on the line; the status,
    which is asked for again and again, says it too."""
    payload = body[wire.HEADER.size :]
    if body[0] == wire.Event.NUMBER:
        return wire.Event.unpack(payload).kind == wire.EventKind.TRIGGER
    return _is_taken(body, wire.StatusRequest) and wire.StatusReply.unpack(payload).first_tick > 0


@contextmanager
def run_file(
    output: str | None, device: Device, mode: str, stage: Stage | None, *, driven: bool, at_trigger: bool = False
) -> Iterator[RunFile]:
    """A ``RunFile``; an error that leaves a journal behind names it in its message. ``at_trigger``: the paths that it
    drives along wait for an edge of the trigger input.

    Raises:
        BadInput: the output cannot be written, or has a journal from a run that was not finished.
    """
    run = RunFile(output, journal_header(device, mode, stage), driven=driven, at_trigger=at_trigger)
    try:
        yield run
    except (PhaseleadError, KeyboardInterrupt) as error:
        said = [str(error)] if isinstance(error, PhaseleadError) else [after_interrupt(device.session)]
        error.args = ("; ".join(part for part in (*said, run.recovery_hint()) if part),)
        raise
    except BaseException:
        run.recovery_hint()
        raise


def journal_header(device: Device, mode: str, stage: Stage | None) -> dict[str, Any]:
    """What is needed, besides the received bytes, to turn them into a recording."""
    return {
        "schema_fingerprint": wire.FINGERPRINT,
        "hello": device.hello.pack().hex(),
        "session": device.session.nonce,
        "tick_0_unix_s": device.session.tick_0_unix_s,
        "mode": mode,
        "stage": stage_text(stage) if stage is not None else "",
    }


def track_to_file(
    device: Device,
    waveforms: Mapping[str, Waveform],
    mode: str,
    *,
    output: str | None,
    follows: Follows = "true",
    on_progress: Progress | None = None,
    trigger_out: str | None = None,
    gains_given: bool = True,
    on_rehearsed: OnRehearsed | None = None,
    park: bool = True,
    going_on: MakesWay | None = None,
    **asked: Unpack[Asked],
) -> Run:
    """``track`` with its data written to ``output`` (None: kept nowhere), beside which a journal grows meanwhile.

    A run that ends in a fault is written too. One that does so on the model is refused before anything moves
    (``rehearse``), unless ``force`` is asked for. ``follows``: which position is to follow a path in micrometres.
    ``trigger_out``: as ``parse_outputs`` reads it. ``gains_given``: they are of somebody's choice for this run.
    ``on_rehearsed`` is called once nothing is left that refuses it on the model, before anything moves. What it is
    given stands among the figures of the run too, as ``predicted``.
    """
    stage = asked.get("stage")
    refuse_without_room(asked.get("duration_s"), len(waveforms), output, in_memory=True)
    pulses = parse_outputs(trigger_out, waveforms)
    waveforms = followed(waveforms, stage, follows, mode)
    predicted: dict[str, Predicted] = {}
    if not asked.get("force"):
        predicted = rehearse(waveforms, mode, stage, asked.get("gains") or {}, asked.get("duration_s"))
    if on_rehearsed is not None:
        on_rehearsed(predicted)
    at_trigger = asked.get("edge_within_s") is not None
    with run_file(output, device, mode, stage, driven=True, at_trigger=at_trigger) as file:
        try:
            run = track(
                device,
                waveforms,
                mode,
                on_progress=on_progress,
                sink=file.sink,
                pulses=pulses,
                park=park,
                going_on=going_on,
                **asked,
            )
        except DeviceFault as fault:
            recording = run_recording(fault.capture, mode, stage, pulses)
            file.write(fault.capture, recording)
            tell_of(fault, recording, gains_given=gains_given)
            _add(fault, output and _kept_in(output))
            raise
        file.write(run.capture, run.recording, run.true_um)
    for line in unlike_predicted(run, predicted, stage):
        warnings.warn(line, stacklevel=2)
    return run.with_predicted({axis: vars(one) for axis, one in predicted.items()})


def _add(fault: DeviceFault, *said: str | None) -> None:
    """To what a fault says."""
    fault.args = ("; ".join([str(fault), *(part for part in said if part)]),)


def _kept_in(output: str) -> str:
    return f"the recording is kept in {output}"


def record_to_file(
    device: Device,
    waveforms: Mapping[str, Waveform] | None,
    axis: str = "x",
    *,
    output: str,
    stage: Stage | None = None,
    duration_s: float | None = None,
    on_progress: Progress | None = None,
) -> dict[str, Any]:
    """Records to ``output`` what the device does while the waveforms, in volts, are played; without any it only listens
    on ``axis``. Gives the facts of the recording, which may be larger than the memory. Raises as ``track``.

    ``stage`` has limits and calibration; it is uploaded before anything is played. ``duration_s`` is by default ten
    periods, or 1 s when only listening.
    """
    refuse_without_room(duration_s, len(axis if waveforms is None else waveforms), output, in_memory=False)
    with run_file(output, device, "open", stage, driven=waveforms is not None) as file:
        if waveforms is None:
            axes, ready = axis, SetUp({}, listening_ticks(duration_s), 0, 0)
        else:
            axes = "".join(sorted(waveforms))
            ready = set_up(device, waveforms, "open", stage=stage, duration_s=duration_s)
        progress = None if on_progress is None else lambda done: on_progress(done / ready.ticks)
        drives = waveforms is not None
        try:
            capture = device.capture(
                ready.ticks,
                axes=axes,
                start=drives,
                park=drives,
                lead_ticks=ready.lead_ticks,
                tail_ticks=ready.tail_ticks,
                progress=progress,
                spool=file,
                feeder=ready.feeder,
                queued=ready.queued,
            )
        except DeviceFault as fault:
            file.convert(fault.capture)
            _add(fault, _kept_in(output))
            raise
        return file.convert(capture)


def listening_ticks(duration_s: float | None) -> int:
    """How long to listen. Raises BadInput for less than a tick."""
    return ticks_of(LISTEN_S if duration_s is None else duration_s)


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
    """``record_to_file``, and the recording in memory; ``output`` None keeps it there alone."""
    if output is not None:
        record_to_file(
            device, waveforms, axis, output=output, stage=stage, duration_s=duration_s, on_progress=on_progress
        )
        return read_hdf5(output, whole=False).recording
    if waveforms is not None:
        return track_to_file(
            device, waveforms, "open", output=None, stage=stage, duration_s=duration_s, on_progress=on_progress
        ).recording
    refuse_without_room(duration_s, len(axis), output, in_memory=True)
    ticks = listening_ticks(duration_s)
    progress = None if on_progress is None else lambda done: on_progress(done / ticks)
    return recording_of(device.capture(ticks, axes=axis, start=False, park=False, progress=progress))


def recover_run(journal_path: str, output: str) -> dict[str, Any]:
    """Finishes a journal whose program died: writes what it holds to ``output`` and says what was lost.

    The recording cannot be replayed, only read. The journal is removed once the recording is written.

    Raises:
        BadInput: no journal, of another version, without a single batch of samples, or of a run that still goes on.
    """
    check_output(output, suffixes=RUN_SUFFIXES, inputs=[journal_path])
    with alone(journal_path):
        facts = convert(journal_path, output)
        try:
            os.remove(journal_path)
        except OSError as error:  # on Windows one that a run has open stays
            raise BadInput(
                f"{journal_path}: {output} is written, but the journal cannot be removed ({error.strerror}); does its "
                "run still go on?"
            ) from None
    return facts
