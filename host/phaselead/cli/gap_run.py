"""What ``phaselead gap`` does once its options are parsed. Importing it loads the numerical libraries."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from phaselead.cli.common import progress, read_recordings, record_files, tell
from phaselead.errors import BadInput
from phaselead.gap import (
    GapResult,
    TrackingComparison,
    check_port,
    excludes,
    headline,
    keep_freed_memory,
    parameter_texts,
    percent,
    run_gap,
    unit_of,
)
from phaselead.gap import verify_on as verify
from phaselead.model import load_stage, stage_text
from phaselead.record import RUN_SUFFIXES, check_output, is_special, write_texts
from phaselead.result import json_text


def compare(
    model_path: str | None,
    train: tuple[str, ...],
    holdout: tuple[str, ...],
    reference: tuple[str, ...],
    frozen: bool | None,
    output: str | None,
    report: str | None,
    json_to: str | None,
    column_map: str | None,
    rate: str | None,
    verify_on: str | None = None,
) -> None:
    """Read, search, verify, write: nothing is written unless all of it can be."""
    if model_path is None:
        raise BadInput("gap needs a model; give --model STAGE.toml")
    check_outputs(output, report, json_to, [model_path, *record_files([*train, *holdout, *reference])])
    keep_freed_memory()
    stage = load_stage(model_path)
    parts = [read_recordings(part, column_map, rate) for part in (train, holdout, reference)]
    if verify_on:
        check_port(verify_on)
    with progress("comparing", 1.0) as advance:
        result = run_gap(stage, *parts, frozen=frozen, on_progress=advance)
    verification = None
    if verify_on:
        with progress(f"verifying on {verify_on}", 1.0) as advance:
            verification = verify(verify_on, stage, result.stage, advance)
    figures = result.as_json() | (verification.as_dict() if verification else {})
    texts = {output: stage_text(result.stage)} if output else {}
    if report:
        from phaselead.report import gap_page

        named = Path(json_to).name if json_to and json_to != "-" else "gap.json"
        texts[report] = gap_page(result, stage, Path(model_path).name, verification, named)
    if json_to and json_to != "-":
        texts[json_to] = json_text(figures)
    written = list(texts)
    write_texts(texts)
    tell(figures, json_to, lambda console: show(console, result, written, verification))


def check_outputs(output: str | None, report: str | None, json_to: str | None, inputs: Sequence[str]) -> None:
    """Raise BadInput, before any work, for outputs that cannot or must not be written."""
    check_output(output, suffixes=(".toml",), inputs=inputs)
    check_output(report, suffixes=(".html", ".htm"), inputs=inputs)
    check_output(json_to, inputs=inputs)
    named = [path for path in (output, report, json_to) if path and path != "-" and not is_special(path)]
    if len({os.path.realpath(path) for path in named}) < len(named):
        raise BadInput(f"{named[-1]}: is to hold two outputs at once; give -o, --report and --json a name each")


def show(
    console: Console, result: GapResult, written: list[str], verification: TrackingComparison | None = None
) -> None:
    """Print the result for a person."""
    console.print(f"verdict: {', '.join(result.verdicts)}")
    for effect in result.effects:
        on = f" ({effect.axis})" if effect.axis else ""
        console.print(f"{effect.name}{on}: {percent(effect.share)} of the unexplained power; {effect.why}")
        table = Table("parameter", "value", "95 % interval", "unit")
        for row in parameter_texts(effect.params):
            table.add_row(*row)
        console.print(table)
    for tie in result.ties:
        console.print(f"these records cannot tell apart: {', '.join(tie)}")
    if (where := headline(result.where)) is not None:
        console.print(where)
    gap = result.gap
    console.print(
        f"held-out gap {gap.before:.4g} -> {gap.after:.4g} {gap.unit} rms; floor {gap.floor:.4g} ({gap.floor_from})"
    )
    for said, excluded in (("not there", True), ("may be there, but not larger", False)):
        below = [f"{b.name} < {b.upper_95:.2g} {unit_of(b.unit)}" for b in result.excluded if excludes(b) == excluded]
        if below:
            console.print(f"{said}: {', '.join(text.strip() for text in below)}")
    if result.untestable:
        console.print("not testable with these records: " + ", ".join(result.untestable))
    if result.next_experiment is not None:
        console.print(experiment_sentence(result))
    for message in result.messages:
        console.print(message)
    if verification is not None:
        show_verification(console, verification)
    for path in written:
        console.print(f"wrote {path}")


def show_verification(console: Console, verification: TrackingComparison) -> None:
    """Print the tracking errors with both models."""
    table = Table("axis", "path", "mode", "before (µm rms)", "after (µm rms)", title=f"tracking on {verification.port}")
    for row in verification.tracked:
        table.add_row(row.axis, row.path, row.mode, f"{row.before.rms_um:.4g}", f"{row.after.rms_um:.4g}")
    if verification.tracked:
        console.print(table)
    for message in verification.messages:
        console.print(message)


def experiment_sentence(result: GapResult) -> str:
    """The next experiment in words."""
    e = result.next_experiment
    assert e is not None
    low, high = e.band
    band = f"{low:.3g} Hz" if low == high else f"{low:.3g}..{high:.4g} Hz"
    text = (
        f"next: {e.waveform}, {e.level:.3g} V peak-to-peak about {e.bias:.3g} V, {band}, "
        f"{e.seconds:.3g} s; predicted squared separation {e.separation:.3g}"
    )
    return f"{text}; no voltage tells them apart; that takes {e.needs_sensor}" if e.needs_sensor else text


def run_next(gap_json: str, port: str, axis: str, output: str, model_path: str | None) -> None:
    """Record the experiment that gap.json proposes."""
    from phaselead.gap import read_proposal, run_proposal

    check_output(output, suffixes=RUN_SUFFIXES, inputs=[gap_json, *([model_path] if model_path else [])])
    proposed = read_proposal(gap_json)
    stage = load_stage(model_path) if model_path else None
    with progress("recording", 1.0) as advance:
        rows = run_proposal(proposed, port, proposed.get("axis") or axis, output, stage, advance)
    Console(highlight=False).print(
        f"wrote {output}, {rows} samples; add it to --train (to --reference if the stage was as before), run gap again"
    )
