"""Second-order filters behind the PID, as a stage file has them: a pair of zeros over a pair of poles."""

from __future__ import annotations

from typing import Annotated

import numpy as np
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
        zeros = _roots_z(self.zeros_Hz, self.zeros_zeta) if self.zeros_Hz else [0j]
        return section_of(zeros, _roots_z(self.poles_Hz, self.poles_zeta))


def _roots_z(f_Hz: float, zeta: float) -> list[complex]:
    w = 2 * np.pi * f_Hz
    split = w * np.emath.sqrt(zeta**2 - 1)
    return [complex(np.exp((-zeta * w + sign * split) * TICK_S)) for sign in (1, -1)]
