"""Everything the search needs of one axis under one base model: tracks, metric, panels, and the correction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from phaselead.gap.atoms import Freedom, atoms_of, rich_columns
from phaselead.gap.correction import Correction, flexible_left, from_reference, prior
from phaselead.gap.evidence import evidence, fair_weights, noise_of
from phaselead.gap.mistaken import mistaken_gains
from phaselead.gap.noise import Noise, as_idle
from phaselead.gap.panel import Layout, Panel, Raw, panel, raw
from phaselead.gap.records import Run
from phaselead.gap.residual import Track, track
from phaselead.model import AxisModel, Effect, Extra
from phaselead.record import Samples


@dataclass(frozen=True)
class Bench:
    """One axis, ready to be searched. ``slim`` is ``train`` with the common columns only, ``correction`` is theirs."""

    axis: AxisModel
    layout: Layout
    train: Panel
    slim: Panel
    holdout: Panel
    reference: Panel | None
    correction: Correction
    noise: Noise
    freedom: Freedom
    mistaken: Mapping[str, float]
    """By effect: what its gains on reference records say about believing them."""

    @property
    def open_plays(self) -> bool:
        """Whether the base was fitted to the training records."""
        return self.freedom.open_plays

    @property
    def common(self) -> Correction:
        """The correction placed in the full layout."""
        return self.correction.at(self.layout.common())

    def tracks(self) -> tuple[Track, ...]:
        """Of the training records."""
        return self.train.evidence.tracks


def bench(
    axis: AxisModel,
    runs: Sequence[Run],
    effects: Sequence[Effect],
    frozen: bool,
    open_plays: bool = False,
    plain: bool = False,
) -> Bench:
    """Simulate, whiten and multiply out. ``effects`` are those that can be written as a response to voltage or time.

    ``open_plays``: the plays were fitted to these very records and move with every effect that is added.
    ``plain``: squares of micrometres count alike at every frequency, as for finding memory that a base lacks; the
    metric that expects the slow misfit of a memory model would forgive just that.
    """
    tracks = [track(axis, run) for run in runs]
    train, held, reference = ([t for t in tracks if t.run.role == role] for role in ("train", "holdout", "reference"))
    freedom = Freedom(open_plays, learned=bool(reference))
    longest = max(t.run.t_s[-1] - t.run.t_s[0] for t in train)
    atoms = atoms_of(effects, train[0].run.step_s, float(longest))
    train_raw = [raw(t, atoms, freedom) for t in train]
    n_base = train_raw[0].columns.shape[1] - sum(len(a.steps) for a in atoms)
    layout = Layout(tuple(atoms), n_base)
    held_raw = [raw(t, layout.coarser().atoms, freedom) for t in held]
    mistaken: dict[str, float] = {}
    if reference:
        whole = [raw(t, atoms, freedom) for t in reference]
        coarse = [replace(r, columns=r.columns[:, layout.common()]) for r in whole]
        noise, reference_panel, correction = _from_reference(coarse, layout)
        fine = panel(reference_panel.evidence, layout, whole)
        mistaken = mistaken_gains(fine, layout, _errors(whole))
        noise = as_idle(noise, [t.error() for t in [*train, *held] if t.run.idle])
    else:
        correction, reference_panel = prior(layout.coarser(), frozen), None
        noise = _from_training(train_raw, layout, correction)
    if plain:
        noise = Noise(np.ones(1), noise.level_um, 0.0, 1.0, 0.0, np.ones(1))
    full = _weighed(panel(evidence(train, noise), layout, train_raw), train_raw, correction.at(layout.common()))
    slim = full.restricted(layout.common())
    holdout = _weighed(panel(evidence(held, noise), layout.coarser(), held_raw), held_raw, correction)
    return Bench(axis, layout, full, slim, holdout, reference_panel, correction, noise, freedom, mistaken)


def beside(made: Bench, extra: Extra) -> Bench:
    """The bench with every column simulated anew beside the effects ``extra``: what the base misses passes through a
    named delay or mode like everything else."""
    train_raw = [raw(t, made.layout.atoms, made.freedom, extra) for t in made.tracks()]
    coarse = made.layout.coarser()
    held_raw = [raw(t, coarse.atoms, made.freedom, extra) for t in made.holdout.evidence.tracks]
    full = panel(made.train.evidence, made.layout, train_raw)
    holdout = panel(made.holdout.evidence, coarse, held_raw)
    return replace(made, train=full, slim=full.restricted(made.layout.common()), holdout=holdout)


def slim_beside(made: Bench, extra: Extra) -> Panel:
    """The common columns of the training records alone, simulated anew beside the effects ``extra``."""
    coarse = made.layout.coarser()
    raws = [raw(t, coarse.atoms, made.freedom, extra) for t in made.tracks()]
    found = panel(made.train.evidence, coarse, raws)
    return found.restricted(np.arange(found.size))


def _errors(raws: Sequence[Raw]) -> list[Samples]:
    return [np.asarray(r.track.run.x_um[r.track.run.rows] - r.base_um) for r in raws]


def _from_reference(raws: Sequence[Raw], layout: Layout) -> tuple[Noise, Panel, Correction]:
    """Noise of what the catalogue cannot describe of the base's misfit, and the description of the rest."""
    tracks, errors = [r.track for r in raws], _errors(raws)
    noise = noise_of(tracks, [_detrended(e, r.track) for e, r in zip(errors, raws, strict=True)])
    for _ in range(2):
        found = panel(evidence(tracks, noise), layout.coarser(), raws)
        correction, _ = from_reference(found, errors)
        rest = [_detrended(e - r.columns @ correction.mean, r.track) for e, r in zip(errors, raws, strict=True)]
        noise = noise_of(tracks, rest)
    found = panel(evidence(tracks, noise), layout.coarser(), raws)
    correction, weights = from_reference(found, errors)
    return noise, found.reweighted(weights), correction


