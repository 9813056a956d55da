"""A journal as a recording file, in memory that does not grow with either."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from phaselead.control.modes import MODES
from phaselead.control.tracking import run_recording
from phaselead.device import (
    TICK_HZ,
    Capture,
    FrameReader,
    Gap,
    Stream,
    channels_of,
    decode_samples,
    device_model,
    replay_facts,
    wire,
)
from phaselead.errors import BadInput, LinkError
from phaselead.model import Stage, parse_stage
from phaselead.record import Hdf5Parts, JournalReader, Recording, facts_of, hdf5_in_parts

BLOCK_BYTES = 1 << 22
"""Of samples that are decoded together."""
LATE_BATCHES = 64
"""So many wait for those that come late before they are written."""
FOREVER = 1 << 62
RECEIVED, ANSWERED = "rx", "tx"
"""Kinds of a journal's entries: what came off the line; a command that was answered, after its tick (u64)."""
FIRST_TICK = slice(wire.HEADER.size + 4, wire.HEADER.size + 12)


@dataclass
class Written:
    """What has gone into the file so far."""

    rows: int = 0
    from_s: float = 0.0
    to_s: float = 0.0
    axes: str = ""
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)
    meta: dict[str, Any] = field(default_factory=dict)

    def add(self, part: Recording) -> None:
        """Takes a part into account."""
        self.from_s = float(part.t_s[0]) if self.rows == 0 else self.from_s
        self.rows, self.to_s = self.rows + len(part.t_s), float(part.t_s[-1])
        self.axes, self.meta = "".join(part.axes), part.meta
        for name, (low, high) in part.ranges().items():
            before = self.ranges.get(name, (low, high))
            self.ranges[name] = min(low, before[0]), max(high, before[1])


def read_header(journal: JournalReader, path: str) -> Stage | None:
    """The stage that the run was driven by. Raises BadInput for a journal that this version cannot read."""
    if not _is_readable(journal.header):
        raise BadInput(f"{path}: was written by another version of phaselead; recover it with that one")
    stage = journal.header["stage"]
    return parse_stage(stage, "journal") if stage else None


def _is_readable(header: dict[str, Any]) -> bool:
    if header.get("schema_fingerprint") != wire.FINGERPRINT or header.get("mode") not in list(MODES):
        return False
    try:
        wire.HelloReply.unpack(bytes.fromhex(header["hello"]))
        header["session"].to_bytes(8, "little")
    except (KeyError, AttributeError, TypeError, ValueError, OverflowError, LinkError):
        return False
    return isinstance(header.get("stage"), str) and isinstance(header.get("tick_0_unix_s"), int | float | None)


def convert(path: str, output: str, capture: Capture | None = None) -> dict[str, Any]:
    """Writes what a journal holds to ``output`` and gives its facts, as ``Recording.facts``.

    ``capture`` says what the run was, when it came to its end; without it the recording cannot be replayed, and the
    facts say what was damaged.

    Raises:
        BadInput: no journal, of another version, or without a single batch of samples.
    """
    with JournalReader(path) as journal:
        stage = read_header(journal, path)
        run = capture if capture is not None else _broken_off(journal, stage)
        reader, done, gaps, next_tick = FrameReader(), Written(), list[Gap](), run.first_tick if capture else None
        with hdf5_in_parts(output) as file:
            stream = Stream(np.empty(0, np.int64), {})
            for block in _blocks(_samples(journal, reader, run.session, file)):
                stream = decode_samples(block, next_tick)
                if len(stream.ticks) == 0:
                    continue
                if next_tick is None:
                    run = replace(run, first_tick=int(stream.ticks[0]))
                next_tick = int(stream.ticks[-1]) + stream.decimation
                gaps += stream.gaps
                _append(file, done, replace(run, stream=stream), journal.header["mode"], stage)
            if next_tick is None or done.rows == 0:
                raise BadInput(f"{path}: holds no samples, there is nothing to recover; delete it")
            if capture is not None and (missing := run.rows_end - next_tick) > 0:
                gaps.append(Gap(next_tick, missing))
            dropped = run.stream.dropped_ticks if capture else stream.dropped_ticks
            run = replace(run, stream=replace(stream, gaps=gaps, dropped_ticks=dropped))
            meta = done.meta | {
                "gaps": [[gap.first_tick, gap.ticks] for gap in gaps],
                "dropped_ticks": dropped,
                "missing_ticks": run.missing,
                **({"ended": "broken off"} if capture is None else {}),
            }
            rate_Hz = TICK_HZ / stream.decimation
            file.finish(rate_Hz, done.axes, meta, replay_facts(run) if capture is not None else None)
        facts = facts_of(done.rows, rate_Hz, done.from_s, done.to_s, done.axes, done.ranges, meta)
        damage = {"torn_bytes": journal.torn_bytes, "damaged_frames": reader.errors} if capture is None else {}
        return facts | {"output": output} | damage


def _samples(journal: JournalReader, reader: FrameReader, session: int, file: Hdf5Parts) -> Iterator[bytes]:
    """The batches of a session in the order they came; commands that were answered go into the file on the way."""
    nonce = session.to_bytes(8, "little")
    for kind, payload in journal:
        if kind == RECEIVED:
            for body in reader.feed(payload):
                if body[0] == wire.Samples.NUMBER and body[3:11] == nonce:
                    yield body
        elif kind == ANSWERED and len(payload) >= 8:
            file.append("replay/command_ticks", np.frombuffer(payload, np.int64, count=1))
            file.append_frame("replay/command_frames", payload[8:])


def _blocks(bodies: Iterator[bytes]) -> Iterator[list[bytes]]:
    """Batches in the order of their ticks, as many at a time as are worth it; none that comes late is torn off."""
    block: list[bytes] = []
    size = 0
    for body in bodies:
        block.append(body)
        size += len(body)
        if size >= BLOCK_BYTES:
            block.sort(key=lambda one: int.from_bytes(one[FIRST_TICK], "little"))
            yield block[:-LATE_BATCHES]
            block = block[-LATE_BATCHES:]
            size = sum(map(len, block))
    if block:
        yield block


def _append(file: Hdf5Parts, done: Written, part: Capture, mode: str, stage: Stage | None) -> None:
    file.append("device/tick", part.ticks)
    for name, values in channels_of(part.stream).items():
        file.append(f"device/{name}", values)
    with suppress(BadInput):  # none of its ticks are of the path
        recording = run_recording(part, mode, stage)
        file.append_rows(recording)
        done.add(recording)


def _broken_off(journal: JournalReader, stage: Stage | None) -> Capture:
    header = journal.header
    return Capture(
        hello=wire.HelloReply.unpack(bytes.fromhex(header["hello"])),
        session=header["session"],
        stream=Stream(np.empty(0, np.int64), {}),
        first_tick=0,
        start_tick=-1,
        end_tick=FOREVER,
        state=b"",
        model=device_model(stage) if stage is not None else None,
        waves={},
        command_log=[],
        events=[],
        status=wire.StatusReply.unpack(bytes(wire.StatusReply.SIZE)),
        tick_0_unix_s=header.get("tick_0_unix_s"),
    )
