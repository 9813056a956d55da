"""The page of the gap workflow: where model and stage disagree, what is missing, why, and what to do next."""

from __future__ import annotations

import math
import shlex
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.signal import welch

from phaselead.drawing import BLUE, GREEN, GREY, RED, figure_style, new_figure, thin
from phaselead.gap import (
    ERROR_RATE,
    MOST_STATED,
    NAMED,
    PROVISIONAL,
    Bound,
    Candidate,
    Cell,
    GapResult,
    NamedEffect,
    NextExperiment,
    Spectrum,
    Trace,
    TrackedPath,
    TrackingComparison,
    excludes,
    explained,
    parameter_rows,
    typical_of,
    unit_of,
)
from phaselead.gap import headline as cells_headline
from phaselead.model import catalogue
from phaselead.quantity import digits
from phaselead.record import Samples
from phaselead.report.origin import Origin, of_stage
from phaselead.report.page import render
from phaselead.report.wording import begun, effect_title, in_prose, listed

MOST_TRACES = 4
"""That the page shows, those with the largest gap first."""
SIZES_ON_CARD = 2
"""Parameters of the first effect."""
MOST_SILENT = 4
"""Effects that a headline names as not tested."""
NEAR_FLOOR = 1.1
"""Times the floor up to which the page says with the rest what the floor is."""
USUAL_UNITS = {"s": ("ms", 1e3), "um": ("nm", 1e3), "V": ("mV", 1e3)}
"""The next smaller unit, and how many of it make one."""
DENSITY_SEGMENT = 8192
"""Rows of one periodogram."""
_USES = {
    "train": "Recordings it learned from",
    "holdout": "Held-out recordings: every figure of the gap is of these",
    "reference": "Reference recordings, without what is missing",
}


def gap_page(result: GapResult, model_name: str, json_name: str = "gap.json") -> str:
    """The page as HTML. ``json_name`` is the file of the next experiment."""
    return render(
        "gap.html",
        digits=digits,
        begun=begun,
        model_name=model_name,
        headline=headline(result),
        unknown="unknown" in result.verdicts,
        cards=cards(result),
        cells=standing_out(result.where),
        cells_figure=cells_figure(result.where) if result.where else None,
        effects=[
            effect_part(effect, parameter_rows(result.sizes_of(effect))) | {"words": in_prose(result.in_words(effect))}
            for effect in result.effects
        ],
        ties=[tie_part(tie) for tie in result.ties],
        provisional=listed([effect_title(name) for name in result.provisional]) if result.provisional else "",
        unexplained=result.unexplained,
        unexplained_sentence=result.unexplained_sentence,
        advice=result.advice,
        candidates=candidate_rows(result.candidates, {effect.name for effect in result.effects}, result.ties),
        traces=[{"name": t.source, "axis": t.axis, "figure": trace_figure(t)} for t in _largest(result.traces)],
        spectra=[{"name": begun(effect_title(s.name)), "figure": spectrum_figure(s)} for s in result.spectra],
        remains=remains(result),
        doubts=result.doubts,
        messages=[in_prose(message) for message in (*result.remarks, *result.messages)],
        residual_figure=residual_figure(result.traces) if result.traces else None,
        excluded=[bound_row(bound, result) for bound in result.excluded if excludes(bound)],
        possible=[bound_row(bound, result) for bound in result.excluded if not excludes(bound)],
        next_command=next_command(json_name, model_name),
        untestable=[
            {"name": begun(effect_title(n)), "why": in_prose(result.why_untestable(n))} for n in result.untestable
        ],
        experiment=result.next_experiment,
        apart=told_apart(result.next_experiment) if result.next_experiment else "",
        tracking=tracking_part(result.verification) if result.verification else None,
        origin=Origin(
            {_USES[part]: sources for part, sources in result.sources.items()},
            [of_stage(result.compared, "Compared was the stage file"), of_stage(result.stage, "The next one is")],
        ),
        seconds=result.seconds,
    )