def _from_training(raws: Sequence[Raw], layout: Layout, correction: Correction) -> Noise:
    """Noise of what neither a combination of effects nor a rich operator explains."""
    richer = [replace(r, columns=np.concatenate([r.columns, _rich(r.track)], axis=1)) for r in raws]
    tracks, errors = [r.track for r in raws], _errors(raws)
    noise = noise_of(tracks, [_explained(e, r) for e, r in zip(errors, richer, strict=True)])
    for _ in range(2):
        found = panel(evidence(tracks, noise), layout, richer)
        amounts = _flexible(found, errors, correction.at(layout.common()))
        rest = [_detrended(e + r.columns @ amounts[:-1], r.track) for e, r in zip(errors, richer, strict=True)]
        noise = noise_of(tracks, rest)
    return noise


def _rich(of: Track) -> NDArray[np.float32]:
    return rich_columns(of).astype(np.float32)


def _explained(error: Samples, by: Raw) -> Samples:
    """What plain least squares with all columns leaves: a first guess."""
    columns = np.concatenate([by.track.local, by.columns], axis=1)
    live = columns[:, np.ptp(columns, axis=0) > 0]
    columns = np.concatenate([np.ones((len(error), 1)), live], axis=1)
    scale = np.sqrt(np.mean(columns**2, axis=0))
    amounts, *_ = np.linalg.lstsq(columns / scale, error, rcond=1e-6)
    return np.asarray(error - (columns / scale) @ amounts)


def _flexible(found: Panel, errors: Sequence[Samples], correction: Correction) -> Samples:
    moments = found.with_columns([e[:, None] for e in errors])
    return flexible_left(moments, correction, np.arange(found.size), found.size)


def _detrended(error: Samples, of: Track) -> Samples:
    """Without what the record's own nuisances explain."""
    amounts, *_ = np.linalg.lstsq(of.local, error, rcond=1e-8)
    return np.asarray(error - of.local @ amounts)


def _weighed(found: Panel, raws: Sequence[Raw], correction: Correction) -> Panel:
    """Weights that make each block's flexible residual as large as the whitener promised."""
    errors = _errors(raws)
    rows = [np.diff(e).astype(np.float64) for e in found.evidence.edges]
    for _ in range(2):
        moments = found.with_columns([e[:, None] for e in errors])
        amounts = flexible_left(moments, correction, np.arange(found.size), found.size)
        left = found.unweighted(np.einsum("i,bij,j->b", amounts, moments, amounts))
        found = found.reweighted([fair_weights(part, r) for part, r in zip(left, rows, strict=True)])
    return found
