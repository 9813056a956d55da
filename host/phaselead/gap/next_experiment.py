"""The excitation that would best tell the members of a tie apart, or the sensor that is needed.

T-optimal design (Atkinson and Fedorov 1975): for each excitation, the whitened squared distance between what one
member would show and the nearest that another could, after its parameters and the base's moved as far as the records
at hand let them. The excitation with the largest least distance per second wins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from phaselead.gap.acceptance import Named
from phaselead.gap.comparison import TIE, Rival
from phaselead.gap.excitation import LONGEST_S, Excitation, LENGTHS_s, excitations, span_V
from phaselead.gap.metric import metric_of
from phaselead.gap.noise import Noise
from phaselead.gap.records import Run
from phaselead.gap.refit import fresh_columns
from phaselead.gap.regressors import base_columns
from phaselead.gap.residual import ModelledRun, modelled_run
from phaselead.gap.result import NextExperiment
from phaselead.gap.search import Growth
from phaselead.model import Effect, Place
from phaselead.record import Samples

ROWS = 10_000
"""Of one prediction; longer excitations are predicted at a coarser step."""
MOST_MEMBERS = 4
"""Of a tie that are told apart at once, the best first."""
SENSOR_ROOM = 0.02
"""Of the sensor's span, kept free at either end."""
GROUND_SLACK = 0.02
"""Of the fitted voltages, by which a drive may leave them."""
APPROACH_s = 0.1
"""At its start, in which the output goes to the first voltage: a jump that the waveform is not chosen for."""
NEAR = 10.0
"""Times the distance that breaks a tie, of points: rivals so little behind are told apart as well."""
PLENTY = 30.0
"""Times that distance, beyond which more is of no use and a shorter experiment is better."""
SURE = 2.0
"""Times the distance that breaks a tie: asked of the prediction, which knows neither the truth nor its own misfit."""
SENSORS = {
    Place.AMPLIFIER: "a voltage monitor at the amplifier's output",
    Place.MECHANICS: "a second, faster position sensor (an interferometer)",
    Place.SENSOR: "a second position sensor of another kind",
    Place.ENVIRONMENT: "a temperature sensor and an accelerometer beside the stage",
}


@dataclass(frozen=True)
class Member:
    """One member of a tie, and what the records at hand say about its parameters and the base's."""

    rival: Rival
    known: Samples
    """Information (k, k) about the base's columns, then the tangents of all effects; units as in the refit."""


def propose(growth: Growth, tied: Named, label: str | None) -> NextExperiment | None:
    """The best experiment for one tie; None when it has no members to tell apart or no model to predict with."""
    rivals = [r for r in tied.rivals if r.effect.name in tied.tied]
    if len(rivals) < 2 or growth.problem.axis.time is None:
        return None
    rivals += [r for r in tied.rivals if r.effect.name not in tied.tied and _near(r, rivals)]
    members = [Member(r, _known(growth, r)) for r in rivals[:MOST_MEMBERS]]
    step_s = growth.problem.train_runs()[0].run.step_s
    tried = [
        (option, _separation(growth, option, members, step_s)) for option in excitations(growth.problem.axis, step_s)
    ]
    if not tried:
        return None
    option, apart = _long_enough(*max(tried, key=lambda one: _worth(*one)))
    sensor = None if apart >= TIE else sensor_for([r.effect for r in rivals if r.effect.name in tied.tied])
    return NextExperiment(
        option.waveform, option.level_V, option.band_Hz, option.bias_V, label, option.seconds, apart, sensor
    )


def _near(rival: Rival, tied: Sequence[Rival]) -> bool:
    """Whether it is not in the tie but could win it: little behind, and known to look like a member."""
    behind = tied[0].score - rival.score
    return behind < NEAR * TIE and any(rival.effect.name in r.effect.confused_with for r in tied)


def _worth(option: Excitation, apart: float) -> tuple[float, float]:
    """Distance per second, as far as it is of use."""
    return min(apart, PLENTY * TIE) / option.seconds, apart


def _long_enough(option: Excitation, apart: float) -> tuple[Excitation, float]:
    """Repeated until the prediction is sure, at most LONGEST_S; a single period where that is enough."""
    for seconds in LENGTHS_s:
        if seconds >= option.seconds and apart / option.seconds * seconds >= SURE * TIE:
            return replace(option, seconds=seconds), apart / option.seconds * seconds
    longest = max(LONGEST_S, option.seconds)
    return replace(option, seconds=longest), apart / option.seconds * longest


