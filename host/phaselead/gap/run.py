"""The gap workflow from stage and records to the result: every axis searched, one answer."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from phaselead.control import are_designed, own_loop_warnings
from phaselead.gap.adopt import next_stage
from phaselead.gap.axis import AxisResult, search_axis
from phaselead.gap.effect_search import Progress
from phaselead.gap.error_rates import ERROR_RATE
from phaselead.gap.findings import PROVISIONAL, Cell, GapSize
from phaselead.gap.locate import axis_cells
from phaselead.gap.records import GapRun, axis_runs
from phaselead.gap.result import GapResult
from phaselead.gap.scale import beside_model, model_doubts, refuse_moved_at_rest, refuse_unlike_model
from phaselead.gap.several_axes import search_together
from phaselead.gap.verify_on import verify_on
from phaselead.model import Effect, Stage, catalogue
from phaselead.record import Recording, glitch_doubts


def run_gap(
    stage: Stage,
    train: Sequence[Recording],
    holdout: Sequence[Recording],
    reference: Sequence[Recording] = (),
    *,
    frozen: bool | None = None,
    without: tuple[str, ...] = (),
    on_progress: Progress | None = None,
) -> GapResult:
    """Find where ``stage`` and the records disagree, name what is missing, and add it.

    The records have the same axes and sampling rate. ``reference`` records are known to be without what is missing.
    ``frozen``: whether the base may not be refitted; by default it may not where there are ``reference`` records to
    hold it. ``without``: effects to leave out of the catalogue.
    ``on_progress`` takes the share that is done, 0 to 1. Raises BadInput, one line, for records that cannot be used.
    """
    began = time.monotonic()
    report = on_progress or (lambda share: None)
    runs = axis_runs(stage, train, holdout, reference)
    refuse_moved_at_rest(stage, runs)
    driven = beside_model(stage, runs)
    refuse_unlike_model(driven)
    doubts = (
        *glitch_doubts([*train, *holdout, *reference]),
        *model_doubts(stage, driven),
        *_provisional_doubts(stage, list(runs)),
    )
    base_frozen = frozen if frozen is not None else bool(reference)
    effects = [effect for effect in catalogue(without).values() if not effect.of_base]
    # The matrices are small: threads that wait for each other cost ten times what they save.
    with threadpool_limits(1, "blas"):
        results = search_together(stage, runs, holdout, reference, effects, frozen, report)
        if results is None:
            results = _each_axis(stage, runs, effects, base_frozen, report)
    report(1.0)
    after = next_stage(stage, {r.axis: r.model for r in results}, [*train, *reference])
    found = _joined(results, after, tuple(dict.fromkeys(r.sha256 for r in holdout)), time.monotonic() - began)
    doubts = (*doubts, *(doubt for result in results for doubt in result.doubts), *_gains_that_stay(stage, after))
    found = replace(found, messages=(*found.messages, *_about_drift(found, runs)))
    parts = {"train": train, "holdout": holdout, "reference": reference}
    sources = {name: tuple(r.traced for r in part) for name, part in parts.items()}
    return replace(found, base=stage, doubts=doubts, sources=sources)


def _about_drift(found: GapResult, runs: Mapping[str, Sequence[GapRun]]) -> list[str]:
    """From when an adopted drift counts, where that is not the 0 s of each file."""
    later = [run for of_axis in runs.values() for run in of_axis if run.role != "reference" and run.later_s > 0]
    known = catalogue()
    drifts = [one.name for one in found.adopted if known[one.name].moves_zero == "steadily"]
    if not later or not drifts:
        return []
    return [
        f"{drifts[0]} counts from the first training or held-out record, by when each was taken (t0_utc); `verify` and "
        "`predict` count every file from its own 0 s"
    ]


def _gains_that_stay(before: Stage, after: Stage) -> list[str]:
    """What the next model says against gains that were chosen or tuned, of axes that it changed and did not before."""
    known = own_loop_warnings(before, force=True)
    axes = {name: axis for name, axis in after.axes.items()
            if axis != before.axes.get(name) and axis.gains is not None and not are_designed(axis.gains)}  # fmt: skip
    lines = own_loop_warnings(after.model_copy(update={"axes": axes}), force=True)
    return [
        f"{line}: its gains were chosen or tuned before; `phaselead tune` measures new ones"
        for line in lines if line not in known
    ]  # fmt: skip


def _provisional_doubts(stage: Stage, axes: Sequence[str]) -> list[str]:
    """One line for each axis whose model has effects that no records vouched for: they hide what they stand for."""
    unsure = {axis: [e.name for e in stage.axes[axis].effects if e.status == PROVISIONAL] for axis in axes}
    return [
        f"{axis}: the model holds {', '.join(names)} provisionally, a name that no records vouch for, and only what "
        "changed since is looked for; to look for what it is, run gap with the model from before it was adopted"
        for axis, names in unsure.items() if names
    ]  # fmt: skip


def verified_on(port: str, base: Stage, result: GapResult, on_progress: Progress | None = None) -> GapResult:
    """The result with how well the device at ``port`` tracks under ``base``, which was compared, and the next stage."""
    return replace(result, verification=verify_on(port, base, result.stage, on_progress))


def _joined(results: Sequence[AxisResult], stage: Stage, holdout_sha256: tuple[str, ...], seconds: float) -> GapResult:
    """One result of all axes; ``stage`` is the one with what was found."""
    return GapResult(
        stage=stage,
        verdicts=_verdicts(results),
        effects=tuple(sorted((e for r in results for e in r.effects), key=lambda e: -e.share)),
        ties=tuple(t for r in results for t in r.ties),
        excluded=tuple(b for r in results for b in r.excluded),
        untestable=_untestable(results),
        where=_where(results),
        gap=_gap(results),
        next_experiment=next((r.next_experiment for r in results if r.next_experiment is not None), None),
        holdout_sha256=holdout_sha256,
        candidates=tuple(c for r in results for c in r.candidates),
        spans_s={r.axis: tuple(r.spans_s) for r in results},
        traces=tuple(t for r in results for t in r.traces),
        spectra=tuple(s for r in results for s in r.spectra),
        untestable_why={name: why for r in results for name, why in r.untestable.items()},
        messages=tuple(m for r in results for m in r.messages),
        seconds=seconds,
        adopted=tuple(a for r in results for a in r.adopted),
        detectable=tuple(d for r in results for d in r.detectable),
        unexplained=max(
            (r.unexplained for r in results),
            key=lambda left: (left.something_missing and not left.of_equations, left.share - left.chance),
        ),
    )


def _each_axis(
    stage: Stage,
    runs: Mapping[str, Sequence[GapRun]],
    effects: Sequence[Effect],
    base_frozen: bool,
    report: Progress,
) -> list[AxisResult]:
    """Every axis searched by itself."""
    results = []
    for i, (axis, of_axis) in enumerate(runs.items()):

        def advance(share: float, done: int = i) -> None:
            report((done + share) / len(runs))

        found = search_axis(axis, stage.axes[axis], of_axis, effects, base_frozen, advance)
        results.append(_of_several(found) if len(runs) > 1 else found)
    return results


def _of_several(result: AxisResult) -> AxisResult:
    """The result of one axis where there are others, which says of what it speaks."""
    messages, doubts = ([f"{result.axis}: {line}" for line in lines] for lines in (result.messages, result.doubts))
    return replace(result.labelled(), messages=messages, doubts=doubts)


def _where(results: Sequence[AxisResult]) -> tuple[Cell, ...]:
    """Cells of all axes, those that stand out first. With several axes a share is of its own axis' power."""
    errors = {r.axis: [t.measured_um - t.before_um for t in r.traces] for r in results}
    cells = [*axis_cells(errors, {r.axis: r.gap.floor for r in results}), *(c for r in results for c in r.where)]
    return tuple(sorted(cells, key=lambda c: (c.p > ERROR_RATE, -c.share)))


