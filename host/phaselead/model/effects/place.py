"""Where an effect acts."""

from __future__ import annotations

from enum import IntEnum


class Place(IntEnum):
    """Where in the physical chain an effect acts. Volts up to AMPLIFIER, micrometres from HYSTERESIS on."""

    CONVERTER = 0
    TIMING = 1
    AMPLIFIER = 2
    HYSTERESIS = 3
    CREEP = 4
    MECHANICS = 5
    COUPLING = 6
    SENSOR = 7
    ENVIRONMENT = 8


MODES_FROM = (Place.MECHANICS, 1)
"""Place and order from which on effects belong to the moving structure; what comes before is the actuator's own."""