def next_command(json_name: str, model: str) -> str:
    """The command that records the proposed experiment; with the model, where that is a file, it asks before it drives
    a mode."""
    of_model = ["--model", model] if model.endswith(".toml") else []
    return shlex.join(["phaselead", "gap", "next", json_name, *of_model, "--port", "P", "-o", "more.h5"])


def headline(result: GapResult) -> str:
    """The answer in a sentence or two."""
    said = [f"These records cannot tell apart: {listed([effect_title(n) for n in tie], 'or')}." for tie in result.ties]
    if result.effects:
        lacks = "The model lacks: " + listed([_title(e) for e in result.effects]) + "."
        said.insert(len(said) if _ties_first(result) else 0, lacks)
    if "unknown" in result.verdicts:
        said.append("Something remains that no name is sure to explain.")
    if not said:
        nothing = "Nothing was found that is not among the known errors of the base model."
        return " ".join([nothing, *_silent_about(result.untestable)])
    where = cells_headline(result.where)
    return " ".join([*said, f"{where}."] if where else said)


def _silent_about(untestable: Sequence[str]) -> list[str]:
    """That nothing was found says nothing of what the records do not test."""
    if not untestable:
        return []
    titles = [effect_title(name) for name in untestable[:MOST_SILENT]]
    more = len(untestable) - len(titles)
    return [f"These records say nothing of {listed([*titles, *([f'{more} more'] if more else [])])}."]


def _ties_first(result: GapResult) -> bool:
    """Whether the best member of a tie, which the next model has, explains more than any effect that is named."""
    tied = {tie[0] for tie in result.ties}
    has = [e for axis in result.stage.axes.values() for e in axis.effects if e.name in tied]
    shares = [effect.share for effect in result.effects]
    return any(e.status == PROVISIONAL and (e.share or 0.0) > max(shares, default=0.0) for e in has)


def _title(effect: NamedEffect) -> str:
    return f"{effect_title(effect.name)} on axis {effect.axis}" if effect.axis else effect_title(effect.name)


def cards(result: GapResult) -> list[dict[str, str]]:
    """The figures a reader looks for first."""
    gap = result.gap
    return [
        verdict_card(result),
        {"value": f"{gap.before:.3g} µm", "label": "gap before, rms over the held-out records"},
        {"value": f"{gap.after:.3g} µm", "label": f"gap after{_below_floor(result)}"},
        {"value": f"{gap.floor:.3g} µm", "label": f"floor: {gap.floor_from}"},
    ]


def verdict_card(result: GapResult) -> dict[str, str]:
    """What is missing, by name and size; ties first where they explain more than any name."""
    sure = f"verdict: {', '.join(result.verdicts)}"
    alike = [listed([effect_title(n) for n in tie], "or") for tie in result.ties]
    if result.effects:
        first, *others = result.effects
        size = ", ".join(sizes_of(first))
        more = f", and {listed([_title(e) for e in others])}" if others else ""
        if _ties_first(result):
            return {"value": begun("; ".join(alike)), "label": f"beside them {_title(first)}, {size}{more}; {sure}"}
        return {"value": begun(_title(first)), "label": f"{size}{more}; {sure}"}
    if alike:
        return {"value": begun("; ".join(alike)), "label": sure}
    if "unknown" in result.verdicts:
        return {"value": "Something unnamed", "label": sure}
    untested = f"; {len(result.untestable)} effects could not be tested" if result.untestable else ""
    return {"value": "Nothing was found", "label": f"{sure}{untested}"}


def sizes_of(effect: NamedEffect) -> list[str]:
    """Its parameters in the units that a person uses, of a low-pass its corner too: "0.503 ms", "317 Hz". Those that
    have a unit in common are named: "top 0.05 of voltage range"."""
    found, rows = [], parameter_rows(effect.params)[:SIZES_ON_CARD]
    units = [unit for *_, unit in rows]
    for name, value, _, _, unit in rows:
        called = f"{_without_unit(name, unit)} " if units.count(unit) > 1 else ""
        found.append(called + in_usual_unit(value, unit))
        if name == "tau_s" and effect.name.endswith("lowpass") and value > 0:
            found.append(in_usual_unit(1 / (2 * math.pi * value), "Hz"))
    return found


