"""Whether a column is in another unit: it then moves a thousand times as far as expected, or a thousandth of it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from phaselead.record.axis_record import Samples
from phaselead.record.direction import slow_gain, summed

PREFIX = 3
"""Decades from one unit to the next: mV and V, nm and um, um and mm."""
NEAR = 0.5
"""Decades about that within which a factor is one of units. No stage does as much: the catalogue's change of gain comes
to 0.1 at least, a saturated or dead-banded one to some hundredths."""
AS_SLOW = 10.0
"""Times the frequency of the slowest record up to which another is judged. Behind a mode the motion falls with the
square of the frequency: over a decade to a hundredth, which is no unit yet."""


def in_another_unit(factor: float) -> bool:
    """Whether motion by this positive factor of what was expected says that a column is in another unit."""
    return abs(math.log10(factor)) > PREFIX - NEAR


def factors_moved(pairs: Sequence[tuple[Samples, Samples]], steps_s: Sequence[float]) -> dict[int, float]:
    """The positive ones of ``gains_moved`` up to AS_SLOW: what runs against what was expected may be behind a mode, as
    far down as that, or seen by a sensor that counts backwards. Of faster records those that move a unit further than
    any of these: behind a mode motion falls far, but that of a flexure raises it a hundred times at most (zeta 0.005).
    These must do so as a whole: what little slow motion is in a fast drive may be creep.
    """
    f_Hz = _frequencies_Hz(pairs, steps_s)
    gains = {i: gain for i, gain in _gains(pairs, f_Hz).items() if gain > 0}
    slow = _about_as_slow(f_Hz, AS_SLOW)
    largest = max((gain for i, gain in gains.items() if i in slow), default=math.inf)
    whole = {i: float(np.std(pairs[i][1]) / np.std(pairs[i][0])) for i in gains}
    return {i: g for i, g in gains.items() if i in slow or in_another_unit(max(min(g, whole[i]) / largest, 1.0))}


def gains_moved(pairs: Sequence[tuple[Samples, Samples]], steps_s: Sequence[float], as_slow: float) -> dict[int, float]:
    """Factors by which positions follow what was expected of them, of the records that tell: by their place in
    ``pairs``, what was expected and the position (n,), of rows ``steps_s`` apart. Of what is driven more than
    ``as_slow`` times as fast as the slowest record nothing is said."""
    return _gains(pairs, _about_as_slow(_frequencies_Hz(pairs, steps_s), as_slow))


def _gains(pairs: Sequence[tuple[Samples, Samples]], which: Iterable[int]) -> dict[int, float]:
    found = {i: slow_gain([pairs[i]]) for i in which}
    return {i: gain for i, gain in found.items() if gain is not None}


def _about_as_slow(f_Hz: Mapping[int, float], times: float) -> list[int]:
    """Those that are driven at most so many times as fast as the slowest."""
    slowest_Hz = min(f_Hz.values(), default=0.0)
    return [i for i, one_Hz in f_Hz.items() if one_Hz <= times * slowest_Hz]


def _frequencies_Hz(pairs: Sequence[tuple[Samples, Samples]], steps_s: Sequence[float]) -> dict[int, float]:
    """Of all that moves."""
    return {i: _frequency_Hz(pairs[i][0], step_s) for i, step_s in enumerate(steps_s) if np.ptp(pairs[i][0]) > 0}


def unit_remedy(factor: float, of_all: bool) -> str:
    """What to do about a column that is in another unit by this factor, in all of the records or in some: a map is for
    all of them."""
    if not of_all:
        return (
            "name the column that is in another unit by that, as x_nm or u_mV, in the header of the file, and let "
            "`phaselead log import` convert it"
        )
    whole = 10.0 ** (PREFIX * round(math.log10(factor) / PREFIX))
    return (
        "map all columns, with the factor of the one that is in another unit, as --map "
        f"t_s=1,u_V=2,x_um=3*{1 / whole:g} or t_s=1,u_V=2*{whole:g},x_um=3 (in Python map=)"
    )


def _frequency_Hz(values: Samples, step_s: float) -> float:
    """Of what counts in ``slow_gain``."""
    return float(np.std(values) / (2 * np.pi * step_s * np.std(summed(values))))
