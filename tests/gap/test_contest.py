"""A set that grew from a rival of what is there comes back to what is there."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from phaselead.gap.posterior import Contest, Likelihood, likelihood_of
from phaselead.gap.posterior import contest as of_contest
from phaselead.gap.posterior.contest import exchange
from phaselead.gap.posterior.sets import Begun
from phaselead.gap.posterior.starts import Starts
from phaselead.gap.records import GapRun
from phaselead.gap.residual import modelled_run
from phaselead.model.axis import AxisModel, TimeView
from phaselead.model.effects import effect

STEP_S, ROWS, LATE_ROWS, GAIN = 1e-3, 2000, 3, 0.05
STRAIGHT = AxisModel(time=TimeView(gain_um_per_V=10.0, u_range_V=(0.0, 8.0), rate_Hz=1 / STEP_S))
EFFECTS = [effect(name) for name in ("gain_change", "delay", "sensor_lowpass", "saturation")]
RIGHT = ("delay", "gain_change")
LATE = {"delay_s": LATE_ROWS * STEP_S}


def entry(name, **params):
    found = effect(name)
    return found, {p.name: params.get(p.name, p.typical) for p in found.parameters}


def run_of(role, seed):
    """A stage that multiplies; outside the references also 5 % more, and three rows late."""
    rng, t = np.random.default_rng(seed), np.arange(ROWS) * STEP_S
    u = 4 + 2.0 * np.sin(2 * np.pi * (3 + seed) * t) + 0.5 * np.sin(2 * np.pi * (50 + 7 * seed) * t)
    late = 0 if role == "reference" else LATE_ROWS
    held = np.concatenate([np.full(late, u[0]), u[: ROWS - late]])
    x = 10.0 * (1 + GAIN * (role != "reference")) * held + 0.005 * rng.normal(size=ROWS)
    return GapRun("x", role, t, u, x, None, 0, ROWS, f"{seed}.csv", {}, {})


@cache
def likelihood() -> Likelihood:
    roles = ("reference", "reference", "train", "train", "holdout")
    return likelihood_of([modelled_run(STRAIGHT, run_of(role, seed)) for seed, role in enumerate(roles)])


def pool_of(*sets):
    fits = [likelihood().fit(entries) for entries in sets]
    return {fit.names: fit for fit in fits}


def after_exchange(pool, effects=EFFECTS):
    found = dict(pool)
    exchange(Starts(likelihood(), effects), found)
    return found


def best_of(pool):
    return max(pool, key=Contest(likelihood(), pool, Starts(likelihood(), EFFECTS)).log_posterior)


def test_a_rival_in_the_place_of_what_is_there_is_exchanged():
    gain, lag = entry("gain_change", gain=GAIN), entry("sensor_lowpass", tau_s=LATE_ROWS * STEP_S)
    pool = after_exchange(pool_of((), (gain,), (gain, lag)))
    assert best_of(pool) == RIGHT
    found = {e.name: params for e, params in pool[RIGHT].entries}
    np.testing.assert_allclose(found["delay"]["delay_s"], LATE_ROWS * STEP_S, rtol=0.05)
    np.testing.assert_allclose(found["gain_change"]["gain"], GAIN, rtol=0.2)


def test_two_rivals_are_exchanged_one_after_the_other():
    soft, lag = entry("softening"), entry("sensor_lowpass", tau_s=LATE_ROWS * STEP_S)
    assert best_of(after_exchange(pool_of((), (soft, lag)), [*EFFECTS, effect("softening")])) == RIGHT


def test_the_search_comes_back_from_a_beam_that_missed_what_is_there(monkeypatch):
    whole = of_contest._beside
    monkeypatch.setattr(
        of_contest, "_beside", lambda *given: [fit for fit in whole(*given) if "delay" not in fit.names]
    )
    found = of_contest.search_sets(likelihood(), EFFECTS, lambda share: None)
    best = max(found.fits, key=found.log_posterior)
    assert set(RIGHT) <= set(best)
    assert "sensor_lowpass" not in best


def test_only_what_may_be_taken_for_an_effect_takes_its_place():
    gain, late = entry("gain_change", gain=GAIN), entry("delay", **LATE)
    before = pool_of((), (gain,), (gain, late))
    assert set(after_exchange(before)) - set(before) == {("gain_change", "sensor_lowpass")}


def test_sets_that_are_there_are_not_fitted_anew():
    gain, late, lag = entry("gain_change", gain=GAIN), entry("delay", **LATE), entry("sensor_lowpass", tau_s=1e-3)
    before = pool_of((), (gain,), (gain, late), (gain, lag))
    after = after_exchange(before)
    assert after.keys() == before.keys()
    assert all(after[names] is before[names] for names in before)


def test_an_effect_of_several_forms_is_begun_from_more_than_one():
    """No fit goes from one to another: a softening about the mean was lost behind two about rest, of other times."""
    starts = Starts(likelihood(), [effect("softening")]).beside(likelihood().fit(()))["softening"]
    assert len({start.entry[1]["about_mean"] for start in starts}) == len(starts) > 1


class Weighed:
    """A likelihood that gives each set the evidence of a table, whatever its parameters."""

    known = ()
    beyond = None

    def __init__(self, evidence):
        self.evidence = {tuple(sorted(names.split())): value for names, value in evidence.items()}

    def knowing(self, entries):
        return self

    with_misfit_of = knowing

    def fit(self, start):
        entries = start.entries if isinstance(start, Begun) else start
        names = tuple(sorted(effect.name for effect, _ in entries))
        return SimpleNamespace(
            entries=tuple(entries),
            names=names,
            log_evidence=self.evidence.get(names, 0.0),
            levels=lambda held_out: 0.0,
            terms=SimpleNamespace(stood=()),
            begun=Begun(entries),
            begun_without=lambda i: Begun((*entries[:i], *entries[i + 1 :])),
        )

    def fitted_terms(self, start, steps):
        assert steps == 0
        return None, 0.1, self.fit(start).log_evidence


@pytest.mark.parametrize("rival", ["sensor_lowpass", "gain_change"])
def test_a_winner_that_was_far_behind_meets_its_rivals(rival):
    """Beside a creep a delay and a lag led alike; alone, when the contest gave the base what looked like creep, the
    delay won, and the lag alone had no part in it: 32 us of an amplifier's lag were named a delay."""
    creep, late, other = entry("creep"), entry("delay"), entry(rival)
    led = Weighed({"creep delay": 100.0, f"creep {rival}": 99.9, "delay": 50.0, rival: 50.0})
    sets = [(), (creep, late), (creep, other), (late,), (other,)]
    pool = {fit.names: fit for fit in map(led.fit, sets)}
    last = Weighed({"creep delay": 110.0, f"creep {rival}": 109.9, "delay": 120.0, rival: 119.9})
    contest = of_contest._last_contest(SimpleNamespace(likelihood=last, effects=range(10)), pool)
    assert ((rival,) in contest.fits) == (rival == "sensor_lowpass")  # nobody takes a delay for a change of gain
    assert max(contest.fits, key=contest.log_posterior) == ("delay",)


def test_the_winner_less_one_effect_is_fitted_from_where_the_winner_stands_too():
    """A leak alone stayed at half its rate, where it had grown, and a bend of the sensor beside it took the rest."""
    slow, quick = (entry("charge_leakage", rate_per_s=rate) for rate in (0.02, 0.05))
    bend = entry("sensor_nonlinearity")
    leak = slow[0].name

    class Stuck(Weighed):
        def fit(self, start):
            found = super().fit(start)
            found.log_evidence += 10.0 * any(params.get("rate_per_s") == 0.05 for _, params in found.entries)
            return found

    table = Stuck({f"{leak} {bend[0].name}": 100.0, leak: 90.0})
    pool = {one.names: one for one in map(table.fit, [(), (slow,), (quick, bend), (bend,)])}
    contest = of_contest._last_contest(SimpleNamespace(likelihood=table, effects=range(10)), pool)
    assert contest.fits[(leak,)].entries == (quick,)
    assert contest.fits[(leak,)].log_evidence == 100.0
