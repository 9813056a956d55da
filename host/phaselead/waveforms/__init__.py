"""Paths as a user writes them, and what the device plays of them."""

from __future__ import annotations

from phaselead.waveforms.as_sensed import RepeatedAsSensed
from phaselead.waveforms.catalogue import examples, kinds, parse_wave, parse_waves, scans, split_axes, ways
from phaselead.waveforms.curve import Curve
from phaselead.waveforms.file import of_points
from phaselead.waveforms.goto import PEAK_SPEED, SETTLE_S, Goto
from phaselead.waveforms.limits import refuse_out_of_range
from phaselead.waveforms.path import Repeated, Streamed, of_table
from phaselead.waveforms.replaced import Replaced, mean_twice
from phaselead.waveforms.rounded import Rounded
from phaselead.waveforms.sine import Sine
from phaselead.waveforms.triangle import Triangle
from phaselead.waveforms.waveform import JUDGED_PERIODS, POINTS, Periodic, Sampled, Waveform
from phaselead.waveforms.written import Written

__all__ = [
    "JUDGED_PERIODS",
    "PEAK_SPEED",
    "POINTS",
    "SETTLE_S",
    "Curve",
    "Goto",
    "Periodic",
    "Repeated",
    "RepeatedAsSensed",
    "Replaced",
    "Rounded",
    "Sampled",
    "Sine",
    "Streamed",
    "Triangle",
    "Waveform",
    "Written",
    "examples",
    "kinds",
    "mean_twice",
    "of_points",
    "of_table",
    "parse_wave",
    "parse_waves",
    "refuse_out_of_range",
    "scans",
    "split_axes",
    "ways",
]
