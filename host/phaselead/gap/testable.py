"""Which effects of a catalogue some records can show, and why they cannot show the others."""

from __future__ import annotations

from collections.abc import Sequence

from phaselead.gap.residual import base_modes
from phaselead.model import AxisModel, Effect
from phaselead.quantity import digits

HIGHEST_OF_RATE = 0.45
"""Of the sampling rate: no frequency is looked for above it, where sampling shows no more of a period than its ends."""
NEEDS_FROZEN = "can be told only against a frozen base: give --reference records, or --frozen"
NEEDS_SESSION = (
    "a zero that moved shows only against a session before it: give three driven records and one at rest as "
    "--reference, and of the session itself three driven ones to train on, one to hold out, and one at rest"
)


def shown_by(effects: Sequence[Effect], axis: AxisModel, step_s: float) -> tuple[list[Effect], dict[str, str]]:
    """Effects as records of a sampling step show them on a base, without frequencies beyond the sampling and without
    parameters that change nothing there; and why others cannot be seen, by name. Disturbances are all kept: their tests
    know the sampling."""
    highest_Hz, modes = HIGHEST_OF_RATE / step_s, len(base_modes(axis))
    shown, beyond = [], {}
    for one in effects:
        lowest_Hz = max((p.low for p in one.parameters if p.unit == "Hz"), default=0.0)
        if lowest_Hz < highest_Hz or one.kind == "disturbance":
            shown.append(one.as_sampled(highest_Hz).beside_modes(modes))
        else:
            beyond[one.name] = f"needs records of more than {digits(lowest_Hz / HIGHEST_OF_RATE, 2)} rows per second"
    return shown, beyond


def responses(effects: Sequence[Effect], frozen: bool, referenced: bool) -> tuple[list[Effect], dict[str, str]]:
    """Effects that the search may name, and why others are not among them, by name.

    ``referenced``: whether there are reference records. Without them, a base that is not frozen is refitted together
    with the effects. Disturbances have tests of their own, but a drift is fitted like a response: its course in time
    is known.
    """
    allowed, refused = [], {}
    for one in effects:
        if one.moves_zero == "at once":
            refused[one.name] = NEEDS_SESSION
        elif one.alone_as is not None:
            refused[one.name] = f"one axis cannot tell it from {one.alone_as}, which stands for both"
        elif one.kind == "calibration" and not frozen:
            refused[one.name] = NEEDS_FROZEN
        elif one.kind != "disturbance" or one.moves_zero == "steadily":
            allowed.append(one if frozen or referenced else one.for_refitted_base())
    return allowed, refused
