"""What an effect would bring if it explained all that a set leaves.

To a set without it the records are outliers, or more is missed by equations than they usually miss, and either way what
is left says little. So the amounts are found where nothing is left, by the weights that blocks then have, and what they
bring is worked out in full: the density of what is left with them, under the likeliest share of what equations miss.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from phaselead.gap.parameters import SizedEffect
from phaselead.gap.posterior.equation_misfit import is_of_material, log_prior_of_share, shares_of
from phaselead.gap.posterior.first_order import FirstOrder, Histories, Residual
from phaselead.gap.posterior.likeliest import Start, likeliest_amounts
from phaselead.gap.posterior.likelihood import Likelihood
from phaselead.gap.posterior.priors import LARGEST
from phaselead.gap.posterior.sets import Fit, Terms, goes_on_between_records
from phaselead.gap.posterior.shapes import Shapes
from phaselead.record import Samples


@dataclass(frozen=True)
class IfExplained:
    """Shapes of effects that all go on between records, so that levels do not tell of them, or that all do not."""

    shapes: Shapes
    histories: Histories

    def beside(self, likelihood: Likelihood, fit: Fit) -> list[Start]:
        """For every effect that is not in a set its best shape, where what it had done before the records goes on and
        where it is over."""
        terms = fit.terms
        if any(goes_on_between_records(group.effect) for group in self.shapes.groups):
            terms = replace(terms, levels_say=False, settled={})
        variance = likelihood.variance(terms, shares_of(fit.entries)[:1])
        weights = likelihood.weights(np.zeros_like(variance[:, 0]), variance)[0]
        beside = FirstOrder(likelihood, terms, weights, self.shapes, self.histories)
        best: dict[tuple[str, int], tuple[int, Start]] = {}
        for which, group in enumerate(self.shapes.groups):
            if group.effect.name in fit.names:
                continue
            for i, one in enumerate(likeliest_amounts(group, *beside.slope_and_curvature(which))):
                known = best.get((group.effect.name, i))
                if known is None or (one.of_size, one.gain) > (known[1].of_size, known[1].gain):
                    best[group.effect.name, i] = which, one
        # The set may move without them as well.
        alone = beside.residual_with(0, np.zeros(len(beside.slope_and_curvature(0)[0])))
        none = max(
            likelihood.likeliest_share(terms, fit.share)[1] - terms.prior.log_density,
            _log_density_with(likelihood, terms, alone, fit.entries),
        )
        found = []
        for which, one in best.values():
            left = beside.residual_with(which, one.amounts)
            log_density = _log_density_with(likelihood, terms, left, (*fit.entries, one.entry))
            found.append(replace(one, gain=log_density + one.log_volume + _log_prior_of_sizes(one.entry) - none))
        return found


def if_explained_of(shapes: Shapes, histories: Histories) -> list[IfExplained]:
    """Shapes of effects that go on between records, and of the others, without modes: these are looked for by
    frequency."""
    one_by_one = [i for i, group in enumerate(shapes.groups) if group.effect.peak is None]
    lasting = [i for i in one_by_one if goes_on_between_records(shapes.groups[i].effect)]
    others = [i for i in one_by_one if i not in lasting]
    each = [chosen for chosen in (lasting, others) if chosen]
    return [IfExplained(shapes.some(i), Histories([[had[j] for j in i] for had in histories.of_runs])) for i in each]


def _log_density_with(likelihood: Likelihood, terms: Terms, left: Residual, entries: tuple[SizedEffect, ...]) -> float:
    """Of the records, with what is left beside a set or the set and one effect more, and of the amounts of the set."""
    shares = shares_of(entries)
    material = is_of_material(entries[-1:]).any() * left.added if len(entries) > len(terms.entries) else 0.0
    with_it = replace(
        terms, entries=entries, signal=terms.signal + left.added, of_material=terms.of_material + material, settled={}
    )
    power = np.tile(left.power, (len(shares), 1))
    logs = likelihood.log_density(power, likelihood.variance(with_it, shares))
    logs += [log_prior_of_share(entries, share) for share in shares]
    return float(logs.max()) + left.log_prior


def _log_prior_of_sizes(entry: SizedEffect) -> float:
    """Against that of none, within the usual sizes or in the tails, whichever is more."""
    effect, params = entry
    typical: Samples = np.array([params[p.name] / p.typical for p in effect.sizes]) / LARGEST
    return -float(np.minimum(0.5 * typical**2, np.log1p(typical**2)).sum())
