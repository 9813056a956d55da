"""What the next model adopts without vouching for its name: the nearest set that pays on held-out records.

A gap that can be shrunk is shrunk; what it is called is another question. Effects are fitted to the training records as
they stand, in um, and one is adopted where the next model then predicts both the training and the held-out records
better than chance would.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from phaselead.gap.adopt import adopted
from phaselead.gap.error_rates import ERROR_RATE
from phaselead.gap.findings import NamedEffect
from phaselead.gap.goodness_of_fit import FinalFit
from phaselead.gap.parameters import SizedEffect
from phaselead.gap.posterior import each_fitted, intervals_alone
from phaselead.gap.records import GapRun, Role
from phaselead.gap.residual import modelled_run
from phaselead.gap.savings import probability_by_chance, shares_saved, squares_by_block
from phaselead.model import Effect
from phaselead.record import Samples

MOST_PROVISIONAL = 3
"""Effects that are adopted one after the other: as many as the trials hide."""


def nearest_that_pays(
    final: FinalFit,
    named: Sequence[NamedEffect],
    runs: Sequence[GapRun],
    effects: Sequence[Effect],
    open_plays: bool = False,
) -> tuple[FinalFit, list[NamedEffect]]:
    """The final fit with the set of ``effects`` that predicts the held-out records best beside it, and that set.

    The set grows one by one, as long as the last one pays. ``named`` are the effects of the fit already.
    ``open_plays``: the plays were fitted to these records, to what may be the effects', and are fitted anew beside
    each.
    """
    found: list[NamedEffect] = []
    for _ in range(MOST_PROVISIONAL):
        taken = {e.name for e in (*named, *found)}
        left = [e for e in effects if e.name not in taken]
        axis = adopted(final.axis, [*named, *found])
        so_far = [modelled_run(axis, run) for run in runs]
        fits = each_fitted([run for run in so_far if run.run.role == "train"], left)
        tried = [_beside(final, [one], open_plays) for one in fits]
        best = _best_that_pays(final, tried)
        if best is None:
            break
        final, entry = best, best.entries[-1]
        found.append(NamedEffect(entry[0].name, intervals_alone(so_far, entry), 0.0))
    return final, [replace(e, share=final.share_of(e.name)) for e in found]


def _beside(final: FinalFit, entries: Sequence[SizedEffect], open_plays: bool) -> FinalFit:
    """The final fit with one effect more, and plays that go with it."""
    richer = final.with_entries(entries)
    return richer.with_plays_refitted() if open_plays else richer


def _best_that_pays(final: FinalFit, tried: Sequence[FinalFit]) -> FinalFit | None:
    """The fit that saves most of the held-out squares, of those that save some of them and of those of the training
    records beyond chance; None without one."""
    worth = [one for one in tried if _chance(*_squares(final, one, "train")) < ERROR_RATE]
    best: FinalFit | None = None
    most = 0.0
    for one in worth:
        was, now = _squares(final, one, "holdout")
        if float((was - now).sum()) > most and _chance(was, now) * len(worth) < ERROR_RATE:
            best, most = one, float((was - now).sum())
    return best


def _chance(was: Samples, now: Samples) -> float:
    """Probability that a fit which saves nothing leaves so little; a share of each block is asked for, since one record
    may hold nearly all of the squares."""
    return probability_by_chance(shares_saved(was, now))


def _squares(before: FinalFit, after: FinalFit, role: Role) -> tuple[Samples, Samples]:
    """Squares (blocks,) that one fit leaves of the runs of one role, and another."""
    was, now = ([modelled for modelled in fit.after if modelled.run.role == role] for fit in (before, after))
    return squares_by_block(was, before.entries, now, after.entries)
