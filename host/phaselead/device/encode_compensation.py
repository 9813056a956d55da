"""What the inverse modes need, as the integers that an axis of the model blob holds."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import combinations
from typing import TypedDict

import numpy as np

from phaselead.device import wire
from phaselead.device.encode_filters import ONE_Q26, encode_section
from phaselead.errors import BadInput
from phaselead.model import KNOTS, PLAYS, SECTIONS, TERMS, TICK_S, Compensation

ONE_Q28 = 1 << 28
UNUSED = 2**31 - 1
"""Threshold of a play or dead zone that is not in use."""
LARGEST_PREVIEW_TICKS = 1024
LARGEST_OFFSET_um = 16384.0
LARGEST_COUPLING = 2.0
LEAST_DETERMINANT = 0.0626
"""The device's is 1/16."""
LARGEST_SHARE = 3.999
"""Of one axis in undoing another: the device's is below 4."""

Fixed = Callable[[float, int, str], int]
"""A value x 2^bits as int32, or BadInput with the key."""


class CompensationFields(TypedDict):
    """The fields of wire.AxisModel from preview_ticks_q16 to knot_s_q20."""

    preview_ticks_q16: int
    shape: tuple[wire.Biquad, ...]
    drive: tuple[wire.Biquad, ...]
    creep_k_q30: tuple[int, ...]
    creep_alpha_q48: tuple[int, ...]
    gain_q20: int
    offset_q16: int
    rest_fraction_q30: int
    play_r_q24: tuple[int, ...]
    play_w_q20: tuple[int, ...]
    knot_d_q24: tuple[int, ...]
    knot_s_q20: tuple[int, ...]


NO_COMPENSATION = CompensationFields(
    preview_ticks_q16=0,
    shape=(wire.Biquad(0, 0, 0, 0, 0),) * SECTIONS,
    drive=(wire.Biquad(0, 0, 0, 0, 0),),
    creep_k_q30=(0,) * TERMS,
    creep_alpha_q48=(0,) * TERMS,
    gain_q20=0,
    offset_q16=0,
    rest_fraction_q30=0,
    play_r_q24=(0,) * PLAYS,
    play_w_q20=(0,) * PLAYS,
    knot_d_q24=(0,) * KNOTS,
    knot_s_q20=(0,) * KNOTS,
)


def encode_compensation(found: Compensation, key: str, fixed: Fixed) -> CompensationFields:
    """Raises BadInput for a coefficient the device cannot hold: which, and by how much."""
    view = found.view
    ticks = found.preview_s / TICK_S
    if ticks > LARGEST_PREVIEW_TICKS:
        raise BadInput(
            f"{key}: a preview of {found.preview_s:.3g} s does not fit the device: it looks ahead at most "
            f"{LARGEST_PREVIEW_TICKS * TICK_S:.3g} s, this is {ticks / LARGEST_PREVIEW_TICKS:.3g} times that"
        )
    if abs(view.offset_um) > LARGEST_OFFSET_um:
        raise BadInput(
            f"{key}.time.offset_um = {view.offset_um:g} does not fit the device: it holds at most {LARGEST_OFFSET_um:g}"
        )

    def each(values: Sequence[float], bits: int, name: str, count: int, unused: int) -> tuple[int, ...]:
        held = [fixed(value, bits, f"{key}.time.{name}[{i}]") for i, value in enumerate(values)]
        return (*held, *[unused] * (count - len(held)))

    sections = [encode_section(section, f"{key}: section {i}") for i, section in enumerate(found.shape)]
    alphas = [round(-math.expm1(-TICK_S / tau_s) * 2**48) for tau_s in found.creep_tau_s]
    creep_k = [fixed(k, 30, f"{key}: creep k[{i}]") for i, k in enumerate(found.creep_k)]
    return CompensationFields(
        preview_ticks_q16=round(ticks * 2**16),
        shape=(*sections, *[wire.Biquad(ONE_Q26, 0, 0, 0, 0)] * (SECTIONS - len(sections))),
        drive=(encode_section(found.drive, f"{key}: amplifier"),),
        creep_k_q30=(*creep_k, *[0] * (TERMS - len(creep_k))),
        creep_alpha_q48=(*alphas, *[0] * (TERMS - len(alphas))),
        gain_q20=fixed(view.gain_um_per_V, 20, f"{key}.time.gain_um_per_V"),
        offset_q16=fixed(view.offset_um, 16, f"{key}.time.offset_um"),
        rest_fraction_q30=fixed(view.rest_fraction, 30, f"{key}.time.rest_fraction"),
        play_r_q24=each(view.play_r_V, 24, "play_r_V", PLAYS, UNUSED),
        play_w_q20=each(view.play_w_um_per_V, 20, "play_w_um_per_V", PLAYS, 0),
        knot_d_q24=each(view.deadzone_d_V, 24, "deadzone_d_V", KNOTS, UNUSED),
        knot_s_q20=each(view.deadzone_s_um_per_V, 20, "deadzone_s_um_per_V", KNOTS, 0),
    )


def refuse_singular(matrix: Sequence[Sequence[float]]) -> None:
    """Raises BadInput when some axes, moving together, cannot be told apart by what the sensors see."""
    for size in (2, 3):
        for chosen in combinations(range(3), size):
            part = np.array(matrix)[np.ix_(chosen, chosen)]
            determinant = float(np.linalg.det(part))
            if determinant < LEAST_DETERMINANT or np.abs(np.linalg.inv(part)).max() > LARGEST_SHARE:
                names = " and ".join("xyz"[i] for i in chosen)
                raise BadInput(
                    f"cross_coupling: {names} are coupled so strongly that the device cannot decouple them "
                    f"(determinant {determinant:.3g}, it takes {LEAST_DETERMINANT:g}, and shares below 4); leave the "
                    "coupling out to run without"
                )


def encode_coupling(row: Sequence[float], axis: str) -> tuple[int, ...]:
    """A row of the coupling matrix, its own share exactly 1."""
    for other, share in zip("xyz", row, strict=True):
        if other != axis and abs(share) >= LARGEST_COUPLING:
            raise BadInput(
                f"cross_coupling: {axis} sees {share:.3g} of the motion of {other}; the device decouples less than "
                f"{LARGEST_COUPLING:g}; leave the coupling out to run without"
            )
    return tuple(round(share * ONE_Q28) for share in row)


def held_values(fields: wire.AxisModel) -> dict[str, list[float]]:
    """What an axis of a model blob holds of its compensation, back in the units of the names."""
    return {
        "preview_s": [fields.preview_ticks_q16 / 2**16 * TICK_S],
        "gain_um_per_V": [fields.gain_q20 / 2**20],
        "offset_um": [fields.offset_q16 / 2**16],
        "rest_fraction": [fields.rest_fraction_q30 / 2**30],
        "play_r_V": [v / 2**24 for v in fields.play_r_q24],
        "play_w_um_per_V": [v / 2**20 for v in fields.play_w_q20],
        "deadzone_d_V": [v / 2**24 for v in fields.knot_d_q24],
        "deadzone_s_um_per_V": [v / 2**20 for v in fields.knot_s_q20],
        "creep_k": [v / 2**30 for v in fields.creep_k_q30],
        "creep_alpha": [v / 2**48 for v in fields.creep_alpha_q48],
    }
