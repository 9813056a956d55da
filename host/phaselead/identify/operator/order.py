"""In what order records were taken: by their clocks, or as they are given."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from phaselead.identify.runs import AxisRun


class Order(NamedTuple):
    """Which record was taken after which, by their numbers."""

    chains: tuple[tuple[int, ...], ...]
    """Each record follows the one before it in its chain; nothing is known of what was before a chain."""
    alone: tuple[int, ...]
    """Records of which nothing says when they were taken."""
    known: str
    """How the order is known, in words."""
    by_clocks: bool
    """Whether clocks tell all of it, so that it need explain no more than that it is not wrong."""

    @property
    def firsts(self) -> list[int]:
        """The first record of each chain."""
        return [chain[0] for chain in self.chains]


def orders(runs: Sequence[AxisRun]) -> list[Order]:
    """The orders in which records may have been taken: by their clocks, where most have a time that they share with no
    other record, and the others each after the one that is given before it; without these; and as they are given."""
    given = Order((tuple(range(len(runs))),), (), "in the order in which they are given", False)
    clocked = _by_their_clocks(runs)
    if clocked is None:
        return [given]
    several = [*([_with_all(clocked)] if clocked.alone else []), clocked]
    return [*several, *([given] if all(order.chains != given.chains for order in several) else [])]


def _with_all(order: Order) -> Order:
    """The same order with each of those alone after the record that is given before it."""
    chains = [list(chain) for chain in order.chains]
    for i in order.alone:
        if i == 0:
            chains[0].insert(0, i)
        else:
            chain = next(chain for chain in chains if i - 1 in chain)
            chain.insert(chain.index(i - 1) + 1, i)
    known = f"{order.known} ({len(order.alone)} without a time of their own: after the one given before)"
    return Order(tuple(map(tuple, chains)), (), known, by_clocks=False)


def same_drive(a: AxisRun, b: AxisRun) -> bool:
    """Whether two are windows of one record, one perhaps longer than the other: the stage went that way once."""
    rows = slice(min(len(a.t_s), len(b.t_s)))
    pairs = (a.t_s, b.t_s), (a.u_V, b.u_V), (a.x_um, b.x_um)
    return a.began == b.began and all(np.array_equal(one[rows], other[rows]) for one, other in pairs)


def _by_their_clocks(runs: Sequence[AxisRun]) -> Order | None:
    """Records of one clock are a chain. A device that has no Unix time counts from 0 whenever it starts: each of its
    sessions has a clock of its own. Where no record says when it began, their ``t_s`` may go on from one to the next.
    None where half of the records or more say no time, or one that others share."""
    of_clock: dict[str, list[int]] = {}
    for i, run in enumerate(runs):
        if run.began is not None:
            of_clock.setdefault("Unix" if run.began.unix else f"session {run.began.session}", []).append(i)
    by_clocks = bool(of_clock)
    if not of_clock:
        of_clock["t_s"] = list(range(len(runs)))
    chains = [chain for numbers in of_clock.values() if (chain := _without_shared_times(runs, numbers))]
    alone = sorted(set(range(len(runs))).difference(*chains))
    if 2 * len(alone) >= len(runs):
        return None
    clocks = f" by {len(chains)} clocks" if len(chains) > 1 else ""
    return Order(tuple(chains), tuple(alone), f"in the order of their times{clocks}", by_clocks)


def _without_shared_times(runs: Sequence[AxisRun], numbers: Sequence[int]) -> tuple[int, ...]:
    """Of the records of one clock those that share no time with another, by when they began."""
    spans_s = {i: _span_s(runs[i]) for i in numbers}
    order = sorted(numbers, key=lambda i: spans_s[i])
    shared: set[int] = set()
    latest = order[0]
    for before, i in pairwise(order):
        latest = max(latest, before, key=lambda k: spans_s[k][1])
        if spans_s[i][0] <= spans_s[latest][1] and not same_drive(runs[latest], runs[i]):
            shared |= {latest, i}
    shared |= {i for i in order if any(same_drive(runs[i], runs[k]) for k in shared)}
    return tuple(i for i in order if i not in shared)


def _span_s(run: AxisRun) -> tuple[float, float]:
    """When a record began and ended, by its clock."""
    began_s = run.began.at_s if run.began is not None else 0.0
    return began_s + float(run.t_s[0]), began_s + float(run.t_s[-1])
