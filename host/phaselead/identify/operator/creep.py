"""Creep as a fit finds it: linear, as the modes are, so that it may be taken out of a record before all else."""

from __future__ import annotations

from dataclasses import dataclass, replace

from phaselead.identify.runs import AxisRun
from phaselead.model import Entry, effect_of_creep, without_lags
from phaselead.record import Samples


@dataclass(frozen=True)
class Creep:
    """Motion that goes on after the voltage has stopped, straight in the logarithm of time."""

    per_decade: float
    """Of the way, from ``first_s`` to ``last_s``."""
    first_s: float
    last_s: float

    @property
    def entry(self) -> Entry:
        """As an effect."""
        return effect_of_creep(self.per_decade, self.first_s, self.last_s)

    @property
    def terms(self) -> tuple[Samples, Samples]:
        """Shares and time constants of its lags, each (m,)."""
        effect, params = self.entry
        assert effect.creep_terms is not None
        return effect.creep_terms(params)

    @property
    def whole(self) -> float:
        """How far the stage goes in the end for 1 that it went at once."""
        k, _ = self.terms
        return 1 + float(k.sum())

    def taken_from(self, run: AxisRun) -> AxisRun:
        """The record without it; the stage had stood where the record begins."""
        k, tau_s = self.terms
        return replace(run, x_um=without_lags(run.x_um, tau_s, k, run.step_s))
