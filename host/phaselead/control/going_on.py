"""Axes that are held, or follow paths, and go on along others without parking: what is refused, and what makes way."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass

from phaselead.control.gains import GainsLike
from phaselead.control.joins import Span
from phaselead.control.moving import Mover
from phaselead.control.path_begin import refuse_moves_beside_others
from phaselead.device import NoEdge, Refused
from phaselead.errors import BadInput, PhaseleadError
from phaselead.model import Gains, Stage
from phaselead.waveforms import Waveform

WAVES_MEANWHILE_SINCE = 5
"""Revision of the wire from which a waveform may be sent while its axis is held."""


@dataclass(frozen=True)
class GoingOn:
    """The axes of a mover that are to go on along paths; ``way_for`` has them make way."""

    mover: Mover
    gains: Mapping[str, Gains]
    """That they will have meanwhile, by axis, also those that are beside the paths."""
    asked: bool
    """Whether gains were asked for; else they are those that the axes have."""
    said: list[str]
    """What the model warns of in gains that are new."""

    @property
    def axes(self) -> str:
        """Letters of the axes that are held."""
        return self.mover.axes

    @contextmanager
    def way_for(self, waveforms: Mapping[str, Waveform]) -> Iterator[Mapping[str, Span]]:
        """While these paths are begun and run: where each axis may be when its path is queued, um. Takes the new gains
        and lifts the limits of moves, which a path from rest is not held against either. Where the paths are refused,
        or the edge that they wait for does not come, the axes have their gains again; those that made way hold."""
        mover, before, given = self.mover, dict(self.mover.gains), self.mover.gains_given
        _refuse_by_older_firmware(mover, waveforms)
        try:
            spans_um = self._make_way(waveforms)
            for axis in waveforms:
                mover.playing.pop(axis, None)
            if self.asked:
                mover.take_gains(self.gains)
            with mover.without_limits():
                yield spans_um
        except (BadInput, NoEdge, Refused):
            with suppress(PhaseleadError):  # why they are refused is told, not what comes of it here
                if self.asked and mover.where().state == "running":
                    mover.take_gains(before, given=given)
            raise

    def _make_way(self, waveforms: Mapping[str, Waveform]) -> dict[str, Span]:
        """Waits for the end of joins, and brings to a hold what cannot be left for the new path by a join."""
        mover = self.mover
        now = mover.where()
        moving = {axis: mover.playing.get(axis) for axis in waveforms if now.axes[axis].moving}
        if moving:
            mover.wait_for_joins(now)
        stopped = [axis for axis, old in moving.items() if old is None or _must_stop(old, waveforms[axis])]
        if stopped:
            now = mover.hold("".join(stopped))
        spans = {axis: (now.axes[axis].reference_um,) * 2 for axis in waveforms}
        return spans | {axis: (old.lowest, old.highest) for axis, old in moving.items() if old and axis not in stopped}


def go_on(
    mover: Mover,
    waveforms: Mapping[str, Waveform],
    mode: str,
    stage: Stage | None,
    gains: GainsLike | Mapping[str, GainsLike] | None,
    *,
    force: bool,
) -> GoingOn | None:
    """The axes that ``mover`` holds now, which are to go on along these paths; None where it holds none. ``gains`` as
    for ``Mover.change_gains``; None: those that they have.

    Raises BadInput for another mode, axis or model than they are held by, for paths that cannot begin together, and for
    gains as that does.
    """
    if not mover.holds():
        return None
    mover.refuse_other("".join(waveforms), mode, stage)
    refuse_moves_beside_others(waveforms)
    own, said = (mover.gains, []) if gains is None else mover.other_gains(gains, force=force)
    return GoingOn(mover, dict(own), gains is not None, said)


def _refuse_by_older_firmware(mover: Mover, waveforms: Mapping[str, Waveform]) -> None:
    """Raises BadInput for a waveform that the device takes only while it is parked."""
    if mover.device.hello.wire_revision < WAVES_MEANWHILE_SINCE and any(
        w.played_as == "wave" for w in waveforms.values()
    ):
        raise BadInput(
            "the device's firmware takes the points of a path only while it is parked; `phaselead park` first, or "
            "`phaselead flash` it with this version"
        )


def _must_stop(old: Waveform, new: Waveform) -> bool:
    """A move begins where an axis rests. The memory of a waveform is written over when nothing plays it."""
    return new.played_as == "move" or (old.played_as == "wave" and new.played_as in ("wave", "points"))