def in_usual_unit(value: float, unit: str) -> str:
    """With three digits; below 1 in the next smaller unit."""
    factor, unit = usual_unit(value, unit)
    return f"{digits(value * factor, 3)} {unit}" if unit != "1" else digits(value, 3)


def usual_unit(value: float, unit: str) -> tuple[float, str]:
    """The unit that a person uses of a value in ``unit``, and how many of it make one of that."""
    smaller, factor = USUAL_UNITS.get(unit, (unit, 1.0))
    return (factor, smaller) if 0 < abs(value) < 1 else (1.0, unit)


def _without_unit(name: str, unit: str) -> str:
    """What a parameter, or one of several of a name, is called beside its unit."""
    plain, blank, number = name.partition(" ")
    return f"{plain.removesuffix(f'_{unit}')}{blank}{number}"


def scaled_row(name: str, value: float, low: float, high: float, unit: str) -> dict[str, Any]:
    """A parameter and its interval in a unit that a person uses; a unit that its name ends in is not said twice."""
    factor, shown = usual_unit(value, unit)
    return {
        "name": _without_unit(name, unit),
        "value": factor * value,
        "low": factor * low,
        "high": factor * high,
        "unit": shown,
    }


def _below_floor(result: GapResult) -> str:
    """The floor is of other records or of the noise, and a model can do better by chance."""
    gap = result.gap
    below = gap.after <= gap.floor and not gap.floor_is_after
    return ", no more than the floor, which other records set" if below else ""


def remains(result: GapResult) -> str:
    """How much of the gap remains, in words."""
    gap = result.gap
    if not result.adopted and gap.after == gap.before:
        return "Nothing was adopted: the gap is as it was."
    if gap.floor_is_after:
        left = 100 * (gap.after / gap.before) ** 2 if gap.before > 0 else 0.0
        return (
            f"{left:.1f} % of the unexplained power remains on the held-out records. How much of that is noise is not "
            f"known, since the floor is {gap.floor_from}."
        )
    before, after = gap.before**2 - gap.floor**2, gap.after**2 - gap.floor**2
    if before <= 0:
        return "The gap was at its floor from the start."
    left = 100 * max(after, 0.0) / before
    beside = " The floor is measured on other records, which the model fits less well." if after < 0 else ""
    near = f" The floor is {gap.floor_from}." if gap.floor_from and gap.after <= NEAR_FLOOR * gap.floor else ""
    return f"{left:.1f} % of the power above the floor remains on the held-out records.{beside}{near}"


def effect_part(effect: NamedEffect, sizes: Sequence[tuple[str, float, float, float, str]]) -> dict[str, Any]:
    """One named effect for the template; ``sizes`` are rows of its parameters and of what they come to."""
    entry = catalogue().get(effect.name)
    rows = [scaled_row(*row) for row in sizes]
    return {
        "title": begun(_title(effect)), "name": effect.name, "share": explained(effect), "why": effect.why,
        "rows": rows, "probability": f"{effect.probability:.3g}",
        "equation": in_prose(entry.equation) if entry else "", "shows": in_prose(entry.shows) if entry else "",
        "compensation": in_prose(entry.compensation) if entry else "", "source": entry.source if entry else "",
    }  # fmt: skip


def tie_part(tie: tuple[str, ...]) -> dict[str, str]:
    """One tie for the template."""
    known = catalogue()
    reveals = "; ".join(f"{effect_title(n)}: {known[n].reveals}" for n in tie if n in known)
    return {"names": listed([effect_title(n) for n in tie], "or"), "adopted": effect_title(tie[0]), "reveals": reveals}


def told_apart(experiment: NextExperiment) -> str:
    """What an experiment decides between, in words."""
    names = experiment.tells_apart
    return listed([effect_title(n) for n in names]) if names else "the powers of the level by which softening may grow"


