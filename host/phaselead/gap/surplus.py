"""Whether structure remains in the held-out records that no entry of the catalogue explains."""

from __future__ import annotations

import numpy as np
from scipy.stats import mannwhitneyu

from phaselead.gap.compare import residual_amounts
from phaselead.gap.correction import Correction
from phaselead.gap.final import Final
from phaselead.gap.grow import Growth
from phaselead.gap.panel import Panel
from phaselead.gap.refit import Entry
from phaselead.record import Samples

P, SHARE, CHI2 = 1e-3, 0.02, 1.3
PLAINLY = 2.0
"""Times what the model leaves of the reference records: a stop met now and then fills too few blocks for ranks."""
NEAREST_um, NEAREST, HALF = 0.07, 0.2, 0.5
"""Shares of the power that is new since the reference, in um and in the metric: names that leave more of both, or half
of it in um, and plainly more than the model leaves of the reference records, are the catalogue's nearest and not what
it is."""


SLOW = {"creep", "charge_leakage", "thermal_drift"}
"""What moves the offset of a record by itself, and had done so when it began: that shows in um and is no fault of a
name."""


def unexplained(growth: Growth, final: Final) -> bool:
    """Sure (p), of size (share of the power) and beyond what the noise model and the base's misfit allow (chi^2).

    At a high signal-to-noise ratio every model fails significance, so all three are asked for. Without reference
    records the noise was learned from the training residual itself and only a difference to it can show.
    """
    bench, gap = growth.bench, final.gap
    if (gap.after**2 - gap.floor**2) <= SHARE * max(gap.before**2, 1e-30):
        return False
    if bench.reference is not None and gap.after > PLAINLY * gap.floor:
        return True
    held = _mean_squares(bench.holdout, bench.correction, growth.fitted.entries)
    if bench.reference is not None:
        known = _mean_squares(bench.reference, bench.correction, ())
    else:
        known = _mean_squares(bench.slim, bench.correction, growth.fitted.entries)
    if np.median(held) <= CHI2 * np.median(known) and held.mean() <= CHI2 * known.mean():
        return False
    return float(mannwhitneyu(held, known, alternative="greater").pvalue) < P


def leaves_too_much(growth: Growth, final: Final) -> bool:
    """Whether the names explain so little of what is new that something else must be behind it: in um of the held-out
    records and in the metric of the training records.
    """
    bench, gap = growth.bench, final.gap
    if bench.reference is None or not growth.named or gap.after < PLAINLY * gap.floor:
        return False
    left = (gap.after**2 - gap.floor**2) / max(gap.before**2 - gap.floor**2, 1e-30)
    slow = any(one.effect.name in SLOW for one in growth.named)
    if left <= NEAREST_um or (left >= HALF and not slow):
        return left >= HALF
    known = float(_mean_squares(bench.reference, bench.correction, ()).mean())
    before = float(_mean_squares(bench.slim, bench.correction, ()).mean())
    after = float(_mean_squares(bench.slim, bench.correction, growth.fitted.entries).mean())
    return after - known > NEAREST * (before - known)


def _mean_squares(panel: Panel, correction: Correction, entries: tuple[Entry, ...]) -> Samples:
    """Whitened mean square of each driven block (b,), every block counting alike."""
    plain = panel.reweighted([np.ones(len(w)) for w in panel.evidence.weights])
    moments = plain.with_columns([t.error(entries)[:, None] for t in plain.evidence.tracks])
    left = residual_amounts(moments, correction)
    squares = np.einsum("i,bij,j->b", left, moments, left)
    rows = np.concatenate([np.diff(e) for e in plain.evidence.edges])
    return np.asarray(squares / rows)
