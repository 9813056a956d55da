"""What modes still ring of in a record at rest: the stage's own, which dies away, and no vibration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phaselead.gap.parameters import SizedEffect
from phaselead.gap.residual import ModelledRun, base_entries
from phaselead.model import Effect, Params, rewritten
from phaselead.record import Samples


def without_ringing(modelled: ModelledRun, entries: Sequence[SizedEffect], error: Samples) -> Samples:
    """A residual (n,) in um of a record at rest, about its mean, without the modes of the model and its effects that
    ring out in it, and to first order those whose frequency and damping are a little other.

    A steady oscillation at each of their frequencies is fitted beside, and stays: it dies away with no mode.
    """
    modes = _modes(modelled, entries)
    if not modes:
        return error
    run = modelled.run
    since_s = run.t_s - run.t_s[0]
    rings = np.concatenate([_ringing(modelled, one, params, since_s) for one, params in modes], axis=1)[run.rows]
    steady = np.concatenate([_steady(one, params, since_s) for one, params in modes], axis=1)[run.rows]
    columns = np.concatenate([rings, steady], axis=1)
    columns /= np.maximum(np.linalg.norm(columns, axis=0), 1e-30)
    amounts = np.linalg.lstsq(columns, error, rcond=None)[0]
    k = rings.shape[1]
    left = error - columns[:, :k] @ amounts[:k]
    return np.asarray(left - left.mean())


def _modes(modelled: ModelledRun, entries: Sequence[SizedEffect]) -> list[tuple[Effect, Params]]:
    """The effects of the model with modes, as others change them."""
    changed = rewritten([(one, one.complete(params)) for one, params in [*base_entries(modelled.axis), *entries]])
    return [(one, params) for one, params in changed if one.modes is not None and one.before_record is not None]


def _ringing(modelled: ModelledRun, one: Effect, params: Params, since_s: Samples) -> Samples:
    """Columns (n, 4 of each mode): as it rings out, and what a little more or less frequency and damping change."""
    assert one.before_record is not None
    rings = one.before_record(since_s, params, modelled.axis)
    return np.concatenate([rings, since_s[:, None] * rings], axis=1)


def _steady(one: Effect, params: Params, since_s: Samples) -> Samples:
    """Columns (n, 2 of each mode): an oscillation at its frequency, a quarter of a turn apart."""
    assert one.modes is not None
    turns = [2 * np.pi * f_Hz * since_s for _, f_Hz, _ in one.modes(params)]
    return np.stack([part for turn in turns for part in (np.cos(turn), np.sin(turn))], axis=1)
