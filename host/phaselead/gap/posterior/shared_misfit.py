"""What all sets of effects may miss alike: shared by all of them, so that their evidences can be compared."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple, Self

import numpy as np

from phaselead.gap.base_refit import columns_beyond, span_of_fields
from phaselead.gap.history import Stood, with_stood
from phaselead.gap.parameters import SizedEffect
from phaselead.gap.posterior.base_fault import as_fault, fault_deviations
from phaselead.gap.posterior.blocks import BlockedRun, Simulated
from phaselead.gap.posterior.density import Density
from phaselead.gap.posterior.levels import about_their_sessions, with_levels_about_their_sessions
from phaselead.gap.posterior.moments import SharedProducts
from phaselead.gap.posterior.sets import confused
from phaselead.gap.residual import ModelledRun
from phaselead.model import Entry
from phaselead.record import Samples

LIKE_RIVALS = 0.1
"""Share of an effect, root of the squares, that its equation may miss and that looks like others which the catalogue
says it is confused with, and that their equations may miss and looks like it, all together. A prior of the size of that
misfit, chosen and not measured: it lies within the 2 to 20 % that models of hysteresis, creep and modes are taken to
leave."""
MakeColumns = Callable[[BlockedRun], Samples]
"""Coefficients (n, k) in a run of something that may be missed in all records alike, one prior deviation each."""


class Beyond(NamedTuple):
    """What the base may miss beyond the voltages that it was fitted to."""

    make: MakeColumns
    begin: int
    end: int
    """Of the shared columns those from ``begin`` to ``end``."""


@dataclass
class WithSharedMisfit(Density):
    """Records beside one base, and what it may miss in all of them."""

    shared: tuple[Samples, ...]
    """Per run the coefficients (n, k) of what the base may miss in all records alike, one prior deviation each."""
    shared_by: tuple[MakeColumns, ...] = ()
    """What makes these columns, in this order, for any run."""
    known: tuple[SizedEffect, ...] = ()
    """Effects that explain much, by themselves or beside others: what may be taken for one another."""
    beyond: Beyond | None = None
    """Where the base may be off beyond the voltages that it was fitted to, the columns of that."""

    def __post_init__(self) -> None:
        super().__post_init__()
        pairs = zip(self.runs, self.shared, strict=True)
        # Of the shared columns with each other, which all sets have in common.
        self.among_shared = SharedProducts(np.concatenate([run.products(one, one) for run, one in pairs]))

    def knowing(self, effects: Sequence[SizedEffect]) -> Self:
        """The same, where further effects may be taken for others. Where reference records can tell, the base may lack
        any of them in all records."""
        known = (*self.known, *effects)
        if all(run.changed for run in self.runs):
            return replace(self, known=known)
        return replace(self.missing(lambda run: run.coefficients(as_fault(run.modelled, effects))), known=known)

    def missing(self, *makers: MakeColumns) -> Self:
        """The same, where these may be missed in all records too."""
        made = [[make(run) for run in self.runs] for make in makers]
        added = [with_levels_about_their_sessions(self.runs, columns) for columns in made]
        shared = tuple(np.concatenate(of_run, axis=1) for of_run in zip(self.shared, *added, strict=True))
        return replace(self, shared=shared, shared_by=(*self.shared_by, *makers))

    def missing_beyond(self, entries: Sequence[SizedEffect] = (), stood: Sequence[Stood] = ()) -> Self:
        """The same, where the base may be off beyond the voltages that it was fitted to, at the voltages of the records
        or, instead, at those to which some effects, and what had stood off by run, move them."""
        acting = self.acting(entries, stood)
        span, mine = span_of_fields(acting), list(zip(self.runs, acting, strict=True))

        def beyond(run: BlockedRun) -> Samples:
            modelled, extra = next((there for one, there in mine if one is run), (run.modelled, entries))
            return run.coefficients(columns_beyond(modelled, span, extra))

        others = self._without_beyond()
        found = others.missing(beyond)
        return replace(found, beyond=Beyond(beyond, others.among_shared.size, found.among_shared.size))

    def acting(
        self, entries: Sequence[SizedEffect], stood: Sequence[Stood] = ()
    ) -> list[tuple[ModelledRun, list[Entry]]]:
        """The runs, each with what acts in it of some effects and of what had stood off by run, by default nothing."""
        each = zip(self.runs, tuple(stood) or ({},) * len(self.runs), strict=True)
        return [(run.modelled, with_stood(entries, had) if run.changed else []) for run, had in each]

    def _without_beyond(self) -> Self:
        """The same without the columns of that."""
        if self.beyond is None:
            return self
        make, begin, end = self.beyond
        kept = tuple(np.delete(columns, np.s_[begin:end], axis=1) for columns in self.shared)
        makers = tuple(one for one in self.shared_by if one is not make)
        return replace(self, shared=kept, shared_by=makers, beyond=None)

    def shared_in(self, run: BlockedRun) -> Samples:
        """Coefficients (n, k) of the shared columns in a run that is none of these, and belongs to no session."""
        found = np.concatenate([np.zeros((run.edges[-1], 0)), *(make(run) for make in self.shared_by)], axis=1)
        if found.shape[1] != self.among_shared.size:
            raise ValueError(f"{found.shape[1]} shared columns are made for another run, and there are "
                             f"{self.among_shared.size}")  # fmt: skip
        return found

    def without_held_out(self) -> Self:
        """Of the other records alone: what is fitted to them may be judged on the held-out ones."""
        kept = [i for i, run in enumerate(self.runs) if run.modelled.run.role != "holdout"]
        shared = tuple(self.shared[i] for i in kept)
        return replace(self, runs=tuple(self.runs[i] for i in kept), shared=shared)

    def with_misfit_of(self, entries: Sequence[SizedEffect]) -> Self:
        """The same, where what the equations of some effects miss may look like the known ones that they are confused
        with, and, since one of those may be what is there, what its equation misses like the effect itself."""
        makers = []
        for i, (effect, _) in enumerate(entries):
            size = self._size_um(entries, i)
            rivals = [rival for rival in self.known if confused(effect, rival[0])]
            alike = [(one, self._size_um([one], 0)) for one in (*rivals, *([entries[i]] if rivals else []))]
            like = partial(_like, [(one, um) for one, um in alike if um > 0])
            like_them = with_levels_about_their_sessions(self.runs, [like(run) for run in self.runs])
            in_all = np.sqrt(sum(_squares(run, like) for run, like in zip(self.runs, like_them, strict=True)))
            if in_all > 0:
                makers.append(partial(_scaled, LIKE_RIVALS * size / in_all, like))
        return self.missing(*makers)

    def _size_um(self, entries: Sequence[SizedEffect], index: int) -> float:
        """Root of the squares, over all records about their means, of what one effect adds to the others."""
        added = self._added_um2([run.simulated(entries) for run in self.runs])[index]
        return float(np.sqrt(added @ np.where(self._is_level, 0, self._sizes)))

    def _added_um2(self, found: Sequence[Simulated]) -> Samples:
        """Power (entries, blocks) of what each effect adds to the others, spread over the octaves."""
        pairs = zip(self.runs, found, strict=True)
        added = np.concatenate([run.spread(one.power) for run, one in pairs], axis=1)
        firsts = about_their_sessions(self.runs, [one.first for one in found])
        for run, first, block in zip(self.runs, firsts, self._blocks[:-1], strict=True):
            if run.levelled:
                added[:, block] = first**2
        return added


def _like(alike: Sequence[tuple[SizedEffect, float]], run: BlockedRun) -> Samples:
    """Coefficients (n, k) of all that some effects may take, one prior deviation of a parameter each, for 1 um of what
    each adds."""
    each = [run.simulated([e]).of_tangents(len(e[0].parameters)) * fault_deviations(e) / um for e, um in alike]
    return np.concatenate([np.zeros((run.edges[-1], 0)), *each], axis=1)


def _scaled(factor: float, make: MakeColumns, run: BlockedRun) -> Samples:
    return factor * make(run)


def _squares(run: BlockedRun, columns: Samples) -> float:
    """Summed squares of columns (n, k) over the octaves of a run, of all columns together."""
    octaves = slice(run.first_octave, None)
    return float(run.sizes[octaves] @ np.trace(run.products(columns, columns)[octaves], axis1=1, axis2=2))
