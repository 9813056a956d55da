"""The search from the bare base to the last effect that pays: one step after the other, then pruning."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import norm

from phaselead.gap.base import with_operator
from phaselead.gap.bench import Bench, bench, beside, slim_beside
from phaselead.gap.compare import HELD_OUT_Z, MARGIN, Contest, HeldOut, Rival, contest, held_out, known_before
from phaselead.gap.records import Run
from phaselead.gap.refit import Entry, Fitted, refit, with_total
from phaselead.gap.result import NAMED, Candidate
from phaselead.gap.search import Scanned, no_mode_of_its_own, penalty, scan, try_effects
from phaselead.model import AxisModel, Effect

MOST_EFFECTS = 5
SECOND_CHOICES = 2
"""How many effects may fail on held-out records before a step is given up."""
SLOPE = (0.4, 2.5)
"""Share of what an effect says that held-out records must show of it."""
UNTESTED = 10.0
"""Times the usual margin, for an effect that the held-out records lack the drive to show: a mode without a jump."""
LACKING = 0.05
"""Of what an effect gains on training records: held-out records whose drive would show less of it lack that drive."""
HARM, PLAIN_Z = 0.01, 10.0
"""An effect may raise the held-out mean square by this share and no more: a disturbance that is not there does. From
this z on it is there."""
NEAR_SHARE, FAR_SHARE, OPERATOR_SHARE = 0.05, 0.0015, 0.02
"""Of what was gained before, what a further effect must gain. No equation of the catalogue is the stage's own: what one
that is right by and large leaves is explained best by those it is confused with, and is no evidence for them; a whole
operator in place of the equation leaves less."""
CLOSE = 0.5
"""Of the score of what was named: an effect that explains this much by itself is alike, whatever the catalogue says."""
PLENTY_ON_ONE_LOOP = 50.0
"""Points from which an effect is told from others although all records go round one loop."""
BESIDE = 30.0
"""More points than the usual margin beside reference records, which are believed to say all that the base misses: on
trials, of 14 names for less than 60 points in all 12 were wrong."""
TRIFLE = 0.005
"""Of its typical size, below which an effect is no more than what the base's own numbers are off by."""
RISK = 0.0125
"""Family-wise risk of a held-out test (Holm over the rest of the catalogue)."""

Progress = Callable[[float], None]


@dataclass(frozen=True)
class Named:
    """One accepted effect, who could not be told from it, and how sure it is."""

    effect: Effect
    score: float
    held: HeldOut
    rivals: tuple[Rival, ...]
    tied: tuple[str, ...]
    """Names that these records cannot tell apart, its own first."""
    near_share: float = NEAR_SHARE
    """Of its score, what those it is confused with must gain."""


@dataclass
class Growth:
    """Where the search of one axis ended."""

    bench: Bench
    start: AxisModel
    """The base as given."""
    fitted: Fitted
    named: list[Named] = field(default_factory=list)
    candidates: list[Candidate] = field(default_factory=list)
    last_scan: list[list[Scanned]] = field(default_factory=list)
    inflation: float = 1.0
    messages: list[str] = field(default_factory=list)
    stood_in: str | None = None
    """An effect that was kept out of the search, because it explained most alone."""
    operator: dict[str, float] | None = None
    """Parameters under which `hysteresis` was found, when the base was given an operator for it."""


def grow(
    axis: AxisModel, runs: Sequence[Run], effects: Sequence[Effect], frozen: bool, on_progress: Progress
) -> Growth:
    """Name effects until none pays."""
    view = axis.time
    assert view is not None
    made = bench(axis, runs, effects, frozen, plain=not view.play_r_V)
    growth = Growth(made, axis, refit(made.slim, made.correction, []))
    if not view.play_r_V and not _memory(growth, runs, effects, frozen):
        made = bench(axis, runs, effects, frozen)
        growth.bench, growth.fitted = made, refit(made.slim, made.correction, [])
    for step in range(MOST_EFFECTS):
        on_progress((step + 1) / (MOST_EFFECTS + 1))
        taken = {name for n in growth.named for name in n.tied}
        left = [e for e in effects if e.name not in taken]
        growth.last_scan = scan(growth.bench, growth.fitted, left)
        if not _step(growth, runs, effects, left, frozen, step + 1):
            break
    _prune(growth)
    return growth


