"""What ``fit`` leaves of the stages of ``tests/gap/truth`` without noise, part of the stage by part: the floor under
everything that ``gap`` looks for there.

Run with `.venv/bin/python benchmarks/base_misfit.py [STAGES]`, default 6. Each stage of set ``tuning`` with nothing
hidden is recorded as a lab would; the model is fitted to its reference records and judged on the last three quarters of
its held-out ones, each about its mean: at the start of a record the mode may still ring from the one before, which
``predict`` does not know and ``gap`` leaves out. Prints the median over the stages; judges nothing.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from phaselead.model import predict
from phaselead.validation.trial import base_model
from phaselead.validation.truth import load_truth

FOLDER = Path(__file__).parents[1] / "tests/gap/truth"
QUIET = {"white_um": 1e-6, "coloured_um": 1e-6}
PARTS: dict[str, tuple[dict[str, float], bool]] = {
    "the stage": ({}, False),
    "without friction": ({"friction": 0.0}, False),
    "without creep": ({"base_creep": 0.0}, False),
    "without both, and a second mode": ({"friction": 0.0, "base_creep": 0.0, "second_share": 0.0}, False),
    "and a straight read-out of its memory": ({"friction": 0.0, "base_creep": 0.0, "second_share": 0.0}, True),
}
"""By name what is changed in a stage, and whether the Preisach plane is read through an even density."""


def left(number: int, changed: dict[str, float], straight: bool) -> dict[str, float]:
    """Rms error in per cent of the travel by held-out record."""
    truth: Any = load_truth(FOLDER)
    case = truth.case(f"tuning/none/nothing/0/fast/{number}")
    plane = sys.modules[type(case).__module__.rsplit(".", 1)[0] + ".memory"].PreisachPlane
    bent = plane.read
    character = replace(case.characters["x"], **QUIET, **changed)
    case.__dict__["characters"] = {"x": character}
    try:
        if straight:
            plane.read = lambda self, psi: np.asarray(psi @ self.weights)
        reference, _, holdout = case.records()
    finally:
        plane.read = bent
    stage, found = base_model(case, reference), {}
    for record in holdout:
        error_um = (record.x_um - predict(stage, record).x_um)[len(record.t_s) // 4 :]
        found[Path(record.source).stem.removeprefix("holdout-")] = 100 * float(error_um.std()) / character.range_um
    return found


def main() -> None:
    stages = int(sys.argv[1]) if len(sys.argv) > 1 else 6
    for i, (name, (changed, straight)) in enumerate(PARTS.items()):
        rows = [left(number, changed, straight) for number in range(1, 2 * stages, 2)]
        kinds = [kind for kind in rows[0] if kind != "idle"]
        if i == 0:
            print(f"rms in % of the travel, median of {stages} stages: {', '.join(kinds)}")
        print(f"{name:40}", "  ".join(f"{np.median([row[kind] for row in rows]):.3f}" for kind in kinds), flush=True)


if __name__ == "__main__":
    main()
