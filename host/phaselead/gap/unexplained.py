"""Whether what the final model leaves of held-out records can still be predicted from the voltage.

The check knows nothing of the catalogue and shares nothing with the search: no noise model, no names. A generic model
is fitted to the residuals of the training records and judged on the held-out ones. What such a model says that was
fitted to the residuals of reference records is known misfit of the base, and is taken out first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from phaselead.gap.error_rates import ERROR_RATE
from phaselead.gap.generic_model import Columns, FoldMoments, columns_of, moments_of, new_amounts, ridge_amounts
from phaselead.gap.residual import RunResidual, period_of
from phaselead.gap.time_blocks import block_edges, wanted_rows
from phaselead.identify import effective_rows
from phaselead.record import Samples

WORTH_SHARE = 0.03
"""Of the remaining power: what may be predicted beyond chance before something is missing."""
SIGN_DRAWS = 2000
"""Of signs: of these the 1 % quantile is known to a tenth of its probability."""


@dataclass(frozen=True)
class Unexplained:
    """How much of the remaining power of held-out records a generic model predicts."""

    share: float
    """Of the power about each record's mean that the final model leaves; below 0 where it predicts worse than nothing,
    or worse than what the reference records show as well. Not above 1, also where to predict like these hid a part."""
    chance: float
    """Share that chance alone reaches with a probability of 1 %, 0 or more."""
    of_equations: bool = False
    """Whether it is put down to the equations of the effects that were added, and so to nothing unknown."""
    resized: bool = False
    """Whether it was predicted but for its size, which was chosen to suit the held-out records."""

    def as_dict(self) -> dict[str, float | bool]:
        """As gap.json has it."""
        return {"share": self.share, "chance": self.chance, "of_equations": self.of_equations}

    def sentence(self, named: bool) -> str:
        """For a person. ``named``: whether any effect was named."""
        share = max(self.share, 0.0)
        leaves = "the names leave" if named else "the model leaves"
        resized = ", at the size that suits it best" if self.resized else ""
        chance = f"chance alone: up to {100 * self.chance:.0f} %"
        return f"from the voltage a generic model predicts {100 * share:.0f} % of what {leaves}{resized} ({chance})"

    @property
    def something_missing(self) -> bool:
        """Whether more can be predicted than there is where nothing is missing."""
        return _beyond_chance(self) > WORTH_SHARE


def unexplained(
    train: Sequence[RunResidual],
    holdout: Sequence[RunResidual],
    reference: Sequence[RunResidual] = (),
    of_any_size: bool = False,
) -> Unexplained:
    """How much of the held-out residuals a generic model predicts that was fitted to the training residuals.

    They are residuals of the final model; ``reference`` records are without what was found since. What such a model
    says must be better than what the reference records show as well, and better than nothing: what these say of other
    waveforms may be worse than that, and making it good predicts nothing.

    ``of_any_size``: without reference records, whether it counts by its shape as well. What was learned at one level
    may be far too much or too little at another, and still be of the shape of what is left.
    """
    columns = columns_of([r.run for r in (*train, *reference)])
    learned = _moments(columns, train)
    if reference:
        known, new = new_amounts(learned, _moments(columns, reference))
    else:
        new = ridge_amounts(learned)
        known = np.zeros(len(new))
    left, shown, said = [], [], []
    for r in holdout:
        made, _ = columns.of(r.run)
        left.append(r.error_um - r.error_um.mean())
        shown.append(made @ known)
        said.append(made @ new)
    if not reference:
        products = _products(holdout, left, said, ERROR_RATE / (2 if of_any_size else 1))
        found = [products.as_said, *([products.at_any_size] if of_any_size else [])]
        return max(found, key=_beyond_chance)
    alone = _products(holdout, left, [one + more for one, more in zip(shown, said, strict=True)])
    beyond_shown = _products(holdout, [e - one for e, one in zip(left, shown, strict=True)], said)
    least = min(alone.as_said, beyond_shown.as_said, key=_beyond_chance)
    return replace(least, share=min(least.share, 1.0))


def _beyond_chance(found: Unexplained) -> float:
    return found.share - found.chance


def _moments(columns: Columns, residuals: Sequence[RunResidual]) -> FoldMoments:
    return moments_of(columns, [r.run for r in residuals], [r.error_um for r in residuals])


class _Products(NamedTuple):
    """Sums over all rows, um^2, of products of a prediction and what is left."""

    saved: float
    """Of the prediction with what is left."""
    by_chance: float
    """What chance reaches of that."""
    of_prediction: float
    """Of the prediction with itself."""
    of_left: float
    """Of what is left with itself."""

    @property
    def as_said(self) -> Unexplained:
        """What the prediction saves."""
        if not self.of_left > 0:
            return Unexplained(0.0, 0.0)
        share, chance = ((2 * one - self.of_prediction) / self.of_left for one in (self.saved, self.by_chance))
        return Unexplained(share, max(chance, 0.0))

    @property
    def at_any_size(self) -> Unexplained:
        """The same once it is multiplied by what suits what is left best, but not turned round."""
        both = self.of_prediction * self.of_left
        if not both > 0:
            return Unexplained(0.0, 0.0)
        share, chance = (max(one, 0.0) ** 2 / both for one in (self.saved, self.by_chance))
        return Unexplained(share, chance, resized=True)


def _products(
    holdout: Sequence[RunResidual],
    left: Sequence[Samples],
    said: Sequence[Samples],
    false_alarm: float = ERROR_RATE,
) -> _Products:
    """By chance the product of the two is as often negative as positive in each block, and independent from block to
    block, where blocks are longer than it remembers: its sum under random signs is what chance gives."""
    each = [e * p for e, p in zip(left, said, strict=True)]
    of_runs = (wanted_rows(r.run.step_s, period_of(r.run.u_V[r.run.rows])) for r in holdout)
    wanted = max(*of_runs, *(_independent_rows(one) for one in each))
    edges = block_edges([len(one) for one in each], wanted)
    products = np.concatenate([np.add.reduceat(one, edge[:-1]) for one, edge in zip(each, edges, strict=True)])
    signs = np.random.default_rng(0).choice([-1.0, 1.0], size=(SIGN_DRAWS, len(products)))
    by_chance = float(np.quantile(signs @ products, 1 - false_alarm))
    power = sum(float(np.sum((r.error_um - r.error_um.mean()) ** 2)) for r in holdout)
    return _Products(float(products.sum()), by_chance, sum(float(p @ p) for p in said), power)


def _independent_rows(products: Samples) -> int:
    """Rows of blocks between which products (n,) hardly agree: (2 n t^2)^(1/3), where t of neighbouring rows are worth
    one (Lee, Conduit, Nemec, Lopez Rios and Drummond 2011, on blocks of Flyvbjerg and Petersen 1989)."""
    n = len(products)
    return round((2 * n * (n / effective_rows(products)) ** 2) ** (1 / 3)) if products.any() else 1
