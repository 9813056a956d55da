"""Paths as a user writes them, and what the device plays of them."""

from __future__ import annotations

from phaselead.waveforms.waveform import POINTS, Waveform, parse_wave, parse_waves, refuse_out_of_range, steepest

__all__ = [
    "POINTS",
    "Waveform",
    "parse_wave",
    "parse_waves",
    "refuse_out_of_range",
    "steepest",
]