def candidate_rows(
    candidates: Sequence[Candidate], named: Collection[str], ties: Sequence[tuple[str, ...]] = ()
) -> list[dict[str, Any]]:
    """Every candidate, the best first; what of it is ``named``, and what leads a tie, where that is not all of it."""
    return [
        {
            "step": c.step, "name": " + ".join(effect_title(n) for n in c.name.split(" + ")), "score": c.score,
            "remark": _best(c.name.split(" + "), named, ties) if c.remark == NAMED else c.remark,
        }
        for c in candidates
    ]  # fmt: skip


def _best(names: Sequence[str], named: Collection[str], ties: Sequence[tuple[str, ...]]) -> str:
    """What is said of the best set."""
    if set(names) <= set(named):
        return NAMED
    leading = {tie[0] for tie in ties}
    said = {"named": [n for n in names if n in named], "in a tie": [n for n in names if n in leading]}
    each = [f"{listed([effect_title(n) for n in sorted(of)])} {what}" for what, of in said.items() if of]
    return "; ".join(["most probable", *each])


def _largest(traces: Sequence[Trace]) -> list[Trace]:
    """The held-out records with the largest gap before."""
    return sorted(traces, key=lambda t: -float(np.std(t.measured_um - t.before_um)))[:MOST_TRACES]


def trace_figure(trace: Trace) -> Figure:
    """Measurement and model above, the residuals before and after below."""
    measured_um, after_um = trace.measured_um, trace.after_um
    t, x, after, left_before, left_after = thin(
        trace.t_s, measured_um, after_um, measured_um - trace.before_um, measured_um - after_um
    )
    with figure_style():
        figure = new_figure(9.4, 6.4)
        upper, middle, lower = figure.subplots(3, 1, sharex=True, height_ratios=[1, 1.1, 1.1])
        upper.plot(t, x, color=GREY, linewidth=2.4, alpha=0.6, label="measured")
        upper.plot(t, after, color=BLUE, linewidth=1.0, label="model after")
        middle.plot(t, left_before, color=RED, linewidth=0.9, label="before")
        for axes in (middle, lower):
            axes.plot(t, left_after, color=BLUE, linewidth=0.9, label="after")
            axes.set(ylabel="measured − model (µm)")
        upper.set(ylabel="position (µm)")
        lower.set(xlabel="time (s)")
        lower.set_title("after, on its own scale", loc="right", fontsize=9)
        for axes in (upper, middle):
            axes.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=2)
        return figure


def tracking_part(verification: TrackingComparison) -> dict[str, Any]:
    """The runs on a device for the template: a row and a figure each."""
    rows = [
        {
            "axis": t.axis, "path": t.path, "mode": t.mode, "before": t.before.rms_um, "after": t.after.rms_um,
            "most_before": t.before.max_um, "most_after": t.after.max_um, "figure": tracking_figure(t),
        }
        for t in verification.tracked
    ]  # fmt: skip
    return {"port": verification.port, "rows": rows, "messages": verification.messages}


def tracking_figure(tracked: TrackedPath) -> Figure:
    """The reference above, the tracking error with each model below."""
    before, after = tracked.before_error_um, tracked.after_error_um
    t, r, before, after = thin(tracked.t_s, tracked.r_um, before, after)
    with figure_style():
        figure = new_figure(9.4, 4.0)
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[1, 1.6])
        upper.plot(t, r, color=GREY, linewidth=1.4, label="reference")
        lower.plot(t, before, color=RED, linewidth=0.9, label="model before")
        lower.plot(t, after, color=BLUE, linewidth=0.9, label="model after")
        upper.set(ylabel="reference (µm)")
        lower.set(xlabel="time (s)", ylabel="error (µm)")
        lower.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=2)
        return figure


def standing_out(cells: Sequence[Cell]) -> list[Cell]:
    """For each kind and axis the largest cell that stands out beyond chance."""
    found: dict[tuple[str, str | None], Cell] = {}
    for cell in sorted(cells, key=lambda c: -c.share):
        if cell.p <= ERROR_RATE:
            found.setdefault((cell.by, cell.axis), cell)
    return list(found.values())


