"""Second-order filters behind the PID, as a stage file has them: a pair of zeros over a pair of poles."""

from __future__ import annotations

import cmath
import math
from typing import Annotated

from pydantic import Field

from phaselead.model.fields import NotNegative, Part, Positive
from phaselead.model.sections import TICK_S, HIGHEST_Hz, Section, section_of

SECTIONS_IN_LOOP = 2
"""Of an axis: firmware/core/loop_filter.h."""

Corner = Annotated[NotNegative, Field(le=HIGHEST_Hz)]


class LoopFilter(Part):
    """(1 + 2 zeta s/w + s^2/w^2) of the zeros over that of the poles, static gain 1. Zeros and poles at one frequency
    are a notch, poles alone a low-pass; above a damping of 1 a pair is real: a lag or a lead."""

    zeros_Hz: Corner = Field(description="frequency of the zeros, Hz; 0: none")
    zeros_zeta: NotNegative = Field(description="their damping")
    poles_Hz: Annotated[Positive, Field(le=HIGHEST_Hz)] = Field(description="frequency of the poles, Hz")
    poles_zeta: Positive = Field(description="their damping")

    def section(self) -> Section:
        """At the device's tick; poles and zeros are mapped as z = exp(s T)."""
        zeros = roots_z(self.zeros_Hz, self.zeros_zeta) if self.zeros_Hz else (0j,)
        return section_of(zeros, roots_z(self.poles_Hz, self.poles_zeta))


def roots_z(f_Hz: float, zeta: float) -> tuple[complex, complex]:
    """The pair of roots of 1 + 2 zeta s/w + s^2/w^2 at the device's tick, mapped as z = exp(s T): real ones, or one the
    conjugate of the other."""
    w = 2 * math.pi * f_Hz
    split = w * cmath.sqrt(zeta**2 - 1)
    return cmath.exp((-zeta * w + split) * TICK_S), cmath.exp((-zeta * w - split) * TICK_S)
