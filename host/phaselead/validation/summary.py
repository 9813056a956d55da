"""The numbers of a campaign, from the outcomes of its cases, as plain JSON types."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from phaselead.validation import score
from phaselead.validation.journal import Outcome

ROWS_OF_60_S = 300_000.0
"""Of one axis at 5 kHz."""
NOTHING, UNKNOWN, FAILED = "nothing", "unknown", "failed"
LEAST_SIZE = 0.2 - 1e-9
"""Size, as a multiple of the typical one, from which an effect counts as large."""
MOST_SIZES = 6
"""More distinct sizes than this are not steps of a ladder."""
SINGLE_AXIS = ("none", "single", "sines", "pair", "triple", "removed", "closed_loop", "outside")
"""Kinds whose stage has one axis."""


def summary(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Numbers against their targets, and the data of the figures."""
    single = _of(outcomes, "single")
    return {
        "cases": len(outcomes),
        "by_kind": {kind: len(_of(outcomes, kind)) for kind in dict.fromkeys(o["kind"] for o in outcomes)},
        "numbers": numbers(outcomes),
        "confusion": confusion([*single, *_of(outcomes, "sines"), *_of(outcomes, "closed_loop")]),
        "accuracy_by_size": {"mixed": by_size(single), "sines": by_size(_of(outcomes, "sines"))},
        "accuracy_coverage": accuracy_coverage([*single, *_of(outcomes, "sines")]),
        "failed": [{"case": o["case"], "error": o["error"]} for o in outcomes if o["error"]],
        "wrong": wrong(outcomes),
    }


def _of(outcomes: Iterable[Outcome], *kinds: str) -> list[Outcome]:
    return [o for o in outcomes if o["kind"] in kinds]


def _size(outcome: Outcome) -> float:
    return float(outcome["hidden"][0]["size"])


