"""The numbers of a campaign, from the outcomes of its cases, as plain JSON types."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from phaselead.gap import SURE
from phaselead.validation import score
from phaselead.validation.journal import Outcome
from phaselead.validation.trial import FOLLOWED_UP

ROWS_OF_60_S = 300_000.0
"""Of one axis at 5 kHz."""
NOTHING, UNKNOWN, FAILED = "nothing", "unknown", "failed"
LEAST_SIZE = 0.2 - 1e-9
"""Size, as a multiple of the typical one, from which an effect counts as large."""
PLAIN = 2.0
"""Multiple of the size that was stated to be detectable, from which an effect should be named."""
MOST_SIZES = 6
"""More distinct sizes than this are not steps of a ladder."""
SINGLE_AXIS = (
    "none", "single", "sines", "pair", "triple", "removed", "closed_loop", "outside", "narrow", "slow_sines",
    "unreferenced", "straight",
)  # fmt: skip
"""Kinds whose stage has one axis, but for `poor`, whose records are seconds long: what their answer takes hardly
depends on it."""


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
    left = [
        p
        for o in hiding
        if o.get("adopted", o.get("named")) and _predictable(o) and (p := score.power_left(o)) is not None
    ]
    given = [ok for o in outcomes for ok in score.names_right(o)]
    again = [r for o in outcomes if (r := score.resolved(o)) is not None]
    chances = [c for o in outcomes if (c := score.stated_chance(o)) is not None]
    asked = [a for o in _of(outcomes, *FOLLOWED_UP) if (a := score.needs_sensor(o)) is not None]
    times = [o["cpu_seconds"] * ROWS_OF_60_S / o["rows"] for o in _of(outcomes, *SINGLE_AXIS) if not o["error"]]
    large = [o for o in single if _size(o) >= LEAST_SIZE]
    small = [o for o in single if _size(o) < LEAST_SIZE]
    plain = [o for o in single if (score.times_detectable(o) or 0.0) >= PLAIN]
    held = [ok for o in hiding for ok in score.bounds_hold(o)]
    stated = [pair for o in outcomes for pair in score.stated_and_right(o)]
    return [
        _share("names that are given are right", ">= 98 %, >= 97 %", given),
        _count("false names with nothing hidden", "<= 1 of 200, of 100", map(score.false_names, none)),
        _share("verdict none with nothing hidden", ">= 95 %, >= 90 %", (o.get("verdicts") == ["none"] for o in none)),
        _share("one effect of twice what was stated to be detectable, and more: exactly right", ">= 95 %, >= 90 %",
               map(score.exactly_right, plain)),
        _share("names exactly right, one effect of 0.2 x its typical size and more", ">= 88 %, -",
               map(score.exactly_right, large)),
        _share("the same at 0.05 x", "-", map(score.exactly_right, small)),
        _share("both of a pair named", ">= 88 %, -", map(score.all_named, several)),
        _share("pairs with a spurious name beside them", "<= 3 %, -", (bool(score.spurious(o)) for o in several)),
        _share("all of a triple named", ">= 65 %, -", map(score.all_named, triple)),
        _share("an effect left out of the catalogue ends as unknown or an honest tie", ">= 92 %, >= 85 %",
               map(score.abstained_honestly, removed)),
        _share("a system outside the catalogue ends as unknown or a tie", "100 %",
               map(score.outside_honestly, _of(outcomes, "outside"))),
        _quantile("held-out power left, named or provisional, effects that a voltage predicts: median",
                  "<= 1 %, <= 2 %", left, 0.5),
        _quantile("the same: 90th percentile", "<= 15 %, <= 25 %", left, 0.9),
        _share("true size inside the 95 % interval of a name", "90 to 98 %, 88 to 98 %",
               (ok for o in hiding for ok in score.intervals_hold(o))),
        _share("true size inside the bound where a hidden effect was missed", ">= 95 %", held),
        _share("names stated with a probability of 0.99 and more that are right", "within 5 points of what was stated",
               (right for p, right in stated if p >= SURE)),
        _mean("mean of what was stated there", "-", [p for p, _ in stated if p >= SURE]),
        _share("one proposed experiment resolves a tie", ">= 80 % of 30, -", again),
        _mean("mean of the chance that was stated there", "-", chances),
        _share("ties of the truth for which a sensor was asked, and no experiment", "-", asked),
        _share("names exactly right on sines alone, 0.2 x and more", "-",
               (score.exactly_right(o) for o in sines if _size(o) >= LEAST_SIZE)),
        _share("one kind of excitation alone: the truth named, or in an honest tie, 0.2 x and more", "-",
               (_one_right(o) for o in _of(outcomes, "narrow") if _size(o) >= LEAST_SIZE)),
        *_without_references(outcomes),
        _share("names exactly right in closed loop", "-", map(score.exactly_right, _of(outcomes, "closed_loop"))),
        _share("cross-coupling named on three axes, 0.2 x and more", "-",
               (score.exactly_right(o) for o in _of(outcomes, "coupling") if _size(o) >= LEAST_SIZE)),
        _count("wrong names from data too poor to tell", "0", (bool(score.spurious(o)) for o in poor)),
        {"what": "processor time for 60 s of one-axis 5 kHz data, median", "target": "<= 30 s", "unit": "s",
         "reached": float(np.median(times)) if times else None, "of": len(times)},
    ]  # fmt: skip


def _without_references(outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
    """Of cases whose base may be wrong: nothing false, and what is given beside that."""
    found = []
    for kind, base in (("unreferenced", "without reference records"), ("straight", "from a straight line")):
        of_kind = _of(outcomes, kind)
        large = [o for o in of_kind if score.alone_hidden(o) and _size(o) >= LEAST_SIZE]
        found += [
            _share(f"{base}: right, a tie with what is there, or unknown", "100 %", map(score.nothing_false, of_kind)),
            _share(f"{base}: what is hidden named, or in an honest tie, 0.2 x and more", "-",
                   (score.credit(score.alone_hidden(o)[0]["name"], score.claims(o)) > 0 for o in large)),
            _share(f"{base}: names right, beside those that such stages have", "-",
                   (right for o in of_kind for right in score.names_beyond(o))),
        ]  # fmt: skip
    return found


def _predictable(outcome: Outcome) -> bool:
    """Whether a voltage predicts all that is hidden."""
    return all(map(score.predictable, score.hidden_names(outcome)))


def _share(what: str, target: str, values: Iterable[float | bool]) -> dict[str, Any]:
    found = [float(v) for v in values]
    reached = 100 * float(np.mean(found)) if found else None
    return {"what": what, "target": target, "unit": "%", "reached": reached, "of": len(found)}


def _count(what: str, target: str, values: Iterable[bool]) -> dict[str, Any]:
    found = list(values)
    return {"what": what, "target": target, "unit": "", "reached": sum(found) if found else None, "of": len(found)}


def _quantile(what: str, target: str, values: Sequence[float], at: float) -> dict[str, Any]:
    reached = 100 * float(np.quantile(values, at)) if values else None
    return {"what": what, "target": target, "unit": "%", "reached": reached, "of": len(values)}


def _mean(what: str, target: str, values: Sequence[float]) -> dict[str, Any]:
    reached = 100 * float(np.mean(values)) if values else None
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
    "unreferenced": score.nothing_false,
    "straight": score.nothing_false,
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
