"""The page of the gap workflow: where, what, why not the runner-up, before and after, what remains, what next."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from phaselead.effects import catalogue
from phaselead.gap.result import Candidate, GapResult, NamedEffect, Spectrum, Trace, lines
from phaselead.report.page import render
from phaselead.report.style import BLUE, GREEN, GREY, ORANGE, RED, figure_style, new_figure, thin
from phaselead.stage.file import Stage

MOST_TRACES = 4


def gap_page(result: GapResult, stage: Stage, model_name: str) -> str:
    """The page as HTML."""
    return render(
        "gap.html",
        model_name=model_name,
        headline=headline(result),
        cards=cards(result),
        cells=result.where,
        cells_figure=cells_figure(result) if result.where else None,
        effects=[effect_part(effect) for effect in result.effects],
        ties=[tie_part(tie) for tie in result.ties],
        candidates=candidate_rows(result.candidates),
        traces=[{"name": t.source, "axis": t.axis, "figure": trace_figure(t)} for t in _largest(result.traces)],
        spectra=[{"name": s.name, "figure": spectrum_figure(s)} for s in result.spectra],
        gap=result.gap,
        remains=remains(result),
        excluded=result.excluded,
        untestable=[{"name": n, "why": result.untestable_why.get(n, "")} for n in result.untestable],
        experiment=result.next_experiment,
        holdout=[sha[:12] for sha in result.holdout_sha256],
        parent=stage.sha256,
        following=result.stage.sha256,
        seconds=result.seconds,
    )


def headline(result: GapResult) -> str:
    """The answer in a sentence or two."""
    said = []
    if result.effects:
        said.append("The model lacks " + _listed([_title(e) for e in result.effects]) + ".")
    for tie in result.ties:
        said.append(f"These records cannot tell apart: {_listed([_plain(n) for n in tie], 'or')}.")
    if "unknown" in result.verdicts:
        said.append("Structure remains that no effect of the catalogue explains.")
    return " ".join(said) or "Model and measurement agree within noise and what the base is known to miss."


def _title(effect: NamedEffect) -> str:
    return f"{_plain(effect.name)} on axis {effect.axis}" if effect.axis else _plain(effect.name)


def _plain(name: str) -> str:
    known = catalogue()
    return known[name].title.lower() if name in known else name.replace("_", " ")


def _listed(words: Sequence[str], last: str = "and") -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {last} {words[-1]}"


def cards(result: GapResult) -> list[dict[str, str]]:
    """The figures a reader looks for first."""
    gap = result.gap
    return [
        {"value": ", ".join(result.verdicts), "label": "verdict"},
        {"value": f"{gap.before:.3g} µm", "label": "gap before, rms over the held-out records"},
        {"value": f"{gap.after:.3g} µm", "label": "gap after"},
        {"value": f"{gap.floor:.3g} µm", "label": f"floor: {gap.floor_from}"},
    ]


def remains(result: GapResult) -> str:
    """What is left, in words."""
    gap = result.gap
    before, after = gap.before**2 - gap.floor**2, gap.after**2 - gap.floor**2
    if before <= 0:
        return "The gap was at its floor from the start."
    left = 100 * max(after, 0.0) / before
    return f"Of the power above the floor, {left:.1f} % is left on records that nothing was fitted to."


def effect_part(effect: NamedEffect) -> dict[str, Any]:
    """One named effect for the template."""
    entry = catalogue().get(effect.name)
    rows = [
        {"name": name, "value": value, "low": low, "high": high, "unit": unit}
        for name, value, low, high, unit in lines(effect.params)
    ]
    return {
        "title": _title(effect), "share": 100 * effect.share, "why": effect.why, "rows": rows,
        "equation": entry.equation if entry else "", "shows": entry.shows if entry else "",
        "compensation": entry.compensation if entry else "", "source": entry.source if entry else "",
    }  # fmt: skip


def tie_part(tie: tuple[str, ...]) -> dict[str, str]:
    """One tie for the template."""
    known = catalogue()
    reveals = "; ".join(f"{_plain(n)}: {known[n].reveals}" for n in tie if n in known)
    return {"names": _listed([_plain(n) for n in tie], "or"), "adopted": _plain(tie[0]), "reveals": reveals}


def candidate_rows(candidates: Sequence[Candidate]) -> list[dict[str, Any]]:
    """Every refitted candidate, step by step."""
    return [
        {
            "step": c.step, "name": _plain(c.name), "score": c.score, "remark": c.remark,
            "z": f"{c.held_out_z:.1f}" if np.isfinite(c.held_out_z) else "",
        }
        for c in candidates
    ]  # fmt: skip


def _largest(traces: Sequence[Trace]) -> list[Trace]:
    """The held-out records with the largest gap before."""
    return sorted(traces, key=lambda t: -float(np.std(t.measured_um - t.before_um)))[:MOST_TRACES]


def trace_figure(trace: Trace) -> Figure:
    """Measured and modelled above, what each model leaves below."""
    t, x, before, after = thin(trace.t_s, trace.measured_um, trace.before_um, trace.after_um)
    with figure_style():
        figure = new_figure(9.4, 4.8)
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[1, 1.2])
        upper.plot(t, x, color=GREY, linewidth=2.4, alpha=0.6, label="measured")
        upper.plot(t, after, color=BLUE, linewidth=1.0, label="model after")
        lower.plot(t, x - before, color=RED, linewidth=0.9, label="left before")
        lower.plot(t, x - after, color=BLUE, linewidth=0.9, label="left after")
        upper.set(ylabel="position (µm)")
        lower.set(xlabel="time (s)", ylabel="measured - model (µm)")
        for axes in (upper, lower):
            axes.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=2)
        return figure


def cells_figure(result: GapResult) -> Figure:
    """Shares of the ranked cells."""
    cells = list(reversed(result.where))
    with figure_style():
        figure = new_figure(7.4, 0.6 + 0.32 * len(cells))
        axes = figure.add_subplot()
        colours = [GREEN if c.p <= 0.01 else ORANGE for c in cells]
        axes.barh([f"{c.by}: {c.cell}" for c in cells], [100 * c.share for c in cells], color=colours)
        axes.set(xlabel="share of the unexplained power (%)")
        return figure


def spectrum_figure(spectrum: Spectrum) -> Figure:
    """Amplitude density of the held-out residual, beside the reference's."""
    with figure_style():
        figure = new_figure(7.4, 3.4)
        axes = figure.add_subplot()
        if spectrum.reference is not None:
            axes.loglog(spectrum.f_Hz[1:], 1e3 * spectrum.reference[1:], color=GREY, label="reference records")
        axes.loglog(spectrum.f_Hz[1:], 1e3 * spectrum.seen[1:], color=BLUE, linewidth=1.0, label="held-out records")
        axes.set(xlabel="frequency (Hz)", ylabel="nm/√Hz")
        axes.legend()
        return figure
