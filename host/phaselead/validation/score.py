"""How an answer is scored: pure functions on outcomes (``trial.try_case``). docs/gap-campaign.md has the rules."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from phaselead.model import catalogue

Outcome = dict[str, Any]

ALSO_RIVALS = (
    ("thermal_drift", "creep"),
    ("thermal_drift", "charge_leakage"),
    ("sensor_lowpass", "delay"),
    ("sensor_lowpass", "amplifier_lowpass"),
    ("delay", "amplifier_lowpass"),
    ("sensor_nonlinearity", "asymmetric_hysteresis"),
    ("sensor_nonlinearity", "gain_change"),
    ("backlash", "hysteresis"),
    ("rate_dependence", "creep"),
    ("rate_dependence", "amplifier_lowpass"),
)
"""Pairs that were measured to be hard to tell apart, beside what the catalogue's entries say of themselves."""


def honest_rivals(name: str) -> set[str]:
    """Effects that may stand beside ``name`` in a tie: those either entry of the catalogue says it is confused with."""
    entries = catalogue()
    mine = set(entries[name].confused_with) if name in entries else set()
    theirs = {other for other, entry in entries.items() if name in entry.confused_with}
    also = {a if b == name else b for a, b in ALSO_RIVALS if name in (a, b)}
    return (mine | theirs | also) - {name}


def hidden_names(outcome: Outcome) -> list[str]:
    """The truth."""
    return [h["name"] for h in outcome["hidden"]]


def said(outcome: Outcome) -> list[list[str]]:
    """Everything the answer claims: each named effect alone, each tie as a group, no claim twice."""
    if outcome["error"]:
        return []
    claims = [[name] for name in outcome["named"]] + [sorted(tie) for tie in outcome["ties"]]
    return [list(c) for c in dict.fromkeys(tuple(c) for c in claims)]


def credit(truth: str, claims: Sequence[Sequence[str]]) -> float:
    """1 for a name, 1/size for a tie that holds the truth and only its honest rivals; the best claim counts."""
    allowed = honest_rivals(truth) | {truth}
    return max((1 / len(c) for c in claims if truth in c and set(c) <= allowed), default=0.0)


def spurious(outcome: Outcome) -> list[list[str]]:
    """Claims that hold nothing of the truth."""
    truth = set(hidden_names(outcome)) - set(outcome["without"])
    return [c for c in said(outcome) if not truth & set(c)]


def exactly_right(outcome: Outcome) -> float:
    """Of a single effect: its credit, or 0 when anything else is claimed beside it."""
    (truth,) = hidden_names(outcome)
    return 0.0 if spurious(outcome) else credit(truth, said(outcome))


def all_named(outcome: Outcome) -> bool:
    """Of several effects: each is named, or in a tie with its honest rivals only."""
    return all(credit(truth, said(outcome)) > 0 for truth in hidden_names(outcome))


def abstained_honestly(outcome: Outcome) -> bool:
    """Of a removed effect: unknown, or a tie of its honest rivals, and nothing named that is none of them."""
    if outcome["error"]:
        return False
    (removed,) = hidden_names(outcome)
    ties_honest = bool(outcome["ties"]) and all(set(t) <= honest_rivals(removed) for t in outcome["ties"])
    return not outcome["named"] and ("unknown" in outcome["verdicts"] or ties_honest)


def false_names(outcome: Outcome) -> bool:
    """With nothing hidden: anything claimed at all. A crash is no claim."""
    return bool(said(outcome))


def power_left(outcome: Outcome) -> float | None:
    """(after^2 - floor^2) / (before^2 - floor^2), not below 0; None where before is within 5 % of the floor.

    The floor is what the base leaves of the same records with nothing hidden, where the generator knows them.
    """
    if outcome["error"]:
        return None
    before, after, floor = (float(outcome["gap"][k]) for k in ("before", "after", "floor"))
    floor = floor if outcome.get("floor") is None else float(outcome["floor"])
    if before < 1.05 * floor:
        return None
    return max(0.0, (after**2 - floor**2) / (before**2 - floor**2))


def predictable(name: str) -> bool:
    """Whether a voltage predicts it."""
    entry = catalogue().get(name)
    return entry is not None and entry.kind == "response"


def bounds_hold(outcome: Outcome) -> list[bool]:
    """For each hidden effect that was missed and bounded: whether its true size lies inside the bound."""
    if outcome["error"]:
        return []
    claimed = {name for claim in said(outcome) for name in claim}
    found = []
    for h in outcome["hidden"]:
        of_axis = [
            b for b in outcome["excluded"]
            if b["name"] == h["name"] and (h["axis"] is None or b["axis"] in (None, h["axis"]))
        ]  # fmt: skip
        if h["name"] not in claimed and of_axis:
            found.append(abs(h["value"]) <= max(b["upper_95"] for b in of_axis))
    return found


def absent_bounds(outcome: Outcome) -> int:
    """How many effects that are not there were bounded. A bound is never below 0, so all of these hold."""
    hidden = {(h["name"], h["axis"]) for h in outcome["hidden"]}
    bounds = () if outcome["error"] else outcome["excluded"]
    return sum((b["name"], None) not in hidden and (b["name"], b["axis"]) not in hidden for b in bounds)


def resolved(outcome: Outcome) -> bool | None:
    """Whether the proposed experiment turned a tie that held the truth into its name; None without such a tie."""
    after = outcome.get("after_next")
    if not after:
        return None
    truths = [t for t in hidden_names(outcome) if t in after["tie"]]
    if not truths:
        return None
    return truths[0] in after["named"] and not (set(after["tie"]) - {truths[0]}) & set(after["named"])


def confidence(outcome: Outcome) -> float | None:
    """Points by which the least certain name beats none; None where nothing is named."""
    known = [s for s in (outcome.get("scores") or {}).values() if s is not None]
    return min(known) if known else None
