"""Creep that ``fit`` finds in the reference records of stages of ``tests/gap/truth_c``, and what the model then leaves.

Run with `.venv/bin/python benchmarks/creep.py [STAGES [FIRST]]`, default 8 stages from the 20th of set ``tuning`` on,
with nothing hidden. Of each it prints what creeps in a decade of time, true and found, and the largest error (rms about
the mean, in per cent of the travel) of a held-out record that moves by a tenth of the travel and more, without creep in
the model and with it; then the medians. A minute or two each; judges nothing.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from phaselead.gap import left_um
from phaselead.identify import fit
from phaselead.model import Stage
from phaselead.record import Recording
from phaselead.validation.truth import Case, load_truth

FOLDER = Path(__file__).parents[1] / "tests/gap/truth_c"
MOVES, LEAST = 0.1, 0.01
"""Of the travel: what a record moves that is judged, and that is fitted."""


def range_um(record: Recording) -> float:
    """Of its first axis."""
    x_um = next(iter(record.axes.values())).x_um
    return 0.0 if x_um is None else float(np.ptp(x_um))


def worst(stage: Stage, records: Sequence[Recording], travel_um: float) -> float:
    """Largest error in per cent of the travel."""
    moving = [record for record in records if range_um(record) > MOVES * travel_um]
    return max(100 * left_um(stage, [record]) / travel_um for record in moving)


def row(case: Case) -> tuple[float, float]:
    """Without creep and with it; prints its row."""
    traits: Any = getattr(case, "traits", None)
    reference, _, holdout = case.records()
    driven = [record for record in reference if range_um(record) > LEAST * traits.travel_um]
    plain, creeping = fit(driven, creep=False)[0], fit(driven)[0]
    axis = next(iter(creeping.axes.values()))
    found = sum(float(np.sum(one.params["gamma"])) for one in axis.effects if one.name == "creep")
    true = 0.0 if traits.creep is None else traits.creep[0]
    left = worst(plain, holdout, traits.travel_um), worst(creeping, holdout, traits.travel_um)
    print(f"| {case.name} | {100 * true:.2f} | {100 * found:.2f} | {left[0]:.3f} | {left[1]:.3f} |", flush=True)
    return left


def main() -> None:
    given = [int(value) for value in sys.argv[1:]]
    stages, first = [*given, *(8, 20)[len(given) :]]
    cases = sorted(load_truth(FOLDER).cases("tuning", ["none"], (1.0,), 1.0), key=lambda case: case.name)
    print("| stage | creep, % a decade | found | without it, % of the travel | with it |\n|---|---|---|---|---|")
    found = np.array([row(case) for case in cases[first : first + stages]])
    print(f"| median | | | {np.median(found[:, 0]):.3f} | {np.median(found[:, 1]):.3f} |")


if __name__ == "__main__":
    main()
