"""The search for what no voltage predicts: hum, vibration, quantisation and sampling jitter.

Each is looked for in the residual of the training records, must be found again in that of the held-out records, and
must be more than the reference records show. Records at rest are used alone wherever there are any.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from phaselead.gap.disturbances.disturbance import Disturbance, Residuals
from phaselead.gap.disturbances.hum import find_hum, is_mains, without_hum
from phaselead.gap.disturbances.jitter import find_jitter
from phaselead.gap.disturbances.quantisation import find_grid, rounded
from phaselead.gap.disturbances.vibration import find_vibration
from phaselead.gap.residual import RunResidual
from phaselead.model import Effect, catalogue

NO_GRID_BEFORE = "the sensor may always have had its steps: give --reference records"
NO_SPEED_BEFORE = "the model's own faults grow with the speed as well: give --reference records"


class _Test(NamedTuple):
    """How one kind of disturbance is looked for, and the records that it takes."""

    find: Callable[[str, Residuals, Residuals, Residuals], Disturbance | None]
    at_rest: bool
    """Whether training and held-out records at rest are needed, and used alone."""
    in_motion: bool
    """Whether the training records must move."""
    without_reference: str = ""
    """Why it says nothing without reference records; empty where it does not need them."""


TESTS = {
    "grid": _Test(find_grid, at_rest=False, in_motion=False, without_reference=NO_GRID_BEFORE),
    "lines": _Test(find_hum, at_rest=True, in_motion=False),
    "band": _Test(find_vibration, at_rest=True, in_motion=False),
    "speed": _Test(find_jitter, at_rest=False, in_motion=True, without_reference=NO_SPEED_BEFORE),
}
"""By ``Effect.seen_as``; in this order they are run and reported."""


def find_disturbances(
    train: Residuals, holdout: Residuals, reference: Residuals, allowed: set[str]
) -> tuple[list[Disturbance], dict[str, str], list[str]]:
    """What was found, why the others could not be tested, and messages on what was found but may not be named.

    ``allowed`` holds the names of the effects that may be named. All tests are run: noise that is plainly new but has
    no name in this catalogue must not pass as nothing.
    """
    every = [train, holdout, reference]
    quiet = [_at_rest(part) for part in every]
    resting = all(part and all(residual.run.idle for residual in part) for part in quiet[:2])
    moving = any(residual.run.driven for residual in train)
    found, untestable = [], {}
    for seen_as, test in TESTS.items():
        name = _effect_seen_as(seen_as).name
        if test.at_rest and not resting:
            untestable[name] = "needs training and held-out records at rest"
        elif test.in_motion and not moving:
            untestable[name] = "needs motion"
        elif test.without_reference and not reference:
            untestable[name] = test.without_reference
        else:
            one = test.find(name, *(quiet if test.at_rest else every))
            found += [one] if one is not None else []
            if seen_as == "grid" and one is not None:
                # Rounding adds noise at all frequencies. The other tests are to see as much of it in the reference.
                every[2] = rounded(reference, one.params["lsb_um"][0])
                quiet[2] = _at_rest(every[2])
            if seen_as == "lines" and one is not None:
                # Beside strong hum nothing else stands out at rest, and where lines are wide hum itself does.
                quiet = [without_hum(part, one.params["f_Hz"][0]) for part in quiet]
    found = _without_hum_as_vibration(found)
    not_allowed = [f"the records hold new noise, {f.why}, which no effect allowed here explains" for f in found
                   if f.name not in allowed]  # fmt: skip
    untestable = {name: why for name, why in untestable.items() if name in allowed}
    return [f for f in found if f.name in allowed], untestable, not_allowed


def _effect_seen_as(seen_as: str) -> Effect:
    """The effect of the catalogue that shows in this way."""
    return next(effect for effect in catalogue().values() if effect.seen_as == seen_as)


def _without_hum_as_vibration(found: Sequence[Disturbance]) -> list[Disturbance]:
    """The same without a vibration at the mains frequency where hum was found."""
    hum, vibration = _effect_seen_as("lines").name, _effect_seen_as("band").name
    if not any(f.name == hum for f in found):
        return list(found)
    return [f for f in found if f.name != vibration or not is_mains(f.params["f_Hz"][0])]


def _at_rest(part: Residuals) -> list[RunResidual]:
    """The records at rest, or all where there are none."""
    idle = [residual for residual in part if residual.run.idle]
    return idle or list(part)
