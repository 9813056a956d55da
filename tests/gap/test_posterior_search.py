"""A set that grew from a rival of what is there comes back to what is there."""

from __future__ import annotations

from functools import cache

import numpy as np

from phaselead.gap.posterior import Contest, Likelihood, likelihood_of, search
from phaselead.gap.posterior.search import exchange
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
    return GapRun("x", role, t, u, x, None, 0, ROWS, f"{seed}.csv", str(seed), {}, {})


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
    return max(pool, key=Contest(likelihood(), pool, len(EFFECTS)).log_posterior)


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
    whole = search._beside
    monkeypatch.setattr(search, "_beside", lambda *given: [fit for fit in whole(*given) if "delay" not in fit.names])
    found = search.search_sets(likelihood(), EFFECTS, lambda share: None)
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