def unnamed(growth: Growth) -> Growth:
    """The search without what it named, where that leaves too much: the nearest of the catalogue is not the effect."""
    bare = beside(growth.bench, [])
    names = " and ".join(n.effect.name for n in growth.named)
    said = f"{names} would come nearest, but leaves too much of what is new since the reference to be it"
    return replace(
        growth,
        bench=bare,
        fitted=refit(bare.slim, bare.correction, []),
        named=[],
        candidates=[
            replace(c, remark="nearest, but leaves too much") if c.remark == NAMED else c for c in growth.candidates
        ],
        messages=[*growth.messages, said],
    )


def _memory(growth: Growth, runs: Sequence[Run], effects: Sequence[Effect], frozen: bool) -> bool:
    """Give a line its memory first, if that is what explains most of the plain error; whether it was done."""
    growth.last_scan = scan(growth.bench, growth.fitted, effects)
    tried = try_effects(growth.bench, growth.fitted, growth.last_scan)
    if not tried:
        return False
    found = contest(growth.bench, growth.fitted, tried)
    held = _held_out(found)
    pays = found.best.effect.name == "hysteresis" and _pays(found, held, len(effects))
    if pays:
        _note(growth, found, held, 0, pays)
        _accept(growth, found, held, runs, effects, frozen)
    return pays


def _step(
    growth: Growth, runs: Sequence[Run], effects: Sequence[Effect], left: Sequence[Effect], frozen: bool, step: int
) -> bool:
    """Try to name one more; whether it was."""
    tried = try_effects(growth.bench, growth.fitted, growth.last_scan)
    for _ in range(SECOND_CHOICES):
        if not tried:
            return False
        found = contest(growth.bench, growth.fitted, tried)
        held = _held_out(found)
        pays = _pays(found, held, len(left), growth.named)
        _note(growth, found, held, step, pays)
        if pays:
            _accept(growth, found, held, runs, effects, frozen)
            return True
        if found.best.score < MARGIN:
            return False
        tried = [t for t in tried if t.effect is not found.best.effect]
    return False


def _held_out(found: Contest) -> HeldOut:
    least = found.bench.mistaken.get(found.best.effect.name, 1.0)
    return held_out(found.bench, found.before.entries, found.best.fitted.entries, least)


def cost(named: Sequence[Named], effect: Effect) -> float:
    """Score from which a further effect is more than what the equations of those named before leave."""
    owed = [n.score * (n.near_share if _alike(n, effect) else FAR_SHARE) for n in named]
    return MARGIN + sum(owed)


def _needed(found: Contest, named: Sequence[Named]) -> float:
    return cost(named, found.best.effect) + (BESIDE if found.bench.reference is not None else 0.0)


def _alike(named: Named, effect: Effect) -> bool:
    rivals = {r.effect.name: r for r in named.rivals}
    if effect.name in rivals and rivals[effect.name].score > CLOSE * named.score:
        return True
    group = [named.effect, *(rivals[name].effect for name in named.tied if name in rivals)]
    return any(effect.name in one.confused_with or one.name in effect.confused_with for one in group)


def _pays(found: Contest, held: HeldOut, family: int, named: Sequence[Named] = ()) -> bool:
    needed = _needed(found, named)
    if no_mode_of_its_own(found.bench, found.best.fitted.entries[-1]) or _trifling(found.best.fitted.entries[-1]):
        return False
    if _harms(found, held) or known_before(found.bench, found.best.fitted.entries[-1]):
        return False
    if not held.testable:
        lacking = held.drive < LACKING * found.best.score
        return lacking and found.best.score >= needed + (UNTESTED - 1) * MARGIN and not held.contradicted
    p = float(norm.sf(held.z))
    sure = held.z >= HELD_OUT_Z and p * family <= RISK
    return found.best.score >= needed and sure and SLOPE[0] <= held.slope <= SLOPE[1]


def _trifling(entry: Entry) -> bool:
    """Whether every one of its sizes is next to nothing."""
    effect, params = entry
    return all(abs(params[p.name]) < TRIFLE * p.typical for p in effect.sizes)


def _harms(found: Contest, held: HeldOut) -> bool:
    """Whether it makes the held-out gap larger, and is not plainly there all the same: of two effects that work against
    each other the first does. Only beside reference records, which tell in the end whether the names explain it, and
    not for a drift, which follows whatever moves slowly."""
    responds = found.best.effect.kind != "disturbance"
    plainly = responds and found.bench.reference is not None and held.z > PLAIN_Z
    return held.worse > HARM and not plainly


