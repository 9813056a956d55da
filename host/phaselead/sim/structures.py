"""The parameters of the linked kernel, as its headers declare them."""

from __future__ import annotations

import ctypes

POLES, NUMBERS, PLAYS, DEADZONES, FADING, LINKS, SENSOR_LINKS, HUM_LINES, TOP_BITS = 48, 6, 192, 32, 16, 16, 4, 3, 8
"""Bounds of the kernel, as in link.h, linked.h and surroundings.h."""
POLES_SUM, SLEW, CLIP, OPERATOR, SOFTENING, BACKLASH, FRICTION, STIFFNESS, CROSSOVER = range(1, 10)
"""enum link_kind."""


class Link(ctypes.Structure):
    """struct link_parameters of link.h."""

    _fields_ = (
        ("kind", ctypes.c_uint32),
        ("poles", ctypes.c_uint32),
        ("number", ctypes.c_double * NUMBERS),
        ("pole_re", ctypes.c_double * POLES),
        ("pole_im", ctypes.c_double * POLES),
        ("weight_re", ctypes.c_double * POLES),
        ("weight_im", ctypes.c_double * POLES),
    )


class Operator(ctypes.Structure):
    """struct operator_parameters of link.h."""

    _fields_ = (
        ("gain_um_per_V", ctypes.c_double),
        ("play_r_V", ctypes.c_double * PLAYS),
        ("play_w_um_per_V", ctypes.c_double * PLAYS),
        ("play_start_V", ctypes.c_double * PLAYS),
        ("deadzone_d_V", ctypes.c_double * DEADZONES),
        ("deadzone_s_um_per_V", ctypes.c_double * DEADZONES),
        ("low_V", ctypes.c_double),
        ("high_V", ctypes.c_double),
        ("field_bend", ctypes.c_double),
        ("play_tilt", ctypes.c_double),
        ("play_taper", ctypes.c_double),
        ("bend_um", ctypes.c_double),
        ("skew_um", ctypes.c_double),
        ("skew_reach", ctypes.c_double),
        ("fading_r_V", ctypes.c_double * FADING),
        ("fading_w_um_per_V", ctypes.c_double * FADING),
        ("fading_start", ctypes.c_double),
        ("plays", ctypes.c_uint32),
        ("uneven", ctypes.c_uint32),
        ("deadzones", ctypes.c_uint32),
        ("fading", ctypes.c_uint32),
    )


class Surroundings(ctypes.Structure):
    """struct surroundings_parameters of surroundings.h."""

    _fields_ = (
        ("gain", ctypes.c_double),
        ("low_um", ctypes.c_double),
        ("high_um", ctypes.c_double),
        ("quadratic", ctypes.c_double),
        ("cubic", ctypes.c_double),
        ("quartic", ctypes.c_double),
        ("linear", ctypes.c_double),
        ("jitter_s", ctypes.c_double),
        ("lsb_um", ctypes.c_double),
        ("ramp_um_per_s", ctypes.c_double),
        ("rise_um", ctypes.c_double),
        ("rise_tau_s", ctypes.c_double),
        ("hum_Hz", ctypes.c_double),
        ("hum_sin_um", ctypes.c_double * HUM_LINES),
        ("hum_cos_um", ctypes.c_double * HUM_LINES),
        ("vibration_um_rms", ctypes.c_double),
        ("vibration_Hz", ctypes.c_double),
        ("vibration_width_Hz", ctypes.c_double),
        ("noise_um_rms", ctypes.c_double),
    )


class LinkedAxis(ctypes.Structure):
    """struct linked_axis_parameters of linked.h."""

    _fields_ = (
        ("dac_zero_code", ctypes.c_double),
        ("dac_V_per_code", ctypes.c_double),
        ("dac_bow_LSB", ctypes.c_double),
        ("dac_bit_LSB", ctypes.c_double * TOP_BITS),
        ("delay_s", ctypes.c_double),
        ("offset_um", ctypes.c_double),
        ("from_um_per_um", ctypes.c_double * 3),
        ("from_lag_s", ctypes.c_double),
        ("operator", Operator),
        ("surroundings", Surroundings),
        ("links", ctypes.c_uint32),
        ("sensor_links", ctypes.c_uint32),
        ("link", Link * LINKS),
        ("sensor_link", Link * SENSOR_LINKS),
    )


class LinkedParameters(ctypes.Structure):
    """struct linked_parameters of linked.h."""

    _fields_ = (
        ("tick_s", ctypes.c_double),
        ("coupling", ctypes.c_double * 3 * 3),
        ("seed", ctypes.c_uint64),
        ("axes", LinkedAxis * 3),
    )
