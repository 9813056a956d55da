"""How much each effect seems to gain on reference records, which are known to be without it.

A fold of the reference residual is explained by what the other folds say the base misses; what an effect still gains
there is a mistake, and says by how much gains of its kind are to be believed less than white noise would have it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from phaselead.gap.correction import MISSED_STD, Correction, folds_of
from phaselead.gap.panel import Layout, Panel
from phaselead.record import Samples

POWERLESS = 1e-6


def mistaken_gains(panel: Panel, layout: Layout, errors: Sequence[Samples]) -> dict[str, float]:
    """Inflation, at least 1, by effect: mean square of its score over the folds against what white noise gives, or its
    gain over all of them against the price of a parameter, whichever is more. ``panel`` has the full layout."""
    target = panel.size
    moments = panel.with_columns([e[:, None] for e in errors])
    index, folds = layout.common(), folds_of(panel.evidence)
    precision = np.eye(len(index)) / MISSED_STD**2
    total = moments.sum(axis=0)
    scores, powers = [], []
    for fold in range(int(folds.max()) + 1):
        inside = moments[folds == fold].sum(axis=0)
        kept = total - inside
        inner = kept[np.ix_(index, index)] + precision
        mean = cho_solve(cho_factor(inner), kept[index, target])
        left = Correction(index, mean, inner).conditioned(inside, target)
        scores.append(left[:target, target])
        powers.append(np.diag(left)[:target])
    score, power = np.array(scores), np.maximum(np.array(powers), 0.0)
    price = float(np.log(max(panel.evidence.rows, 3)))
    found: dict[str, float] = {}
    for i, atom in enumerate(layout.atoms):
        for column in layout.of_atom(i):
            whole = float(power[:, column].sum())
            if whole > POWERLESS:
                scatter = float((score[:, column] ** 2).sum()) / whole
                coherent = float(score[:, column].sum()) ** 2 / whole / price
                found[atom.effect.name] = max(found.get(atom.effect.name, 1.0), scatter, coherent)
    return found
