"""What no model is expected to beat: how large it is, and the noise that it has."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.fft import idct
from scipy.linalg import pinvh

from phaselead.gap.base_refit import mean_slope
from phaselead.gap.noise import Noise, as_idle, fit_noise
from phaselead.gap.posterior import Contest
from phaselead.gap.residual import ModelledRun, power_um2
from phaselead.identify import play_thresholds
from phaselead.model import plays
from phaselead.record import Samples

SAME_SHARE = 1e-10
"""Of the largest eigenvalue of the columns' products: those below say nothing new."""
RICH_PLAYS, RICH_SEGMENTS, RICH_STD = 24, 12, 0.1
"""An operator richer than any base, and the prior deviation of its weights, as a share of the mean slope."""


@dataclass(frozen=True)
class Floor:
    """What no model is expected to beat."""

    noise: Noise
    rms_um: float
    """Of the residuals of which it is the noise."""


def floor_of(contest: Contest) -> Floor:
    """The floor of what the base leaves of the reference records, or without them of what the richest model of all
    leaves of the training records: every effect that was looked at, in proportion, and an operator finer than any
    base's."""
    runs = [run.modelled for run in contest.likelihood.runs]
    references = [run for run in runs if run.run.role == "reference"]
    if not references:
        left = _beyond_the_richest(contest)
        return Floor(_noise([run for run in runs if run.run.role == "train"], left), math.sqrt(power_um2(left)))
    left = [_detrended(run.error(), run) for run in references]
    noise = as_idle(_noise(references, left), [r.error() for r in runs if r.run.role != "reference" and r.run.idle])
    return Floor(noise, math.sqrt(power_um2(left)))


def _noise(runs: Sequence[ModelledRun], errors: Sequence[Samples]) -> Noise:
    pairs = [(e, run.run.u_V[run.run.rows][-len(e) :]) for run, e in zip(runs, errors, strict=True)]
    driven = [pair for run, pair in zip(runs, pairs, strict=True) if not run.run.idle]
    return fit_noise(driven, [e for run, (e, _) in zip(runs, pairs, strict=True) if run.run.idle], runs[0].run.step_s)


def _beyond_the_richest(contest: Contest) -> list[Samples]:
    """Per training run what least squares with all columns leaves of it, (n,) in um, as large as noise was that left as
    much when so many amounts were fitted to it."""
    pairs = zip(contest.likelihood.runs, contest.starts.shapes.columns, strict=True)
    train = [(run, columns) for run, columns in pairs if run.modelled.run.role == "train"]
    columns = [np.concatenate([one, run.coefficients(_rich_columns(run.modelled))], axis=1) for run, one in train]
    targets = [run.base_error[:, 0] for run, _ in train]
    normal = np.sum([one.T @ one for one in columns], axis=0)
    right = np.sum([one.T @ target for one, target in zip(columns, targets, strict=True)], axis=0)
    scale = np.sqrt(np.diag(normal)) + 1e-30
    # Many columns are nearly the same; what they share is fitted once.
    inverse, rank = pinvh(normal / np.outer(scale, scale), rtol=SAME_SHARE, return_rank=True)
    amounts = inverse @ (right / scale) / scale
    rows = sum(len(one) for one in targets)
    unfitted = np.sqrt(rows / max(rows - rank, 1))
    left = [unfitted * (target - one @ amounts) for one, target in zip(columns, targets, strict=True)]
    return [np.asarray(idct(np.append(0.0, one), norm="ortho")) for one in left]


def _rich_columns(modelled: ModelledRun) -> Samples:
    """Columns (n, k) in um of an operator richer than any base, which tell noise from misfit where no reference
    does."""
    run, view = modelled.run, modelled.axis.time
    assert view is not None
    v, slope = view.field.of(run.u_V), RICH_STD * mean_slope(modelled.axis)
    low, high = float(v.min()), float(v.max())
    r = play_thresholds(high - low, RICH_PLAYS)
    rows = np.arange(run.start, run.stop, dtype=np.uintp)
    moved, _ = plays(v, r, np.clip(view.rest_fraction * r, v[0] - r, v[0] + r), rows)
    knots = np.linspace(low, high, RICH_SEGMENTS + 2)[1:-1]
    bends = np.maximum(v[run.rows, None] - knots, 0.0)
    return np.asarray(slope * np.concatenate([moved, bends], axis=1))


def _detrended(error: Samples, modelled: ModelledRun) -> Samples:
    """A residual (n,) without what the run's own nuisances explain of it."""
    amounts, *_ = np.linalg.lstsq(modelled.nuisances, error, rcond=1e-8)
    return np.asarray(error - modelled.nuisances @ amounts)
