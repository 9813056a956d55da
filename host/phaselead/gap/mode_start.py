"""Where the refit of a mode starts: on a grid as fine as modes are sharp.

The atoms of a scan are few and broad, so that neighbours overlap; a mode of 1 % damping that lies between two of them,
or beside one of the base's own, leaves a refit from there in the wrong valley.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from phaselead.gap.correction import Correction
from phaselead.gap.panel import Panel
from phaselead.gap.refit import HIGHEST, Entry, Fitted, bounded, left_of
from phaselead.model import Effect

RATIO, ZETAS = 1.05, (0.01, 0.04)
STARTS, APART = 2, 1.2
"""How many, and their least ratio of frequencies."""
LOWEST = 0.005
"""Of the sampling rate: below it a mode is no more than a slow bend."""


def is_mode(effect: Effect) -> bool:
    """Whether it is told by a sharp frequency."""
    return {"f_Hz", "zeta"} == {p.name for p in effect.shapes} and len(effect.sizes) == 1


def mode_starts(panel: Panel, correction: Correction, fitted: Fitted, effect: Effect) -> list[list[Entry]]:
    """The fitted effects and a mode at each of the frequencies that leave least, with the share that fits there."""
    f, size = next(p for p in effect.shapes if p.name == "f_Hz"), effect.sizes[0]
    step_s = panel.evidence.tracks[0].run.step_s
    low, high = max(f.low, LOWEST / step_s), min(f.high, HIGHEST / step_s)
    if low >= high:
        return []
    grid_Hz = np.geomspace(low, high, max(2, round(np.log(high / low) / np.log(RATIO))))
    points = [{"f_Hz": float(f_Hz), "zeta": zeta} for f_Hz, zeta in product(grid_Hz, ZETAS)]
    columns = []
    for track in panel.evidence.tracks:
        answer = track.answer(fitted.entries)
        one = [track.answer([*fitted.entries, (effect, {**at, size.name: size.typical})]) - answer for at in points]
        columns.append(np.stack([*one, track.run.x_um[track.run.rows] - answer], axis=1))
    left = left_of(panel, correction, columns)
    power, along = np.diag(left)[:-1], left[:-1, -1]
    amounts = np.divide(along, power, out=np.zeros_like(along), where=power > 0)
    found: list[dict[str, float]] = []
    for i in np.argsort(-along * amounts):
        if all(abs(np.log(points[i]["f_Hz"] / other["f_Hz"])) > np.log(APART) for other in found):
            found.append({**points[i], size.name: float(amounts[i]) * size.typical})
        if len(found) == STARTS:
            break
    return [[*fitted.entries, (effect, bounded(effect, params))] for params in found]
