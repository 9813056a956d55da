"""The experiment that would best tell the members of a tie apart, or the sensor that it takes.

T-optimal design (Atkinson and Fedorov 1975). For each excitation the response is predicted under every member of the
tie; another member is then fitted to it, with parameters that may move as far as the present records allow. What is
left is the separation: a squared distance in standard deviations. The excitation whose smallest separation per second
is largest wins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from phaselead.gap.design.excitation import Excitation, LENGTHS_s, LONGEST_PROPOSED_s, excitations, span_V
from phaselead.gap.findings import NextExperiment
from phaselead.gap.metric import metric_of
from phaselead.gap.noise import Noise
from phaselead.gap.posterior import Claim
from phaselead.gap.records import GapRun
from phaselead.gap.refit import Fitted, SizedEffect, fresh_columns, squares_left, with_total
from phaselead.gap.regressors import base_columns
from phaselead.gap.residual import ModelledRun, modelled_run
from phaselead.gap.selection import Selection
from phaselead.model import Effect, Place
from phaselead.record import Samples

TIE = 37.0
"""Squared whitened distance below which two effects, each at its best, cannot be told apart: errors of 1 in 1000."""
MOST_PREDICTED_ROWS = 10_000
"""Of one prediction; longer excitations are predicted at a coarser step."""
MOST_MEMBERS = 4
"""Members of a tie that are told apart at once, the best first."""
SENSOR_ROOM = 0.02
"""Share of the sensor's span that is kept free at either end."""
VOLTAGE_SLACK = 0.02
"""Share of the span of the fitted voltages by which a drive may leave it."""
APPROACH_s = 0.1
"""At the start, not counted: the output jumps to its first voltage, which the waveform is not chosen for."""
ENOUGH_SEPARATION = 30.0
"""In the same units: more separation is of no use, a shorter experiment is better."""
SEPARATION_MARGIN = 2.0
"""In the same units: what a prediction must reach, since it knows neither the truth nor its own misfit."""
SENSORS = {
    Place.AMPLIFIER: "a voltage monitor at the amplifier's output",
    Place.MECHANICS: "a second, faster position sensor (an interferometer)",
    Place.SENSOR: "a second position sensor of another kind",
    Place.ENVIRONMENT: "a temperature sensor and an accelerometer beside the stage",
}
"""By place in the chain: the sensor that would tell effects before it from effects after it."""


@dataclass(frozen=True)
class Member:
    """One member of a tie, and what the present records say about its parameters and those of the base."""

    fitted: Fitted
    """The set that has it, with the sum of its moments."""
    known: Samples
    """Information matrix (k, k): the base's columns, then the parameters of all effects, in the units of the refit."""


def propose(selection: Selection, tied: Claim, label: str | None) -> NextExperiment | None:
    """The best experiment for one tie on the axis ``label``; None where fewer than two members can be predicted."""
    if len(tied.rivals) < 2 or selection.problem.axis.time is None:
        return None
    members = [_member(selection, entries) for entries in tied.rivals[:MOST_MEMBERS]]
    step_s = selection.problem.train_runs()[0].run.step_s
    tried = [
        (option, _separation(selection, option, members, step_s))
        for option in excitations(selection.problem.axis, step_s)
    ]
    if not tried:
        return None
    option, apart = _long_enough(*max(tried, key=lambda one: _worth(*one)))
    sensor = None if apart >= TIE else sensor_for([entries[-1][0] for entries in tied.rivals])
    return NextExperiment(
        option.waveform, option.level_V, option.band_Hz, option.bias_V, label, option.seconds, apart, sensor
    )


def _member(selection: Selection, entries: tuple[SizedEffect, ...]) -> Member:
    """A member of a tie from the set that has it."""
    problem = selection.problem
    fitted = Fitted(entries, squares_left(problem.train_common, problem.discrepancy, entries))
    fitted = with_total(problem.train_common, fitted)
    return Member(fitted, _known(selection, fitted))


def _worth(option: Excitation, apart: float) -> tuple[float, float]:
    """What excitations are ranked by: separation per second, counted up to ENOUGH_SEPARATION; then separation."""
    return min(apart, ENOUGH_SEPARATION * TIE) / option.seconds, apart


def _long_enough(option: Excitation, apart: float) -> tuple[Excitation, float]:
    """The excitation repeated until the separation suffices, LONGEST_PROPOSED_s at most, and its separation then."""
    for seconds in LENGTHS_s:
        if seconds >= option.seconds and apart / option.seconds * seconds >= SEPARATION_MARGIN * TIE:
            return replace(option, seconds=seconds), apart / option.seconds * seconds
    longest = max(LONGEST_PROPOSED_s, option.seconds)
    return replace(option, seconds=longest), apart / option.seconds * longest


