"""Records of one session that each count from 0 s, on one clock."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from phaselead.record import Recording, t0_unix_s


def seconds_into_session(records: Sequence[Recording]) -> list[float]:
    """By record how long after the t_s = 0 of the first of its session its own was, by what the records say.

    All 0 where one does not say when it was taken, or where two were taken at once: then it is no clock of the stage.
    """
    t0_s = [t0_unix_s(record.meta) for record in records]
    known_s = [t for t in t0_s if t is not None]
    if len(known_s) < len(records):
        return [0.0] * len(records)
    later_s = [t - min(known_s) for t in known_s]
    judged = (record.t_s[record.scored] for record in records)
    spans_s = sorted((float(t[0]) + later, float(t[-1]) + later) for t, later in zip(judged, later_s, strict=True))
    at_once = any(end_s > begin_s for (_, end_s), (begin_s, _) in pairwise(spans_s))
    return [0.0] * len(records) if at_once else later_s