def _verdicts(results: Sequence[AxisResult]) -> tuple[str, ...]:
    """The verdicts that hold on any axis; "none" where no other does."""
    holds = {
        "named": any(r.effects for r in results),
        "tie": any(r.ties for r in results),
        "unknown": any(r.unknown for r in results),
    }
    return tuple(verdict for verdict in holds if holds[verdict]) or ("none",)


def _untestable(results: Sequence[AxisResult]) -> tuple[str, ...]:
    """Effects that no axis could test: one named, tied or bounded on any axis was tested."""
    tested = {e.name for r in results for e in r.effects} | {n for r in results for t in r.ties for n in t}
    tested |= {b.name for r in results for b in r.excluded}
    names = dict.fromkeys(name for r in results for name in r.untestable)
    return tuple(name for name in names if name not in tested)


def _gap(results: Sequence[AxisResult]) -> GapSize:
    """RMS over the held-out rows of all axes."""
    rows = sum(r.rows for r in results)

    def pooled(values: Sequence[float]) -> float:
        return float(np.sqrt(sum(v**2 * r.rows for v, r in zip(values, results, strict=True)) / rows))

    return GapSize(
        pooled([r.gap.before for r in results]),
        pooled([r.gap.after for r in results]),
        pooled([r.gap.floor for r in results]),
        "um",
        _floor_from(results),
        all(r.gap.floor_is_after for r in results),
    )


def _floor_from(results: Sequence[AxisResult]) -> str:
    """What the floor is, with the axes where it is not the same on all."""
    axes: dict[str, list[str]] = {}
    for r in results:
        axes.setdefault(r.gap.floor_from, []).append(r.axis)
    if len(axes) == 1:
        return next(iter(axes))
    return "; ".join(f"on {', '.join(of_axes)} {floor_from}" for floor_from, of_axes in axes.items())
