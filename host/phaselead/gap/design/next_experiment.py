"""The experiment that would best tell the members of a tie apart, or the sensor that it takes.

For each excitation the answers of every two members are predicted in the space in which they were compared, with all
that the base and their equations may miss (``Forecast``). Half a squared distance is the log odds that the record is
expected to bring for the true member, and the distance their deviation. From these follows the chance that the odds
pass what a name needs, each member being true as probably as the records so far say. An experiment with a chance of
nineteen in twenty is good, and the shortest good one wins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import softmax
from scipy.stats import multivariate_normal, norm

from phaselead.gap.design.excitation import Excitation, LENGTHS_s, excitations, repeats, span_V
from phaselead.gap.error_rates import INSIDE, SURE
from phaselead.gap.findings import NextExperiment
from phaselead.gap.parameters import SizedEffect
from phaselead.gap.posterior import MORE_LIKELY_THAN_NOT, Claim, Forecast, names_of
from phaselead.gap.records import GapRun
from phaselead.gap.residual import ModelledRun, run_from_rest
from phaselead.gap.selection import Selection
from phaselead.model import Effect, Place
from phaselead.record import Samples

LEAST_ODDS = 1e-12
"""Log odds that are as good as none."""
PRECISION = 1e-3
"""Of a chance."""
MOST_PREDICTED = 16
"""Excitations that are predicted with everything that may be missed: what the time for an answer allows."""
LENGTHENED = 3
"""Excitations that are predicted for longer where none is good, those with most log odds a second."""
SENSOR_ROOM = 0.02
"""Share of the sensor's span that is kept free at either end."""
VOLTAGE_SLACK = 0.02
"""Share of the span of the fitted voltages by which a drive may leave it."""
APPROACH_s = 0.1
"""At the start, not counted: the output jumps to its first voltage, which the waveform is not chosen for."""
SENSORS = {
    Place.AMPLIFIER: "a voltage monitor at the amplifier's output",
    Place.MECHANICS: "a second, faster position sensor (an interferometer)",
    Place.SENSOR: "a second position sensor of another kind",
    Place.ENVIRONMENT: "a temperature sensor and an accelerometer beside the stage",
}
"""By place in the chain: the sensor that would tell effects before it from effects after it."""

Sets = Sequence[tuple[SizedEffect, ...]]
"""For each member of a tie the set that has it."""


@dataclass(frozen=True)
class Prediction:
    """What one excitation is expected to bring."""

    excitation: Excitation
    log_odds: float
    """The least between two members."""
    chance: float
    """Probability that it has the true member named."""

    @property
    def good(self) -> bool:
        """Whether it is expected to break the tie."""
        return self.chance >= INSIDE


def propose(selection: Selection, tied: Claim) -> NextExperiment | None:
    """The best experiment for a tie of two members or more that were fitted; None where there is none to try."""
    found = _best(_Predicted(selection, tied.rivals))
    if found is None:
        return None
    one, members = found.excitation, [entries[-1][0] for entries in tied.rivals]
    sensor = sensor_for(members) if found.chance <= MORE_LIKELY_THAN_NOT else None
    return NextExperiment(
        waveform=one.waveform,
        level=one.level_V,
        band=one.band_Hz,
        bias=one.bias_V,
        seconds=one.seconds,
        separation=found.log_odds,
        chance=found.chance,
        needs_sensor=sensor,
        source=one.source,
        points=one.points,
        tells_apart=tuple(member.name for member in members),
        drives=selection.contest.likelihood.runs[0].modelled.run.axis,
    )


def passes(log_odds: Samples | float, needed: Samples | float) -> Samples:
    """Probability that odds of which these are expected come out above what is needed: their variance is twice what is
    expected of them."""
    deviation = np.sqrt(2 * np.maximum(log_odds, LEAST_ODDS))
    return np.asarray(norm.cdf(deviation / 2 - needed / deviation))


def chance_of_naming(log_odds: Samples, log_posterior: Samples) -> float:
    """Probability that the true one of n sets is named after a record that is expected to bring ``log_odds`` (n, n)
    against each of its rivals, [rival, true], where these are their log posteriors (n,) so far: that it passes all of
    them."""
    n = len(log_posterior)
    lead_of_rival = log_posterior[:, None] - log_posterior
    # Where the records so far are sure of a member and it is tied all the same, the new one must speak for it itself.
    needed = np.maximum(lead_of_rival + np.log((n - 1) * SURE / (1 - SURE)), -np.log(1 - SURE))
    named = np.array([_passes_all(log_odds, needed, true) for true in range(n)])
    return float(softmax(log_posterior) @ named)


def _passes_all(log_odds: Samples, needed: Samples, true: int) -> float:
    """Probability that the odds of one set against each of the others, [rival, true], come out above what is needed.

    What the record holds beside the answer of the true set favours two rivals alike as far as they lie on the same side
    of it: the odds are normal, their covariance that of the distances between the three.
    """
    rivals = np.delete(np.arange(len(log_odds)), true)
    expected = np.maximum(log_odds[rivals, true], LEAST_ODDS)
    if len(rivals) == 1:
        return float(passes(expected, needed[rivals, true])[0])
    apart = (log_odds + log_odds.T)[np.ix_(rivals, rivals)] / 2
    deviation = np.sqrt(2 * expected)
    correlation = np.clip((expected[:, None] + expected - apart) / np.outer(deviation, deviation), -1.0, 1.0)
    np.fill_diagonal(correlation, 1.0)
    # Distances under what each set may miss are not quite those of points.
    values, vectors = np.linalg.eigh(correlation)
    possible = (vectors * np.maximum(values, 0.0)) @ vectors.T
    spread = np.sqrt(np.diag(possible))
    above = multivariate_normal(np.zeros(len(rivals)), possible / np.outer(spread, spread), allow_singular=True, seed=0)
    above.abseps = above.releps = PRECISION
    margin = (expected - needed[rivals, true]) / deviation
    return min(float(above.cdf(margin)), float(norm.cdf(margin).min()))