def _accept(
    growth: Growth, found: Contest, held: HeldOut, runs: Sequence[Run], effects: Sequence[Effect], frozen: bool
) -> None:
    best = found.best
    tied = (*(r.effect.name for r in found.tied()), *_uncompared(growth, found, effects))
    view = growth.bench.axis.time
    assert view is not None
    equation = best.effect.name != "hysteresis" or bool(view.play_r_V)
    near_share = NEAR_SHARE if equation else OPERATOR_SHARE
    rivals = tuple(replace(r, fitted=with_total(found.bench.slim, r.fitted)) for r in found.rivals)
    growth.named.append(Named(best.effect, best.score, held, rivals, tied, near_share))
    growth.inflation = found.inflation
    if equation:
        growth.bench = beside(found.bench, best.fitted.entries)
        growth.fitted = refit(growth.bench.slim, growth.bench.correction, best.fitted.entries)
        return
    # A base of a line gets the whole operator, not the catalogue's compact one.
    growth.operator = dict(best.fitted.entries[-1][1])
    axis = with_operator(growth.bench.axis, [r for r in runs if r.role == "train"])
    growth.bench = bench(axis, runs, effects, frozen, open_plays=True)
    others = list(best.fitted.entries[:-1])
    growth.fitted = refit(growth.bench.slim, growth.bench.correction, others)


def _uncompared(growth: Growth, found: Contest, effects: Sequence[Effect]) -> list[str]:
    """Where all records go round one loop and little is gained: what the best is confused with and what fell out before
    it was refitted. One loop does not rule it out."""
    best = found.best.effect
    if not found.one_loop or found.best.score > PLENTY_ON_ONE_LOOP:
        return []
    compared = {r.effect.name for r in found.rivals}
    shown = {shapes[0].effect.name for shapes in growth.last_scan}
    near = [e for e in effects if e.name in best.confused_with or best.name in e.confused_with]
    return [e.name for e in near if e.name in shown - compared]


def _prune(growth: Growth) -> None:
    """Drop what no longer pays beside the others. What the base can absorb is simulated without it: seen through an
    effect, the base's own columns carry some of it."""
    for name in [n.effect.name for n in growth.named if any(e.name == n.effect.name for e, _ in growth.fitted.entries)]:
        entries = [entry for entry in growth.fitted.entries if entry[0].name != name]
        if not entries:
            return
        without = refit(slim_beside(growth.bench, entries), growth.bench.correction, entries)
        effect = next(n.effect for n in growth.named if n.effect.name == name)
        gained = (without.squares - growth.fitted.squares) / growth.inflation - penalty(growth.bench, effect)
        if gained < MARGIN:
            growth.bench = beside(growth.bench, without.entries)
            growth.fitted = refit(growth.bench.slim, growth.bench.correction, without.entries)
            growth.named = [n for n in growth.named if n.effect.name != name]


def _note(growth: Growth, found: Contest, held: HeldOut, step: int, pays: bool) -> None:
    rows = sum(e[-1] for e in found.bench.slim.evidence.edges)
    for rival in found.rivals:
        best = rival is found.best
        if best:
            remark = NAMED if pays else _why_not(found, held, growth.named)
        elif found.is_tied(rival):
            remark = f"these records cannot tell it from {found.best.effect.name}"
        else:
            remark = f"{found.best.score - rival.score:.0f} points behind {found.best.effect.name}"
        rms = float(np.sqrt(rival.fitted.squares / rows))
        z = held.z if best else float("nan")
        growth.candidates.append(Candidate(step, rival.effect.name, rival.score, z, rms, remark))


def _why_not(found: Contest, held: HeldOut, named: Sequence[Named]) -> str:
    if found.best.score < (needed := _needed(found, named)):
        return f"gains {found.best.score:.1f}, less than the {needed:.3g} a name costs"
    if _trifling(found.best.fitted.entries[-1]):
        return f"gains {found.best.score:.0f}, but is far smaller than what is known to occur"
    if _harms(found, held):
        return f"gains {found.best.score:.0f}, but makes the held-out gap larger"
    if known_before(found.bench, found.best.fitted.entries[-1]):
        return f"gains {found.best.score:.0f}, but the reference records show it too"
    if not held.testable:
        return f"gains {found.best.score:.0f}, but the held-out records cannot show it"
    return f"does not hold on held-out records (z = {held.z:.1f}, {100 * held.slope:.0f} % of it found there)"
