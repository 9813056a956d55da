"""Second-order sections as the integers that travel."""

from __future__ import annotations

from collections.abc import Sequence

from phaselead.device import wire
from phaselead.errors import BadInput
from phaselead.model import SECTIONS_IN_LOOP, LoopFilter, Section

ONE_Q26 = 1 << 26
LARGEST_Q26 = (1 << 31) - 1
LARGEST_IN_LOOP = 16
"""Of b in a section of the loop, which the device sums in 64 bits (firmware/core/loop_filter.c)."""
NO_FILTER = wire.Biquad(0, 0, 0, 0, 0)


def encode_section(section: Section, key: str) -> wire.Biquad:
    """b1 takes what rounding leaves, so that the static gain stays exactly 1. Raises BadInput for one that the device's
    format cannot hold, or that it would not be stable in."""
    b0, b2, a1, a2 = (round(value * ONE_Q26) for value in (section.b[0], section.b[2], *section.a))
    b1 = ONE_Q26 + a1 + a2 - b0 - b2
    largest = max(map(abs, (b0, b1, b2, a1, a2)))
    if largest > LARGEST_Q26:
        raise BadInput(
            f"{key} does not fit the device: a coefficient of {largest / ONE_Q26:.4g}, it holds less than "
            f"{(LARGEST_Q26 + 1) / ONE_Q26:g}"
        )
    if not (a2 < ONE_Q26 and abs(a1) < ONE_Q26 + a2):
        raise BadInput(f"{key}: rounded to the device's format it is not stable; its corner is too slow for a section")
    return wire.Biquad(b0, b1, b2, a1, a2)


def encode_filters(filters: Sequence[LoopFilter]) -> tuple[wire.Biquad, ...]:
    """Those of one axis; places that are not in use are all 0. Raises BadInput for what the device cannot hold."""
    if len(filters) > SECTIONS_IN_LOOP:
        raise BadInput(f"{len(filters)} filters: the device has {SECTIONS_IN_LOOP} an axis")
    sections = []
    for i, one in enumerate(filters):
        key = f"filters[{i}] ({describe_filter(one)})"
        section = encode_section(one.section(), key)
        largest = max(map(abs, (section.b0_q26, section.b1_q26, section.b2_q26))) / ONE_Q26
        if largest >= LARGEST_IN_LOOP:
            raise BadInput(
                f"{key} does not fit the device: it amplifies fast changes {largest:.3g} times, the device holds less "
                f"than {LARGEST_IN_LOOP}; bring zeros and poles nearer to each other"
            )
        sections.append(section)
    return (*sections, *[NO_FILTER] * (SECTIONS_IN_LOOP - len(sections)))


def describe_filter(one: LoopFilter) -> str:
    zeros = f"zeros at {one.zeros_Hz:g} Hz" if one.zeros_Hz else "no zeros"
    return f"{zeros}, poles at {one.poles_Hz:g} Hz"
