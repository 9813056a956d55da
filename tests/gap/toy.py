"""Toy records, drawn from the model of the likelihood itself, of effects that are linear in their sizes."""

from __future__ import annotations

from types import SimpleNamespace as Made

import numpy as np
from scipy.fft import idct

from phaselead.gap.posterior.blocks import BlockedRun
from phaselead.gap.posterior.likelihood import Likelihood
from phaselead.gap.posterior.noise_and_base_share import NoiseAndBaseShare
from phaselead.model.effects import effect

STEP_S, ROWS = 1e-3, 256
NOISE_UM2, BASE_SHARE = 0.01, 0.01
GAIN, LATE, SLOW = effect("gain_change"), effect("delay"), effect("sensor_lowpass")
EFFECTS = (GAIN, LATE, SLOW)
ROLES = ("reference", "train", "train", "holdout")


def sized(amount, of=GAIN):
    """An effect of this many typical sizes."""
    (p,) = of.parameters
    return (of, {p.name: amount * p.typical})


def amount_of(fit, place=0):
    of, params = fit.entries[place]
    (p,) = of.parameters
    return params[p.name] / p.typical


class LinearRun:
    """A run whose model moves by ``motion`` (n,), and an effect by a column (n,) of its own times its size."""

    def __init__(self, motion, columns, role):
        n = len(motion)
        self.motion, self.columns, self.axis = motion, columns, Made(effects=())
        t_s = STEP_S * np.arange(n)
        self.run = Made(role=role, rows=slice(0, n), start=0, stop=n, step_s=STEP_S, t_s=t_s, x_um=motion, idle=False)
        self.nuisances = np.ones((n, 1))

    def answer(self, entries=()):
        added = [self.columns[of.name] * params[p.name] / p.typical for of, params in entries for p in of.parameters]
        return self.motion + sum(added, np.zeros(len(self.motion)))

    def error(self, entries=()):
        return self.run.x_um - self.answer(entries)


class Toy:
    """Records drawn from the model: effects of some amounts, a ``share`` of them that their equations miss, ``times``
    as much as expected that the base misses, noise, which alone says something new in each coefficient of an octave.
    ``fault``: amounts of effects that the base lacks in all records.

    What is missed looks like the gain in every octave, or at random, as ``like_effect`` says; ``in_all``: with the same
    sign and share in all records."""

    def __init__(
        self, seed, amounts=(), share=0.0, times=1.0, told=1e4, roles=ROLES, fault=(), like_effect=False, rows=ROWS,
        in_all=False,
    ):  # fmt: skip
        rng = np.random.default_rng(seed)
        self.common = rng.standard_t(told, size=rows) if in_all else None
        found = []
        for role in roles:
            motion = 3 * np.cumsum(rng.normal(size=rows))
            columns = {one.name: np.cumsum(rng.normal(size=rows)) for one in EFFECTS}
            found.append(BlockedRun(LinearRun(motion, columns, role), 0.1))
        octaves = found[0].octaves
        count = int(octaves[-1] - octaves[0]) + 1
        noise, base = np.full(count, NOISE_UM2), np.full(count, BASE_SHARE**2)
        none = tuple(np.zeros((run.rows - 1, 0)) for run in found)
        of_both = np.full(count, told)
        self.expected = NoiseAndBaseShare(int(octaves[0]), noise, base, of_both, of_both, np.ones(count))
        for run in found:
            self._measure(run, rng, amounts, share, times, fault, like_effect)
        self.likelihood = Likelihood(tuple(found), self.expected, none)

    def _measure(self, run, rng, amounts, share, times, fault, like_effect):
        modelled = run.modelled
        acting = [*fault, *(amounts if run.changed else ())]
        v = NOISE_UM2 + times**2 * BASE_SHARE**2 * run.spread(run.power(modelled.motion))
        for one in amounts if run.changed else ():
            v = v + share**2 * run.spread(run.power(modelled.answer([one]) - modelled.motion))
        *_, told = self.expected.of(run, run.spread(run.power(modelled.motion)))
        like = run.coefficients(modelled.columns[GAIN.name][:, None])[:, 0]
        shape = like if like_effect else rng.normal(size=len(like))
        alike = shape / np.repeat(np.sqrt(run.products(shape[:, None], shape[:, None])[:, 0, 0]), run.sizes)
        scale = np.sqrt(told / rng.chisquare(told, size=len(v)))
        once = scale * rng.normal(size=len(v)) if self.common is None else self.common[: len(v)]
        noise = np.repeat(scale * np.sqrt(NOISE_UM2), run.sizes) * rng.normal(size=len(like))
        drawn = noise + np.repeat(np.sqrt(v - NOISE_UM2) * once, run.sizes) * alike
        modelled.run.x_um = modelled.answer(acting)
        modelled.run.x_um[run.skipped :] += idct(np.append(0.0, drawn), norm="ortho")

    def log_odds(self, entries, against=(), beside=None):
        among = beside or self.likelihood
        return among.fit(entries).log_evidence - among.fit(against).log_evidence
