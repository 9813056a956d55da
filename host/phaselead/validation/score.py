"""How an answer is scored: functions of one outcome of ``trial.try_case``. docs/gap-campaign.md has the rules."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

from phaselead.model import catalogue
from phaselead.validation.journal import Outcome


def honest_rivals(name: str) -> set[str]:
    """Effects that may be tied with ``name``: either entry of the catalogue says that the two are confused, or that
    trials showed them to be hard to tell apart.
    """
    alike = {other: {*entry.confused_with, *entry.hard_to_tell_from} for other, entry in catalogue().items()}
    mine = alike.get(name, set())
    theirs = {other for other, names in alike.items() if name in names}
    return (mine | theirs) - {name}


def hidden_names(outcome: Outcome) -> list[str]:
    """Names of the hidden effects."""
    return [h["name"] for h in outcome["hidden"]]


def claims(outcome: Outcome) -> list[list[str]]:
    """What the answer claims: each named effect by itself, each tie as a group, no claim twice."""
    if outcome["error"]:
        return []
    found = [[name] for name in outcome["named"]] + [sorted(tie) for tie in outcome["ties"]]
    return [list(c) for c in dict.fromkeys(tuple(c) for c in found)]


def credit(truth: str, claimed: Sequence[Sequence[str]]) -> float:
    """1 for the right name, 1/size for a tie of the truth and honest rivals, 0 otherwise; the best claim counts."""
    allowed = honest_rivals(truth) | {truth}
    return max((1 / len(c) for c in claimed if truth in c and set(c) <= allowed), default=0.0)


def spurious(outcome: Outcome) -> list[list[str]]:
    """Claims that contain none of the hidden effects."""
    truth = set(hidden_names(outcome)) - set(outcome["without"])
    return [c for c in claims(outcome) if not truth & set(c)]


def exactly_right(outcome: Outcome) -> float:
    """For a single hidden effect: its credit, or 0 when anything else is claimed as well."""
    (truth,) = hidden_names(outcome)
    return 0.0 if spurious(outcome) else credit(truth, claims(outcome))


def all_named(outcome: Outcome) -> bool:
    """For several hidden effects: whether each is named, or tied with honest rivals only, by a claim of its own."""
    truths = hidden_names(outcome)
    return any(
        all(credit(truth, [claim]) > 0 for truth, claim in zip(truths, claimed, strict=True))
        for claimed in permutations(claims(outcome), len(truths))
    )


def abstained_honestly(outcome: Outcome) -> bool:
    """For an effect left out of the catalogue: whether the answer is unknown or an honest tie, and names nothing."""
    if outcome["error"]:
        return False
    (removed,) = hidden_names(outcome)
    ties_honest = bool(outcome["ties"]) and all(set(t) <= honest_rivals(removed) for t in outcome["ties"])
    return not outcome["named"] and ("unknown" in outcome["verdicts"] or ties_honest)


def outside_honestly(outcome: Outcome) -> bool:
    """For a system outside the catalogue: whether the answer is unknown or a tie, or a name that the case allows, and
    names nothing else. ``none`` is as wrong as a wrong name.
    """
    if outcome["error"] or set(outcome["named"]) - set(outcome.get("allowed", ())):
        return False
    return bool(outcome["named"]) or bool(outcome["ties"]) or "unknown" in outcome["verdicts"]


def nothing_false(outcome: Outcome) -> bool:
    """Whether each claim holds something that is there, and ``none`` is said only where the base lacks nothing, and
    what is hidden is said to be untestable or lies within its bound."""
    if outcome["error"]:
        return False
    lacking, hidden = set(outcome.get("allowed", ())), hidden_names(outcome)
    if outcome["verdicts"] == ["none"]:
        bounded = len(bounds_hold(outcome)) == len(hidden) and all(bounds_hold(outcome))
        return not lacking and (bounded or set(hidden) <= set(outcome["untestable"]))
    return all({*lacking, *hidden} & set(claim) for claim in claims(outcome))


def false_names(outcome: Outcome) -> bool:
    """With nothing hidden: whether anything is claimed. A crash is no claim."""
    return bool(claims(outcome))


def power_left(outcome: Outcome) -> float | None:
    """(after^2 - floor^2) / (before^2 - floor^2), not below 0; None where before is within 5 % of the floor.

    The floor is what the base leaves of the same records with nothing hidden, where the generator knows them; None too
    where it does not, and the base lacks more than what is hidden.
    """
    if outcome["error"] or (outcome.get("floor") is None and outcome.get("allowed")):
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


def _is_comparable(hidden: Outcome) -> bool:
    """Whether a true size has the unit of the catalogue's; a generator may count a growth for each decade where the
    catalogue counts it as a whole."""
    entry = catalogue().get(hidden["name"])
    return entry is not None and bool(entry.sizes) and hidden["unit"] == entry.sizes[0].unit


def alone_hidden(outcome: Outcome) -> list[Outcome]:
    """The hidden effects of which the stage had none before: of others only a sum of both sizes could be found."""
    return [h for h in outcome["hidden"] if h["name"] not in outcome.get("allowed", ())]


def bounds_hold(outcome: Outcome) -> list[bool]:
    """For each of ``alone_hidden`` that was missed but bounded: whether its true size is within the bound."""
    if outcome["error"]:
        return []
    claimed = {name for claim in claims(outcome) for name in claim}
    found = []
    for h in alone_hidden(outcome):
        of_axis = [
            b for b in outcome["excluded"]
            if b["name"] == h["name"] and (h["axis"] is None or b["axis"] in (None, h["axis"]))
        ]  # fmt: skip
        if h["name"] not in claimed and of_axis and _is_comparable(h):
            found.append(abs(h["value"]) <= max(b["upper_95"] for b in of_axis))
    return found


def intervals_hold(outcome: Outcome) -> list[bool]:
    """For each of ``alone_hidden`` that was named with a size: whether the true one lies in its 95 % interval. Signs
    are as the catalogue counts them, and truths have none."""
    sizes = {} if outcome["error"] else outcome.get("sizes", {})
    found = []
    for h in alone_hidden(outcome):
        if h["name"] in sizes and _is_comparable(h):
            _, low, high = sizes[h["name"]]
            found.append(low <= h["value"] <= high or low <= -h["value"] <= high)
    return found


def names_right(outcome: Outcome) -> list[bool]:
    """For each name that is given, not each tie: whether it is hidden, or allowed in a system outside the catalogue."""
    truth = {*hidden_names(outcome), *outcome.get("allowed", ())} - set(outcome["without"])
    return [name in truth for name in ([] if outcome["error"] else outcome["named"])]


def names_beyond(outcome: Outcome) -> list[bool]:
    """The same without the names that are allowed, which most stages of such a kind bear out."""
    given = [] if outcome["error"] else outcome["named"]
    pairs = zip(given, names_right(outcome), strict=True)
    return [right for name, right in pairs if name not in outcome.get("allowed", ())]


def stated_and_right(outcome: Outcome) -> list[tuple[float, bool]]:
    """For each name that is given: the probability that was stated, and whether it is right."""
    if outcome["error"]:
        return []
    stated = outcome.get("probability", {})
    return [
        (stated[name], right) for name, right in zip(outcome["named"], names_right(outcome), strict=True)
        if name in stated
    ]  # fmt: skip


def times_detectable(outcome: Outcome) -> float | None:
    """The true size of a single hidden effect as a multiple of what was stated to be detectable; None where nothing
    was stated."""
    (h,) = outcome["hidden"]
    least = (outcome.get("detectable") or {}).get(h["name"]) if _is_comparable(h) else None
    return abs(h["value"]) / least if least else None


def resolved(outcome: Outcome) -> bool | None:
    """Whether the proposed experiment replaced a tie that held the truth by its name; None without such a tie."""
    after = outcome.get("after_next")
    if not after:
        return None
    truths = [t for t in hidden_names(outcome) if t in after["tie"]]
    if not truths:
        return None
    return truths[0] in after["named"] and not (set(after["tie"]) - {truths[0]}) & set(after["named"])


def stated_chance(outcome: Outcome) -> float | None:
    """How probably the experiment of ``resolved`` was said to settle its tie; None without one, or where an older
    campaign did not keep it."""
    return None if resolved(outcome) is None else (outcome.get("next") or {}).get("chance")


def needs_sensor(outcome: Outcome) -> bool | None:
    """Of a tie that holds a hidden effect, and for which something was proposed, whether that is a sensor, since no
    experiment is likely to tell; None without such a tie, or where an older campaign did not keep it."""
    proposed = None if outcome["error"] else outcome.get("next")
    if not proposed or not set(hidden_names(outcome)) & set(proposed["tie"]):
        return None
    return bool(proposed["needs_sensor"])


def confidence(outcome: Outcome) -> float | None:
    """Points by which the least certain name beats none; None where nothing is named."""
    known = [s for s in (outcome.get("scores") or {}).values() if s is not None]
    return min(known) if known else None
