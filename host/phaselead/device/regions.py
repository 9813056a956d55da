"""What the device keeps, read back in pieces: regions of its state, and the active model."""

from __future__ import annotations

from collections.abc import Sequence

from phaselead.device import wire
from phaselead.device.session import Refused, Session
from phaselead.errors import LinkError


def read_region(session: Session, region: wire.Region, size: int | None = None) -> bytes:
    """Reads a snapshot region in pieces; of a waveform that is not whole nothing. Raises LinkError when it is not of
    this size."""
    out = b""

    def read(at: int, length: int, waits_s: Sequence[float]) -> tuple[int, int]:
        nonlocal out
        reply = session.request(wire.SnapshotReadRequest(region, at, length), waits_s)
        if (reply.size and not reply.data) or reply.size != (size or reply.size):
            raise LinkError(f"the device gave {len(out)} of {reply.size} bytes of its state; start the capture again")
        out += reply.data
        return len(out), reply.size

    session.transfer(read)
    return out


def read_wave(session: Session, axis: str) -> bytes | None:
    """The points of an axis' waveform; None where it has none that is whole. Raises as ``read_region``."""
    region = wire.Region[f"WAVE_{axis.upper()}"]
    return read_region(session, region) or None


def read_model(session: Session) -> bytes | None:
    """The active model, or None when the device has none."""
    out = b""

    def read(at: int, length: int, waits_s: Sequence[float]) -> tuple[int, int]:
        nonlocal out
        reply = session.request(wire.ModelReadRequest(at, length), waits_s)
        if not reply.data:
            raise LinkError(f"the device gave {len(out)} of {reply.size} bytes of its model; try again")
        out += reply.data
        return len(out), reply.size

    try:
        session.transfer(read)
    except Refused as refusal:
        if refusal.status == wire.Status.NO_MODEL:
            return None
        raise
    return out
