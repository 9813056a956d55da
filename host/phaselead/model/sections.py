"""Second-order sections that undo low-passes and modes, at the device's tick.

Poles and zeros go from the s- to the z-plane as z = exp(s T) (matched z-transform; Franklin, Powell and Workman 1998),
so that a mode and the section that undoes it sit at exactly the same place. What the sections delay, and what they
cannot undo, is known as a delay at low frequencies and left to the preview.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phaselead.errors import BadInput
from phaselead.record import Samples

Roots = NDArray[np.complex128]

TICK_S = 1 / 5000
LATCH_S = 30e-6
"""From the sample of a tick to the latch of its output, in every build of the firmware (docs/emulation.md)."""
HOLD_S = LATCH_S + TICK_S / 2
"""By how much a held, latched output is late of the straight lines between the rows of a recording, from which the time
view's delay counts."""
FASTER = 8.0
"""A lead's own pole lies this factor above the corner that it undoes, and amplifies the fastest part of a path by as
much."""
COEFFICIENTS = 32.0
"""The device's are below (firmware/core/biquad.h: q26 in 32 bits)."""
ROLL_OFF = (COEFFICIENTS / 2) ** 0.5
"""Times the mode's frequency: where a section that undoes a mode gives up. As late as the device can hold: the middle
coefficient of a mode far below the tick rate is twice the square of this."""
FOLLOWED = 3.0
"""Times the mode's frequency: zeros of the mechanics further away than that are not followed: the section would amplify
the fastest part of a path more than it helps."""
FLAT = 2**-0.5
"""Damping of the pair of poles where it gives up: a Butterworth low-pass, whose gain is the flattest below its corner
(Butterworth 1930). Two real poles there took 2.7 % of the gain at half the mode's frequency, this pair takes 0.04 %."""
LEAST_TAU_SHARE = 0.05
"""Of a tick: a shorter time constant is undone by looking ahead alone."""
NEAREST_UNSTABLE = 1.5
"""Of the highest mode's frequency: a zero in the right half-plane below that has no stable inverse, and is too slow
to be left to the roll-off."""
HIGHEST_Hz = 2250.0
"""Modes and zeros above are beyond what a section of this tick rate can undo; they are all preview."""


@dataclass(frozen=True)
class Section:
    """y = b0 x + b1 x' + b2 x'' - a1 y' - a2 y'', with a static gain of 1."""

    b: tuple[float, float, float]
    a: tuple[float, float]

    @property
    def delay_s(self) -> float:
        """At low frequencies; negative for a lead."""
        b, a = np.array(self.b), np.array((1.0, *self.a))
        n = np.arange(3)
        return float((n @ b) / b.sum() - (n @ a) / a.sum()) * TICK_S

    def response(self, f_Hz: Samples) -> NDArray[np.complex128]:
        """Complex gain (m,) at the frequencies (m,)."""
        z = np.exp(-2j * np.pi * np.asarray(f_Hz) * TICK_S)
        return np.asarray((self.b[0] + self.b[1] * z + self.b[2] * z**2) / (1 + self.a[0] * z + self.a[1] * z**2))


PASS = Section((1.0, 0.0, 0.0), (0.0, 0.0))


def section_of(zeros: Sequence[complex], poles: Sequence[complex]) -> Section:
    """From up to two zeros and two poles in the z-plane, real or conjugate."""
    b = np.real(np.poly(np.array(zeros, dtype=complex)))
    a = np.real(np.poly(np.array(poles, dtype=complex)))
    b, a = np.pad(b, (0, 3 - len(b))), np.pad(a, (0, 3 - len(a)))
    b = b * a.sum() / b.sum()
    return Section((float(b[0]), float(b[1]), float(b[2])), (float(a[1]), float(a[2])))


def lead(tau_s: float) -> Section | None:
    """(1 + s tau)/(1 + s tau/8), or None for a low-pass too fast to be undone."""
    if tau_s < LEAST_TAU_SHARE * TICK_S:
        return None
    return section_of([np.exp(-TICK_S / tau_s)], [np.exp(-FASTER * TICK_S / tau_s)])


@dataclass(frozen=True)
class Undone:
    """Sections, and the delay in s at low frequencies of what they undo and they together."""

    sections: tuple[Section, ...]
    delay_s: float


