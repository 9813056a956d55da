"""What no voltage predicts: hum, vibration, quantisation and jitter, found in spectra and likelihoods.

Each is looked for in the training residual, must be found again in the held-out one, and must be more than the
reference records show. Idle records are asked where there are any.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from phaselead.gap.disturbance import Disturbance
from phaselead.gap.hum import hum, is_mains
from phaselead.gap.jitter import jitter
from phaselead.gap.quantisation import quantisation
from phaselead.gap.residual import RunResidual
from phaselead.gap.vibration import vibration

Test = Callable[[Sequence[RunResidual], Sequence[RunResidual], Sequence[RunResidual]], Disturbance | None]


def disturbances(
    train: Sequence[RunResidual], holdout: Sequence[RunResidual], reference: Sequence[RunResidual], allowed: set[str]
) -> tuple[list[Disturbance], dict[str, str], list[str]]:
    """What is there, why the rest could not be tested, by name, and what is there but was left out of the catalogue."""
    quiet = [_quiet(part) for part in (train, holdout, reference)]
    idle = all(part and all(left.run.idle for left in part) for part in quiet[:2])
    tests: dict[str, tuple[Test, bool]] = {
        "mains_hum": (hum, idle),
        "vibration": (vibration, idle),
        "quantisation": (quantisation, True),
        "sampling_jitter": (jitter, any(left.run.driven for left in train)),
    }
    found, untestable = [], {}
    for name, (test, possible) in tests.items():
        if not possible:
            untestable[name] = (
                "needs idle training and held-out records" if name != "sampling_jitter" else "needs motion"
            )
            continue
        parts = quiet if name in ("mains_hum", "vibration") else [train, holdout, reference]
        seen = test(*parts)
        if seen is not None:
            found.append(seen)
    if any(f.name == "mains_hum" for f in found):
        found = [f for f in found if f.name != "vibration" or not is_mains(f.params["f_Hz"][0])]
    left_out = [
        f"the records' noise is new: {f.why}; no effect that is allowed says so" for f in found if f.name not in allowed
    ]
    untestable = {name: why for name, why in untestable.items() if name in allowed}
    return [f for f in found if f.name in allowed], untestable, left_out


def _quiet(part: Sequence[RunResidual]) -> list[RunResidual]:
    idle = [left for left in part if left.run.idle]
    return idle or list(part)
