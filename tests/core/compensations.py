"""Models for the inverse modes: drawn at random, all of a kind that a device accepts, and their exact mathematics."""

import itertools

import numpy as np
from core_bindings import Biquad, Compensation, CompensationState, Creep, Inverse, LoopFilterConfig, whole
from hypothesis import strategies as st

V, UM = 2**24, 2**16
ONE_Q26, ONE_Q64 = 1 << 26, 1 << 64
UNUSED = 2**31 - 1
PASS = Biquad(ONE_Q26)


def biquad_of(b, a):
    """The section of real b (3,) and a (2,), its static gain exactly 1."""
    b0, b2, a1, a2 = (round(v * ONE_Q26) for v in (b[0], b[2], a[0], a[1]))
    return Biquad(b0, ONE_Q26 + a1 + a2 - b0 - b2, b2, a1, a2)


def coefficients_b(section):
    return section.b0_q26, section.b1_q26, section.b2_q26


@st.composite
def _sections(draw):
    """Two poles and two zeros anywhere within the unit circle."""
    radius, angle = draw(st.floats(0, 0.99)), draw(st.floats(0, np.pi))
    r0, angle0 = draw(st.floats(0, 0.9)), draw(st.floats(0.3, np.pi))
    a = np.array([-2 * radius * np.cos(angle), radius**2])
    zeros = np.array([1, -2 * r0 * np.cos(angle0), r0**2])
    b = zeros / zeros.sum() * (1 + a.sum())
    return biquad_of(b, a)


sections = _sections().filter(lambda section: sum(coefficients_b(section)) == ONE_Q26 + section.a1_q26 + section.a2_q26)
"""Those whose coefficients fit: ctypes would wrap the others."""
loop_sections = sections.filter(lambda section: max(map(abs, coefficients_b(section))) < 16 * ONE_Q26)
any_filter = st.builds(
    lambda in_use, one, other: LoopFilterConfig(in_use, (Biquad * 2)(one, other)),
    st.integers(0, 3),
    loop_sections,
    loop_sections,
)
creeps = st.builds(
    lambda alphas, ks: Creep(tuple(alphas), tuple(ks)),
    st.lists(whole(0, ONE_Q64 // 4), min_size=8, max_size=8),
    st.lists(whole(-(2**26), 2**26), min_size=8, max_size=8),
)


def creep_made(creep):
    """As creep_make() leaves it."""
    creep.in_use = any(creep.k_q30)
    creep.alpha_q64 = tuple(alpha if k else 0 for alpha, k in zip(creep.alpha_q64, creep.k_q30, strict=True))
    return creep


def weights(config):
    """Of the plays, from what the first ones move together."""
    sums = [play.sum_q20 for play in config.play]
    return [b - a for a, b in itertools.pairwise(sums)]


def at_rest_q24(rest_q30, r_q24):
    return (rest_q30 * r_q24 + 2**29) >> 30


def inverse_of(plays=(), knots=(), *, gain_q20=10 << 20, offset_q16=0, rest_q30=0, limits=(-2 * V, 10 * V)):
    """The operator of (r_q24, w_q20) and (d_q24, s_q20), each rising, as inverse_make() leaves it when it exists."""
    at_rest = [(w, at_rest_q24(rest_q30, r)) for r, w in plays]
    x_q44 = (offset_q16 << 28) + sum(w * p for w, p in at_rest) - sum(s * d for d, s in knots if d < 0)
    below = [s for d, s in knots if d <= 0]
    rest = x_q44, gain_q20 + sum(below), len(below)
    made = Inverse(*rest, *limits, gain_q20, offset_q16, rest_q30, len(plays), len(knots))
    for i in range(32):
        r_q24, w_q20 = plays[i] if i < len(plays) else (UNUSED, 0)
        made.play[i] = (r_q24, made.play[i].sum_q20, at_rest_q24(rest_q30, r_q24))
        made.play[i + 1].sum_q20 = made.play[i].sum_q20 + w_q20
    made.play[32].r_q24 = UNUSED
    for j in range(24):
        made.knot_d_q24[j], made.knot_s_q20[j] = knots[j] if j < len(knots) else (UNUSED, 0)
    return made


@st.composite
def _inverses(draw):
    """Plays of any weights, knots whose slopes never let the line fall."""
    r = sorted(draw(st.lists(whole(0, 6 * V), max_size=32)))
    d = sorted(draw(st.lists(whole(-3 * V, 11 * V), max_size=24)))
    gain = slope = draw(whole(1 << 10, 40 << 20))
    knots = []
    for at in d:
        bend = draw(whole((1 << 10) - slope, 5 << 20))
        slope += bend
        knots.append((at, bend))
    plays = [(at, draw(whole(0, 5 << 20))) for at in r]
    offset, rest = draw(whole(-(2**24), 2**24)), draw(whole(-(2**30), 2**30))
    return inverse_of(plays, knots, gain_q20=gain, offset_q16=offset, rest_q30=rest)


inverses = _inverses()


def compensation_of(preview_ticks_q16, rest_q16, shape, drive, creep, inverse):
    """As compensation_make() leaves it, but for any position at rest."""
    changing = [bool(s.b1_q26 or s.b2_q26 or s.a1_q26 or s.a2_q26) for s in (*shape, drive)]
    in_use = sum(changes << i for i, changes in enumerate(changing))
    known = preview_ticks_q16, rest_q16, rest_q16 << 24, in_use, 0
    return Compensation(*known, (Biquad * 6)(*shape), drive, creep_made(creep), inverse)


any_compensation = st.builds(
    compensation_of,
    whole(0, 1024 << 16),
    whole(-(2**24), 2**24),
    st.lists(st.one_of(st.just(PASS), sections), min_size=6, max_size=6),
    st.one_of(st.just(PASS), sections),
    creeps,
    inverses,
)


def memory_of(core, compensation, u_q24=0):
    """The memory of a stage at rest that went to u."""
    state = CompensationState()
    core.compensation_rest(compensation, state, u_q24)
    return state


class Operator:
    """The time view in unbounded integers, q44, with its own memory: only max and min."""

    def __init__(self, config):
        self.config, self.weights = config, weights(config)
        self.thresholds = [play.r_q24 for play in config.play[:32]]
        self.plays = [at_rest_q24(config.rest_fraction_q30, r) for r in self.thresholds]
        self.go(0)

    def go(self, v_q24):
        """Position after the voltage has gone straight to v."""
        c = self.config
        self.plays = [max(v_q24 - r, min(v_q24 + r, p)) for r, p in zip(self.thresholds, self.plays, strict=True)]
        x = (c.offset_q16 << 28) + c.gain_q20 * v_q24
        x += sum(w * p for w, p in zip(self.weights, self.plays, strict=True))
        return x + sum(s * max(v_q24 - d, 0) for d, s in zip(c.knot_d_q24, c.knot_s_q20, strict=True))

    def slopes(self):
        """No two positions one LSB apart differ by more."""
        c = self.config
        return abs(c.gain_q20) + sum(self.weights) + sum(abs(s) for s in c.knot_s_q20)
