"""What effects had done before a record began.

What an effect in front of the hysteresis had done before stands off as a voltage, and passes plays and bends: a little
of it does something in proportion, and much does not. So its columns are those of a little more beside what had stood
off already.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from phaselead.gap.parameters import SizedEffect
from phaselead.gap.residual import ModelledRun, modelled_run, run_from_rest, run_from_where_it_stood
from phaselead.identify import amounts_before
from phaselead.model import Effect, Entry, Params, Place, Signal
from phaselead.record import Samples

STANDING, LEAST_STANDING = 8, 2
"""How often what stood off before a record is found beside itself at most, and for a rough fit: budgets of time."""
SMALL_AMOUNT = 0.05
"""In prior deviations of what had stood off, the step of the finite difference for its columns, and the change at which
its iteration stops: small beside the thresholds of larger plays, so that the answer is linear in it."""

Stood = Mapping[str, tuple[float, ...]]
"""By effect what had stood off as a voltage before a record, in prior deviations of the state of each of its lags."""


def stands_off(effect: Effect) -> bool:
    """Whether what an effect had done before a record stands off as a voltage in front of the hysteresis."""
    return effect.before_record is not None and effect.place <= Place.AMPLIFIER


def with_stood(entries: Sequence[Entry], stood: Stood, by: Sequence[Entry] | None = None) -> list[Entry]:
    """The effects, and what had stood off by them or, if given, ``by`` others."""
    found = list(entries)
    for effect, params in entries if by is None else by:
        if any(stood.get(effect.name, ())):
            found.append(_standing_off(effect, params, stood[effect.name]))
    return found


def _standing_off(effect: Effect, params: Params, amounts: tuple[float, ...]) -> Entry:
    """What adds such a voltage behind an effect. The row in front of a record has that of the first: the memory of the
    stage came about there."""
    before = effect.before_record
    assert before is not None

    def apply(signal: Signal, _: Params) -> Samples:
        return np.asarray(signal.value + before(signal.since_s, params, signal.axis) @ np.array(amounts))

    given: Params = {**params, "amounts": amounts}
    return replace(
        effect, name=f"{effect.name} before", apply=apply,
        parameters=(), accepts=tuple(given), fixed={}, normalise=lambda same: same,
    ), given  # fmt: skip


def amounts_stood(entries: Sequence[Entry], of_effects: Sequence[int], stood: Stood) -> Samples:
    """(k,) amounts of the columns of ``before_record``, each of the entry of that number: 0 of what is no voltage."""
    found, of = np.zeros(len(of_effects)), np.array(of_effects)
    for i, (effect, _) in enumerate(entries):
        if effect.name in stood:
            found[of == i] = stood[effect.name]
    return found


def stood_of(entries: Sequence[Entry], of_effects: Sequence[int], amounts: Samples) -> Stood:
    """What stood off as voltages, by the amounts (k,) of all columns of ``before_record``."""
    of = np.array(of_effects)
    return {effect.name: tuple(amounts[of == i].tolist()) for i, (effect, _) in enumerate(entries)
            if stands_off(effect)}  # fmt: skip


def before_record(
    modelled: ModelledRun, entries: Sequence[Entry], beside: Sequence[Entry] = (), stood: Stood | None = None
) -> list[Samples]:
    """Columns (n, k) in um of what each effect had done before the record began, one deviation of the state of each of
    its lags; k is 0 of one that is not slow. Where the past of an effect acts as a voltage, which is not linear, its
    columns are the slope at ``stood`` with the effects ``beside`` acting."""
    run, stood = modelled.run, stood or {}
    since_s = run.t_s - run.t_s[0]
    found: list[Samples] = []
    for effect, params in entries:
        if effect.before_record is None:
            found.append(np.zeros((run.stop - run.start, 0)))
        elif stands_off(effect):
            k = effect.before_record(since_s[:1], params, modelled.axis).shape[1]
            amounts = np.array(stood.get(effect.name, (0.0,) * k))
            others = with_stood(beside, stood, [one for one in entries if one[0] is not effect])

            def answer(at: Samples, one: Entry = (effect, params), among: Sequence[Entry] = others) -> Samples:
                return modelled.answer([*among, _standing_off(*one, tuple(at.tolist()))])

            there = answer(amounts)
            moved = amounts + SMALL_AMOUNT * np.eye(k)
            found.append(np.stack([answer(at) - there for at in moved], axis=1) / SMALL_AMOUNT)
        else:
            found.append(effect.before_record(since_s, params, modelled.axis)[run.rows])
    return found


def history_um(modelled: ModelledRun, entries: Sequence[Entry], error: Samples) -> Samples:
    """The part (n,) of a residual about its mean, beside some effects, of what each of these had done before a run.

    What stood off as a voltage is found again beside itself, and of all that was tried counts what leaves least.
    """
    slow = [entry for entry in entries if entry[0].before_record is not None]
    if not slow:
        return np.zeros(len(error))
    answer = modelled.answer(entries)
    stood: Stood = {}
    best: Samples = np.zeros(len(error))
    for _ in range(STANDING):
        parts = before_record(modelled, slow, entries, stood)
        of_effects = [i for i, part in enumerate(parts) for _ in range(part.shape[1])]
        before = np.concatenate(parts, axis=1)
        before = before - before.mean(axis=0)
        # All that had stood off is an amount of its columns, not only what differs from that beside which they are.
        all_of_it = (
            error - _stands_um(modelled, entries, stood, answer) + before @ amounts_stood(slow, of_effects, stood)
        )
        left = all_of_it - before @ np.linalg.lstsq(before, all_of_it, rcond=None)[0]
        amounts = amounts_before(before, all_of_it, left)
        stood = stood_of(slow, of_effects, amounts)
        no_voltage = amounts - amounts_stood(slow, of_effects, stood)
        found = _stands_um(modelled, entries, stood, answer) + before @ no_voltage
        if np.var(error - found) >= np.var(error - best):
            break
        best = found
    return best


def from_its_memory(modelled: ModelledRun, entries: Sequence[SizedEffect]) -> ModelledRun:
    """The run from the memory that suits it best beside some effects. Beside what these had done before it, where that
    is a voltage: then a step from rest, and how it stood, are other memories than they seem without."""
    axis, run = modelled.axis, modelled.run
    found = modelled_run(axis, run, entries)
    if not any(stands_off(effect) for effect, _ in entries):
        return found
    others = (modelled, run_from_rest(axis, run), run_from_where_it_stood(axis, run))
    return min(found, *others, key=lambda one: left_um2(one, entries))


def left_um2(modelled: ModelledRun, entries: Sequence[Entry]) -> float:
    """Variance of what effects leave of a run, but for what they had done before it."""
    error = modelled.error_about_mean(entries)
    return float(np.var(error - history_um(modelled, entries, error)))


def _stands_um(modelled: ModelledRun, entries: Sequence[Entry], stood: Stood, answer: Samples) -> Samples:
    """What (n,) stood off adds to an answer, about its mean."""
    if not any(map(any, stood.values())):
        return np.zeros(len(answer))
    added = modelled.answer(with_stood(entries, stood)) - answer
    return np.asarray(added - added.mean())