def undo_lowpass(tau_s: float) -> Undone:
    """1/(1 + s tau)."""
    section = lead(tau_s)
    return Undone((section,), tau_s + section.delay_s) if section else Undone((), tau_s)


def undo_modes(modes: Sequence[tuple[float, float, float]]) -> Undone:
    """1 - sum c + sum c w^2/(s^2 + 2 zeta w s + w^2) of (c, f_Hz, zeta).

    Raises:
        BadInput: it has a zero in the right half-plane that is not far above its modes: its inverse is not stable.
    """
    slow = sorted((mode for mode in modes if mode[0] != 0 and mode[1] < HIGHEST_Hz), key=lambda mode: mode[1])
    if not slow:
        return Undone((), 0.0)
    zeros, poles = _zeros(slow), _poles(slow)
    pairs = _pairs(_usable(zeros, slow))
    sections = []
    for i, (_, f_Hz, _) in enumerate(slow):
        corner_Hz = min(ROLL_OFF * f_Hz, 0.5 / TICK_S)
        fast = 2 * np.pi * corner_Hz * complex(-FLAT, (1 - FLAT**2) ** 0.5)
        near = i < len(pairs) and max(map(abs, pairs[i])) < FOLLOWED * 2 * np.pi * f_Hz
        given = pairs[i] if near else []
        # Where one zero is followed, one pole is left to be chosen, a real one.
        ends = {0: [fast, fast.conjugate()], 1: [*given, -abs(fast)], 2: given}[len(given)]
        mode = poles[2 * i : 2 * i + 2]
        sections.append(section_of(np.exp(mode * TICK_S).tolist(), [np.exp(s * TICK_S) for s in ends]))
    plant_s = float(np.real(np.sum(-1 / poles)) - np.real(np.sum(-1 / zeros)))
    return Undone(tuple(sections), plant_s + sum(section.delay_s for section in sections))


def _poles(modes: Sequence[tuple[float, float, float]]) -> Roots:
    """Two of each mode, rad/s."""
    return np.concatenate([np.roots([1.0, 4 * np.pi * f * z, (2 * np.pi * f) ** 2]) for _, f, z in modes])


def _zeros(modes: Sequence[tuple[float, float, float]]) -> Roots:
    """Of the sum of the modes and the rigid rest, rad/s; computed in units of the first mode."""
    unit = 2 * np.pi * modes[0][1]
    squares = [np.array([1.0, 4 * np.pi * f * z / unit, (2 * np.pi * f / unit) ** 2]) for _, f, z in modes]
    numerator = np.zeros(2 * len(modes) + 1)
    for i, (c, _, _) in enumerate(modes):
        others = np.array([1.0])
        for j, square in enumerate(squares):
            if j != i:
                others = np.polymul(others, square)
        term = c * squares[i][2] * others
        numerator[-len(term) :] += term
    rigid = np.array([1 - sum(c for c, _, _ in modes)])
    for square in squares:
        rigid = np.polymul(rigid, square)
    numerator[-len(rigid) :] += rigid
    numerator[np.abs(numerator) < 1e-9 * np.abs(numerator).max()] = 0.0
    return np.asarray(np.roots(numerator) * unit, dtype=complex)


def _usable(zeros: Roots, modes: Sequence[tuple[float, float, float]]) -> Roots:
    """Those that can be poles of the inverse; others far enough away are left to the roll-off."""
    highest = 2 * np.pi * max(f for _, f, _ in modes)
    wrong = zeros[np.real(zeros) >= 0]
    if len(wrong) and np.abs(wrong).min() < NEAREST_UNSTABLE * highest:
        raise BadInput(
            f"its mechanics have a zero in the right half-plane at {np.abs(wrong).min() / (2 * np.pi):.4g} Hz: what "
            "undoes them is not stable"
        )
    return zeros[(np.real(zeros) < 0) & (np.abs(zeros) < 2 * np.pi * HIGHEST_Hz)]


def _pairs(roots: Roots) -> list[list[complex]]:
    """Conjugate pairs, and real ones two by two, rising; the last may be alone."""
    upper = [[complex(s), complex(s).conjugate()] for s in roots if s.imag > 1e-9 * abs(s)]
    real = sorted((complex(s.real) for s in roots if abs(s.imag) <= 1e-9 * abs(s)), key=abs)
    two_by_two = [real[i : i + 2] for i in range(0, len(real), 2)]
    return sorted([*upper, *two_by_two], key=lambda pair: abs(pair[0]))