def _known(selection: Selection, fitted: Fitted) -> Samples:
    """Information matrix of a member's columns, from the moments of its refit and what is known of the base."""
    total = fitted.total
    correction, k = selection.problem.discrepancy, len(selection.problem.layout.common())
    assert total is not None
    size = len(total) - 1
    if size != k + fitted.n_tangents:  # the base was given an operator since
        return np.eye(selection.problem.layout.n_base + fitted.n_tangents)
    inner = total[:size, :size]
    inner[np.ix_(correction.index, correction.index)] += correction.precision
    base = np.arange(k - selection.problem.layout.n_base, k)
    kept = np.concatenate([base, np.arange(k, size)])
    return _marginal(inner, kept)


def _marginal(information: Samples, kept: Samples) -> Samples:
    """Information about the columns ``kept`` after the others were fitted (Schur complement)."""
    others = np.setdiff1d(np.arange(len(information)), kept)
    inner = information[np.ix_(others, others)]
    inner = inner + 1e-9 * (np.trace(inner) / max(len(inner), 1) + 1e-300) * np.eye(len(inner))
    cross = information[np.ix_(others, kept)]
    return np.asarray(information[np.ix_(kept, kept)] - cross.T @ np.linalg.solve(inner, cross))


def _separation(selection: Selection, option: Excitation, members: Sequence[Member], step_s: float) -> float:
    """Smallest squared distance between two members, after one was fitted to what the other shows.

    0 where the sensor would not see the motion, or the model was never fitted at such voltages.
    """
    every = max(1, int(np.ceil(option.seconds / step_s / MOST_PREDICTED_ROWS)))
    n = int(option.seconds / (every * step_s))
    t = np.asarray(np.arange(n) * step_s * every, dtype=np.float64)
    start = 0 if option.idle else min(round(APPROACH_s / (every * step_s)), n // 2)
    run = GapRun("x", "train", t, option.voltage(t), np.zeros(n), None, start, n, "proposed", "", {}, {})
    made = modelled_run(selection.problem.axis, run)
    shown = [made.answer(m.fitted.entries) for m in members]
    if not _within_sensor(selection, shown) or not _within_fitted_voltages(selection, made, members):
        return 0.0
    metric = metric_of([made], coarser(selection.problem.noise, every))
    base = metric.project(0, base_columns(made, selection.problem.freedom, members[0].fitted.entries))
    answers = [metric.project(0, answer[:, None])[:, 0] for answer in shown]
    least = np.inf
    for j, member in enumerate(members[1:], 1):
        fitted = member.fitted
        tangents = metric.project(0, fresh_columns(made, fitted.entries, fitted.free)[:, :-1])
        columns = np.concatenate([base, tangents], axis=1)
        normal = columns.T @ columns + member.known
        normal += 1e-9 * np.diag(np.diag(normal)) + 1e-12 * np.eye(len(normal))
        for answer in answers[:j]:
            apart = answer - answers[j]
            right = columns.T @ apart
            left = apart @ apart - right @ np.linalg.solve(normal, right)
            least = min(least, float(left))
    return max(least, 0.0)


def _within_sensor(selection: Selection, answers: Sequence[Samples]) -> bool:
    """Whether the sensor sees all of the motion, with some room to spare; positions it has seen before always count."""
    sensor, been = selection.problem.axis.sensor, [t.run.x_um for t in selection.problem.train_runs()]
    room = SENSOR_ROOM * (sensor.x_max_um - sensor.x_min_um)
    low = min(sensor.x_min_um + room, *(float(x.min()) for x in been))
    high = max(sensor.x_max_um - room, *(float(x.max()) for x in been))
    return all(float(a.min()) >= low and float(a.max()) <= high for a in answers)


def _within_fitted_voltages(selection: Selection, made: ModelledRun, members: Sequence[Member]) -> bool:
    """Whether every member keeps the hysteresis at voltages the base was fitted on; leakage may take it below them."""
    low, high = span_V(selection.problem.axis)
    slack = VOLTAGE_SLACK * (high - low)
    drives = [made.chain.signal_at(Place.AMPLIFIER, m.fitted.entries).value for m in members]
    return all(float(v.min()) >= low - slack and float(v.max()) <= high + slack for v in drives)


def coarser(noise: Noise, every: int) -> Noise:
    """The noise of means over ``every`` rows, for signals that change little over so many."""
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
    """A sensor, in words, between the places of the chain where the members act."""
    first, last = min(e.place for e in effects), max(e.place for e in effects)
    return next((words for place, words in SENSORS.items() if first <= place <= last), SENSORS[Place.SENSOR])