def cells_figure(cells: Sequence[Cell]) -> Figure:
    """Shares of the cells, one panel for each kind."""
    kinds = list(dict.fromkeys(c.by for c in cells))
    rows = [[c for c in reversed(cells) if c.by == kind] for kind in kinds]
    with figure_style():
        figure = new_figure(7.4, 0.7 + 0.34 * len(cells) + 0.25 * len(kinds))
        panels = figure.subplots(len(kinds), 1, sharex=True, squeeze=False, height_ratios=[len(r) + 0.4 for r in rows])
        for axes, kind, of_kind in zip(panels[:, 0], kinds, rows, strict=True):
            labels = [f"{c.cell} ({c.axis})" if c.axis and c.cell != c.axis else c.cell for c in of_kind]
            colours = [GREEN if c.p <= ERROR_RATE else GREY for c in of_kind]
            axes.barh(range(len(of_kind)), [100 * c.share for c in of_kind], color=colours)
            axes.set_yticks(range(len(of_kind)), labels)
            axes.set_title(kind, loc="left", fontsize=10)
            axes.set_xlim(0, 100)
        panels[-1, 0].set_xlabel("share of the unexplained power (%)")
        return figure


def residual_figure(traces: Sequence[Trace]) -> Figure:
    """Amplitude density of the residual of all held-out records, before and after."""
    with figure_style():
        figure = new_figure(7.4, 3.4)
        axes = figure.add_subplot()
        for name, colour in (("before", RED), ("after", BLUE)):
            f, density = _mean_density(traces, name)
            axes.loglog(f, 1e3 * density, color=colour, linewidth=1.1, label=name)
        axes.set(xlabel="frequency (Hz)", ylabel="residual (nm/√Hz)")
        axes.legend()
        return figure


def _mean_density(traces: Sequence[Trace], which: str) -> tuple[Samples, Samples]:
    """Frequencies (k,) and amplitude density (k,) in um/sqrt(Hz), over records weighted by their length."""
    length = min(DENSITY_SEGMENT, *(len(t.t_s) for t in traces))
    total, rows, f = np.zeros(length // 2), 0, np.zeros(length // 2)
    for t in traces:
        error = t.measured_um - (t.before_um if which == "before" else t.after_um)
        rate_Hz = (len(t.t_s) - 1) / float(t.t_s[-1] - t.t_s[0])
        f, power = (part[1 : length // 2 + 1] for part in welch(error, rate_Hz, nperseg=length))
        total, rows = total + len(error) * power, rows + len(error)
    return f, np.sqrt(total / rows)


def bound_row(bound: Bound, result: GapResult) -> dict[str, Any]:
    """One upper bound beside the typical size of the effect, and the size from which it was expected to be named."""
    of_effect = [one.size for one in result.detectable if (one.name, one.axis) == (bound.name, bound.axis)]
    factor, unit = usual_unit(bound.upper_95, bound.unit)
    effect = catalogue()[bound.name]
    searched = effect.moves_zero == "steadily" or (effect.kind != "disturbance" and effect.moves_zero is None)
    stated = bool(result.detectable) and searched
    typical, nowhere = typical_of(bound), f"beyond {MOST_STATED:g} typical sizes, if at all" if stated else ""
    return {
        "name": effect_title(bound.name), "axis": bound.axis, "upper": factor * bound.upper_95,
        "typical": None if typical is None else factor * typical,
        "named_from": f"{factor * of_effect[0]:.3g}" if of_effect else nowhere, "unit": unit_of(unit),
    }  # fmt: skip


def spectrum_figure(spectrum: Spectrum) -> Figure:
    """Amplitude density of the residual of held-out and of reference records."""
    with figure_style():
        figure = new_figure(7.4, 3.4)
        axes = figure.add_subplot()
        if spectrum.reference is not None:
            axes.loglog(spectrum.f_Hz[1:], 1e3 * spectrum.reference[1:], color=GREY, label="reference records")
        axes.loglog(spectrum.f_Hz[1:], 1e3 * spectrum.seen[1:], color=BLUE, linewidth=1.0, label="held-out records")
        axes.set(xlabel="frequency (Hz)", ylabel="residual (nm/√Hz)")
        axes.legend()
        return figure
