"""Joint nonlinear refit of named effects in the metric: Levenberg-Marquardt on moments.

The residual and its tangents are simulated exactly; record nuisances and what the base may absorb are projected out
in every step (variable projection), so the parameters come out as if all had been fitted together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_solve

from phaselead.gap.correction import Correction
from phaselead.gap.panel import Panel
from phaselead.gap.residual import Track
from phaselead.model import Effect, Parameter
from phaselead.record import Samples

Entry = tuple[Effect, Mapping[str, float]]

STEPS = 12
HIGHEST = 0.45
"""Of the sampling rate: no mode is looked for above it."""
DIFFERENCE = 0.01
ENOUGH = 0.05
"""A step that gains less than this in whitened squares ends the fit."""


@dataclass(frozen=True)
class Fitted:
    """Effects at their best."""

    entries: tuple[Entry, ...]
    squares: float
    total: Samples | None = None
    """Sum (k, k) of the moments of [common columns, tangents, residual] there, where it was asked for."""

    @property
    def free(self) -> tuple[tuple[int, Parameter], ...]:
        """Every parameter, and the entry that it belongs to."""
        return tuple((i, p) for i, (effect, _) in enumerate(self.entries) for p in effect.parameters)

    @property
    def n_tangents(self) -> int:
        return len(self.free)


def refit(panel: Panel, correction: Correction, start: Sequence[Entry], steps: int = STEPS) -> Fitted:
    """Best parameters of the effects ``start``, all free, from where they are. ``panel`` holds the common columns.

    A frequency stays below what the sampling can show.
    """
    highest_Hz = HIGHEST / panel.evidence.tracks[0].run.step_s
    start = [(_sampled(effect, highest_Hz), params) for effect, params in start]
    rest = _Rest(panel, correction)
    best = Fitted(tuple(start), rest.squares(start))
    damping = 1e-3
    for _ in range(steps if best.free else 0):
        gained = 0.0
        left = rest.of(_total(panel, best))
        normal, right = left[:-1, :-1], left[:-1, -1]
        for _ in range(5):
            step: Samples = np.asarray(np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-12), right))
            tried = _moved(best, step)
            tried_squares = rest.squares(tried)
            if tried_squares < best.squares:
                gained = best.squares - tried_squares
                best = Fitted(tuple(tried), tried_squares)
                damping = max(damping / 5, 1e-8)
                break
            damping = max(damping, 1e-4) * 8
        if gained < ENOUGH:
            break
    return best


def with_total(panel: Panel, fitted: Fitted) -> Fitted:
    """With the sum of its moments."""
    return replace(fitted, total=_total(panel, fitted))


def _sampled(effect: Effect, highest_Hz: float) -> Effect:
    if not any(p.unit == "Hz" and p.high > highest_Hz > p.low for p in effect.parameters):
        return effect
    limited = (replace(p, high=highest_Hz) if p.unit == "Hz" and p.high > highest_Hz else p for p in effect.parameters)
    return replace(effect, parameters=tuple(limited))


class _Rest:
    """What is left of fresh columns once the common columns took up theirs, whose own moments stay the same."""

    def __init__(self, panel: Panel, correction: Correction) -> None:
        self._panel, self._correction = panel, correction
        self._factor = correction.factor(panel.fixed_total)

    def of(self, total: Samples) -> Samples:
        """Moments (q, q) of the fresh columns, the residual last, from the sum (k + q, k + q) of all."""
        k = self._panel.size
        shifted = self._correction.applied(total, len(total) - 1)
        taken = shifted[self._correction.index, k:]
        return np.asarray(shifted[k:, k:] - taken.T @ cho_solve(self._factor, taken, check_finite=False))

    def squares(self, entries: Sequence[Entry]) -> float:
        """Whitened squares that the effects leave."""
        residuals = [track.error(entries)[:, None] for track in self._panel.evidence.tracks]
        return float(self.of(self._panel.total_with_columns(residuals))[-1, -1])


def _total(panel: Panel, fitted: Fitted) -> Samples:
    return panel.total_with_columns([fresh_columns(t, fitted.entries, fitted.free) for t in panel.evidence.tracks])


def fresh_columns(track: Track, entries: Sequence[Entry], free: Sequence[tuple[int, Parameter]]) -> Samples:
    """(n, tangents + 1) in um: what one internal unit of each free parameter does, and the residual."""
    answer = track.answer(entries)
    columns = [(track.answer(_changed(entries, i, p, d)) - answer) / d for i, p, d in _differences(entries, free)]
    return np.stack([*columns, track.run.x_um[track.run.rows] - answer], axis=1)


def squares(panel: Panel, correction: Correction, entries: Sequence[Entry]) -> float:
    """Whitened squares that the effects leave, everything else projected out."""
    return _Rest(panel, correction).squares(entries)


def left_of(panel: Panel, correction: Correction, fresh: Sequence[Samples]) -> Samples:
    """Moments (q, q) of fresh columns (n, q) per track, everything else projected out."""
    return _Rest(panel, correction).of(panel.total_with_columns(fresh))


def bounded(effect: Effect, params: Mapping[str, float]) -> dict[str, float]:
    """Parameters moved inside their bounds."""
    return {p.name: float(np.clip(params[p.name], p.low, p.high)) for p in effect.parameters}


def _differences(entries: Sequence[Entry], free: Sequence[tuple[int, Parameter]]) -> list[tuple[int, Parameter, float]]:
    """A finite difference in internal units for each free parameter, towards the inside of its bounds."""
    found = []
    for i, p in free:
        at = inner(p, entries[i][1][p.name])
        inside = at + DIFFERENCE < inner(p, p.high)
        found.append((i, p, DIFFERENCE if inside else -DIFFERENCE))
    return found


def _changed(entries: Sequence[Entry], index: int, p: Parameter, change: float) -> list[Entry]:
    changed = list(entries)
    effect, params = entries[index]
    changed[index] = (effect, {**params, p.name: outer(p, inner(p, params[p.name]) + change)})
    return changed


def _moved(fitted: Fitted, step: Samples) -> list[Entry]:
    moved = [(effect, dict(params)) for effect, params in fitted.entries]
    for (i, p), change in zip(fitted.free, step, strict=True):
        limited = float(np.clip(change, -1.0, 1.0)) if in_ratios(p) else float(change)
        moved[i][1][p.name] = outer(p, inner(p, moved[i][1][p.name]) + limited)
    return list(moved)


def inner(p: Parameter, value: float) -> float:
    """Internal unit: the logarithm of what is scanned in ratios, typical values otherwise."""
    return float(np.log(value)) if in_ratios(p) else value / scale(p)


def outer(p: Parameter, value: float) -> float:
    """Back from the internal unit, within the bounds."""
    return float(np.clip(np.exp(value) if in_ratios(p) else value * scale(p), p.low, p.high))


def in_ratios(p: Parameter) -> bool:
    """Shapes of a logarithmic scale; a size must be able to reach 0."""
    return p.log and p.low > 0


def scale(p: Parameter) -> float:
    """One internal unit of a parameter that is not logarithmic."""
    return abs(p.typical) if p.typical else (p.high - p.low) / 10
