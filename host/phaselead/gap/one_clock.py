"""Records that each count from 0 s, on one clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from phaselead.record import Recording, t0_unix_s

Records = Sequence[Recording]


def on_one_clock(train: Records, holdout: Records, reference: Records) -> tuple[Records, Records, Records]:
    """The records with times of one clock, which says 0 s at t_s = 0 of the first training or held-out one.

    They stay as they are where one of them does not say when it was taken, or two were taken at once: then it is no
    clock of the stage.
    """
    roles = train, holdout, reference
    t0_s = [[t0_unix_s(record.meta) for record in records] for records in roles]
    known_s = [[t for t in of_role if t is not None] for of_role in t0_s]
    if [len(of_role) for of_role in known_s] != [len(records) for records in roles]:
        return roles
    zero_s = min([*known_s[0], *known_s[1]])
    moved = [
        [replace(record, t_s=record.t_s + (t - zero_s)) for record, t in zip(records, of_role, strict=True)]
        for records, of_role in zip(roles, known_s, strict=True)
    ]
    return roles if _at_once([record for records in moved for record in records]) else (moved[0], moved[1], moved[2])


def _at_once(records: Records) -> bool:
    spans_s = sorted((float(t[0]), float(t[-1])) for t in (record.t_s[record.scored] for record in records))
    return any(end_s > begin_s for (_, end_s), (begin_s, _) in pairwise(spans_s))