def _known(growth: Growth, rival: Rival) -> Samples:
    """From the moments of its refit and what is known of the base; weights only, no directions of the residual."""
    total = rival.fitted.total
    correction, k = growth.problem.discrepancy, len(growth.problem.layout.common())
    assert total is not None
    size = len(total) - 1
    if size != k + rival.fitted.n_tangents:  # the base was given an operator since
        return np.eye(growth.problem.layout.n_base + rival.fitted.n_tangents)
    inner = total[:size, :size] / growth.inflation
    inner[np.ix_(correction.index, correction.index)] += correction.precision
    base = np.arange(k - growth.problem.layout.n_base, k)
    kept = np.concatenate([base, np.arange(k, size)])
    return _marginal(inner, kept)


def _marginal(information: Samples, kept: Samples) -> Samples:
    """Information about ``kept`` after the others were fitted (Schur complement)."""
    others = np.setdiff1d(np.arange(len(information)), kept)
    inner = information[np.ix_(others, others)]
    inner = inner + 1e-9 * (np.trace(inner) / max(len(inner), 1) + 1e-300) * np.eye(len(inner))
    cross = information[np.ix_(others, kept)]
    return np.asarray(information[np.ix_(kept, kept)] - cross.T @ np.linalg.solve(inner, cross))


def _separation(growth: Growth, option: Excitation, members: Sequence[Member], step_s: float) -> float:
    """Predicted least squared distance between two members, after the later one was fitted to what the other shows."""
    every = max(1, int(np.ceil(option.seconds / step_s / ROWS)))
    n = int(option.seconds / (every * step_s))
    t = np.asarray(np.arange(n) * step_s * every, dtype=np.float64)
    start = 0 if option.idle else min(round(APPROACH_s / (every * step_s)), n // 2)
    run = Run("x", "train", t, option.voltage(t), np.zeros(n), None, start, n, "proposed", "", {}, {})
    made = modelled_run(growth.problem.axis, run)
    shown = [made.answer(m.rival.fitted.entries) for m in members]
    if not _in_sight(growth, shown) or not _known_ground(growth, made, members):
        return 0.0
    metric = metric_of([made], coarser(growth.problem.noise, every))
    base = metric.project(0, base_columns(made, growth.problem.freedom, members[0].rival.fitted.entries))
    answers = [metric.project(0, answer[:, None])[:, 0] for answer in shown]
    least = np.inf
    for j, member in enumerate(members[1:], 1):
        fitted = member.rival.fitted
        tangents = metric.project(0, fresh_columns(made, fitted.entries, fitted.free)[:, :-1])
        columns = np.concatenate([base, tangents], axis=1)
        normal = columns.T @ columns / growth.inflation + member.known
        normal += 1e-9 * np.diag(np.diag(normal)) + 1e-12 * np.eye(len(normal))
        for answer in answers[:j]:
            apart = answer - answers[j]
            right = columns.T @ apart / growth.inflation
            left = apart @ apart / growth.inflation - right @ np.linalg.solve(normal, right)
            least = min(least, float(left))
    return max(least, 0.0)


def _in_sight(growth: Growth, answers: Sequence[Samples]) -> bool:
    """Whether the sensor would see all of it, with some room for what is not known yet; where it has been, it can."""
    sensor, been = growth.problem.axis.sensor, [t.run.x_um for t in growth.problem.train_runs()]
    room = SENSOR_ROOM * (sensor.x_max_um - sensor.x_min_um)
    low = min(sensor.x_min_um + room, *(float(x.min()) for x in been))
    high = max(sensor.x_max_um - room, *(float(x.max()) for x in been))
    return all(float(a.min()) >= low and float(a.max()) <= high for a in answers)


def _known_ground(growth: Growth, made: ModelledRun, members: Sequence[Member]) -> bool:
    """Whether no member drives the hysteresis where the base was never fitted: leakage takes it below a low voltage."""
    low, high = span_V(growth.problem.axis)
    slack = GROUND_SLACK * (high - low)
    drives = [made.chain.signal_at(Place.AMPLIFIER, m.rival.fitted.entries).value for m in members]
    return all(float(v.min()) >= low - slack and float(v.max()) <= high + slack for v in drives)


def coarser(noise: Noise, every: int) -> Noise:
    """The noise of means over ``every`` rows, for signals that change little within them."""
    if every == 1:
        return noise
    slow_um = noise.sigma_um / abs(float(np.sum(noise.sensor)))
    return replace(
        noise,
        sensor=np.ones(1),
        sigma_um=slow_um / float(np.sqrt(every)),
        rest=np.array([abs(float(np.sum(noise.rest)))]),
    )


def sensor_for(effects: Sequence[Effect]) -> str:
    """A sensor between the places where the members act."""
    first, last = min(e.place for e in effects), max(e.place for e in effects)
    return next((words for place, words in SENSORS.items() if first <= place <= last), SENSORS[Place.SENSOR])