def _best(predicted: _Predicted) -> Prediction | None:
    """The shortest good experiment; where there is none, the one that settles it most often."""
    tried = [predicted.of(excitation) for excitation in predicted.promising()]
    if not any(one.good for one in tried):
        ranked = sorted(tried, key=lambda one: -one.chance / one.excitation.seconds)
        for one in ranked[:LENGTHENED]:
            tried += predicted.lengthened(one.excitation)
    good = [one for one in tried if one.good]
    if good:
        return min(good, key=lambda one: (one.excitation.seconds, -one.log_odds))
    return max(tried, key=lambda one: (one.chance, one.log_odds), default=None)


class _Predicted:
    """Predictions for the members of one tie."""

    def __init__(self, selection: Selection, sets: Sets) -> None:
        contest = selection.contest
        self._axis, self._sets = selection.base, sets
        self._forecast = Forecast(contest.likelihood, sets)
        self._log_posterior = np.array([contest.log_posterior(names_of(entries)) for entries in sets])
        self._records = [run.modelled for run in contest.likelihood.runs]

    @property
    def _step_s(self) -> float:
        return self._records[0].run.step_s

    def options(self) -> list[Excitation]:
        """Everything that may be tried: what shows much, and what was played before."""
        axis = self._axis
        return list(dict.fromkeys([*excitations(axis, self._step_s), *repeats(self._records, axis)]))

    def promising(self) -> list[Excitation]:
        """The options whose answers lie furthest apart per second for noise alone. Those that the sensor would not
        see, or at voltages the model was never fitted at, are left out."""
        apart = {}
        for excitation in self.options():
            made = self._made(excitation)
            if self._within_sensor(made) and self._within_fitted_voltages(made):
                squared = self._forecast.squared_distances(made, free=False)
                apart[excitation] = float(_between(squared).min()) / excitation.seconds
        return sorted(apart, key=lambda excitation: -apart[excitation])[:MOST_PREDICTED]

    def of(self, excitation: Excitation) -> Prediction:
        """The prediction for one."""
        log_odds = self._forecast.squared_distances(self._made(excitation)) / 2
        chance = chance_of_naming(log_odds, self._log_posterior)
        return Prediction(excitation, float(_between(log_odds).min()), chance)

    def lengthened(self, excitation: Excitation) -> list[Prediction]:
        """Predictions for an excitation that lasts longer, until one is good."""
        found: list[Prediction] = []
        for seconds in LENGTHS_s:
            if seconds > excitation.seconds and not (found and found[-1].good):
                found.append(self.of(replace(excitation, seconds=seconds)))
        return found

    def _made(self, excitation: Excitation) -> ModelledRun:
        """The run that it would give, from rest, without a measurement."""
        n = int(excitation.seconds / self._step_s)
        t: Samples = np.asarray(np.arange(n) * self._step_s, dtype=np.float64)
        start = 0 if excitation.idle else min(round(APPROACH_s / self._step_s), n // 2)
        run = GapRun(
            axis="x",
            role="train",
            t_s=t,
            u_V=excitation.voltage(t),
            x_um=np.zeros(n),
            r_um=None,
            start=start,
            stop=n,
            source="proposed",
            others_um={},
            others_V={},
        )
        return run_from_rest(self._axis, run)

    def _within_sensor(self, made: ModelledRun) -> bool:
        """Whether the sensor sees all of the motion, with some room to spare; positions it has seen before always
        count."""
        sensor, been = self._axis.sensor, [modelled.run.x_um for modelled in self._records]
        room = SENSOR_ROOM * (sensor.x_max_um - sensor.x_min_um)
        low = min(sensor.x_min_um + room, *(float(x.min()) for x in been))
        high = max(sensor.x_max_um - room, *(float(x.max()) for x in been))
        answers = [made.answer(entries) for entries in self._sets]
        return all(float(a.min()) >= low and float(a.max()) <= high for a in answers)

    def _within_fitted_voltages(self, made: ModelledRun) -> bool:
        """Whether every member keeps the hysteresis at voltages the base was fitted on; leakage may take it below
        them."""
        low, high = span_V(self._axis)
        slack = VOLTAGE_SLACK * (high - low)
        drives = [made.chain.signal_at(Place.AMPLIFIER, entries).value for entries in self._sets]
        return all(float(v.min()) >= low - slack and float(v.max()) <= high + slack for v in drives)


def _between(values: Samples) -> Samples:
    """The values (n, n) between different members."""
    return np.asarray(values[~np.eye(len(values), dtype=bool)])


def sensor_for(effects: Sequence[Effect]) -> str:
    """A sensor, in words, between the places of the chain where the members act."""
    first, last = min(e.place for e in effects), max(e.place for e in effects)
    return next((words for place, words in SENSORS.items() if first <= place <= last), SENSORS[Place.SENSOR])