def numbers(outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
    """The rows of the table: what, its target, what was reached (None without cases) and over how many cases."""
    single, sines = _of(outcomes, "single"), _of(outcomes, "sines")
    several, none = _of(outcomes, "pair"), _of(outcomes, "none")
    triple, removed, poor = (_of(outcomes, kind) for kind in ("triple", "removed", "poor"))
    hiding = [o for o in outcomes if o["hidden"] and o["kind"] != "removed"]
    left = [p for o in single if _voltage_alone(o) and (p := score.power_left(o)) is not None]
    again = [r for o in outcomes if (r := score.resolved(o)) is not None]
    times = [o["cpu_seconds"] * ROWS_OF_60_S / o["rows"] for o in _of(outcomes, *SINGLE_AXIS) if not o["error"]]
    large = [o for o in single if _size(o) >= LEAST_SIZE]
    small = [o for o in single if _size(o) < LEAST_SIZE]
    held = [ok for o in hiding for ok in score.bounds_hold(o)]
    absent = [True] * sum(score.absent_bounds(o) for o in outcomes)
    return [
        _share("names exactly right, one effect of 0.2 x its typical size and more", ">= 95 %",
               map(score.exactly_right, large)),
        _share("the same at 0.05 x", ">= 75 %", map(score.exactly_right, small)),
        _count("false names with nothing hidden", "0 of 200", map(score.false_names, none)),
        _share("both of a pair named", ">= 85 %", map(score.all_named, several)),
        _share("pairs with a spurious name beside them", "<= 5 %", (bool(score.spurious(o)) for o in several)),
        _share("all of a triple named", "-", map(score.all_named, triple)),
        _share("an effect left out of the catalogue ends as unknown or an honest tie", ">= 90 %",
               map(score.abstained_honestly, removed)),
        _share("a system outside the catalogue ends as unknown or a tie", "100 %",
               map(score.outside_honestly, _of(outcomes, "outside"))),
        _median("held-out power left after adoption, effects that a voltage predicts", "<= 2 %", left),
        _share("true size inside the bound where a hidden effect was missed", ">= 95 %", held),
        _share("the same, effects that are not there counted too (all inside)", ">= 95 %", [*held, *absent]),
        _share("one proposed experiment resolves a tie", ">= 85 %", again),
        _share("names exactly right on sines alone, 0.2 x and more", "-",
               (score.exactly_right(o) for o in sines if _size(o) >= LEAST_SIZE)),
        _share("names exactly right in closed loop", "-", map(score.exactly_right, _of(outcomes, "closed_loop"))),
        _share("cross-coupling named on three axes, 0.2 x and more", "-",
               (score.exactly_right(o) for o in _of(outcomes, "coupling") if _size(o) >= LEAST_SIZE)),
        _count("wrong names from data too poor to tell", "0", (bool(score.spurious(o)) for o in poor)),
        {"what": "processor time for 60 s of one-axis 5 kHz data, median", "target": "<= 30 s on two", "unit": "s",
         "reached": float(np.median(times)) if times else None, "of": len(times)},
    ]  # fmt: skip


def _voltage_alone(outcome: Outcome) -> bool:
    names = score.hidden_names(outcome)
    return all(map(score.predictable, names)) and score.exactly_right(outcome) > 0


def _share(what: str, target: str, values: Iterable[float | bool]) -> dict[str, Any]:
    found = [float(v) for v in values]
    reached = 100 * float(np.mean(found)) if found else None
    return {"what": what, "target": target, "unit": "%", "reached": reached, "of": len(found)}


def _count(what: str, target: str, values: Iterable[bool]) -> dict[str, Any]:
    found = list(values)
    return {"what": what, "target": target, "unit": "", "reached": sum(found) if found else None, "of": len(found)}


def _median(what: str, target: str, values: Sequence[float]) -> dict[str, Any]:
    reached = 100 * float(np.median(values)) if values else None
    return {"what": what, "target": target, "unit": "%", "reached": reached, "of": len(values)}


def confusion(outcomes: Sequence[Outcome]) -> dict[str, dict[str, float]]:
    """By hidden effect, how its cases were answered: claims share a case equally, and so do the members of a tie."""
    found: dict[str, dict[str, float]] = defaultdict(lambda: defaultdict(float))
    for outcome in outcomes:
        (truth,) = score.hidden_names(outcome)
        for name, weight in _answered(outcome).items():
            found[truth][name] += weight
    return {truth: dict(row) for truth, row in sorted(found.items())}


def _answered(outcome: Outcome) -> dict[str, float]:
    claimed = score.claims(outcome)
    if not claimed:
        unsure = UNKNOWN if UNKNOWN in outcome.get("verdicts", ()) else NOTHING
        return {FAILED if outcome["error"] else unsure: 1.0}
    weights: dict[str, float] = defaultdict(float)
    for claim in claimed:
        for name in claim:
            weights[name] += 1 / (len(claim) * len(claimed))
    return weights


def by_size(outcomes: Sequence[Outcome]) -> dict[str, dict[str, float]]:
    """Share of exactly right answers by effect and size; "all" is over every effect. Sizes that a generator draws at
    will are gathered at the nearest of 0.03, 0.1, 0.3, 1 and 3.
    """
    drawn = len({_size(outcome) for outcome in outcomes}) > MOST_SIZES
    cells: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for outcome in outcomes:
        (truth,) = score.hidden_names(outcome)
        for row in (truth, "all"):
            cells[row][_half_decade(_size(outcome)) if drawn else f"{_size(outcome):g}"].append(
                score.exactly_right(outcome)
            )
    return {row: {size: float(np.mean(v)) for size, v in sorted(of.items())} for row, of in sorted(cells.items())}


def _half_decade(size: float) -> str:
    return f"{10 ** (round(2 * np.log10(size)) / 2):.1g}"


def accuracy_coverage(outcomes: Sequence[Outcome]) -> list[dict[str, float]]:
    """Share of cases answered, and accuracy among these, if only names with so many points were accepted."""
    points = [(c, score.exactly_right(o)) for o in outcomes if (c := score.confidence(o)) is not None]
    points.sort(reverse=True)
    right = np.cumsum([r for _, r in points])
    return [
        {"points": c, "coverage": (i + 1) / len(outcomes), "accuracy": float(right[i] / (i + 1))}
        for i, (c, _) in enumerate(points)
    ]


RIGHT: dict[str, Callable[[Outcome], bool]] = {
    "none": lambda o: not score.false_names(o),
    "removed": score.abstained_honestly,
    "outside": score.outside_honestly,
    "poor": lambda o: not score.spurious(o),
    "pair": lambda o: score.all_named(o) and not score.spurious(o),
    "triple": lambda o: score.all_named(o) and not score.spurious(o),
}
"""By kind, whether a case was answered rightly. Other kinds hide a single effect."""


def _one_right(outcome: Outcome) -> bool:
    return score.exactly_right(outcome) > 0


def wrong(outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
    """Every case with a wrong answer, and that answer."""
    found = []
    for o in outcomes:
        right = RIGHT.get(o["kind"], _one_right)
        if o["error"] or not right(o):
            claimed, verdicts = score.claims(o), o.get("verdicts")
            found.append({"case": o["case"], "said": claimed, "verdicts": verdicts, "error": o["error"]})
    return found
