"""What ``phaselead gap`` does once its options are parsed; loads the numerical libraries."""

from __future__ import annotations

import json
from pathlib import Path

from rich.console import Console
from rich.table import Table

from phaselead.cli.common import emit, progress, read_recordings
from phaselead.errors import BadInput
from phaselead.gap.result import GapResult
from phaselead.gap.run import run_gap
from phaselead.stage.file import load_stage, save_stage


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
) -> None:
    """Read, search, write: nothing is written unless all of it can be."""
    if model_path is None:
        raise BadInput("gap needs a model; give --model STAGE.toml")
    stage = load_stage(model_path)
    parts = [read_recordings(part, column_map, rate) for part in (train, holdout, reference)]
    with progress("comparing", 1.0) as advance:
        result = run_gap(stage, *parts, frozen=frozen, on_progress=advance)
    if output:
        save_stage(output, result.stage)
    if report:
        from phaselead.report.gap import write_gap_report

        write_gap_report(Path(report), result, stage, Path(model_path).name)
    written = [path for path in (output, report) if path]
    emit(result.as_json(), json_to, lambda console: show(console, result, written))


def show(console: Console, result: GapResult, written: list[str]) -> None:
    """The verdicts for a person."""
    console.print(f"verdict: {', '.join(result.verdicts)}")
    for effect in result.effects:
        on = f" ({effect.axis})" if effect.axis else ""
        console.print(f"{effect.name}{on}: {100 * effect.share:.0f} % of the unexplained power; {effect.why}")
        table = Table("parameter", "value", "95 % interval", "unit")
        for name, (value, unit, (low, high)) in effect.params.items():
            table.add_row(name, f"{value:.4g}", f"{low:.4g} .. {high:.4g}", unit)
        console.print(table)
    for tie in result.ties:
        console.print(f"these records cannot tell apart: {', '.join(tie)}")
    for cell in result.where[:3]:
        console.print(cell.sentence)
    gap = result.gap
    console.print(
        f"held-out gap {gap.before:.4g} -> {gap.after:.4g} {gap.unit} rms; floor {gap.floor:.4g} ({gap.floor_from})"
    )
    if result.excluded:
        console.print("not there: " + ", ".join(f"{b.name} < {b.upper_95:.2g} {b.unit}" for b in result.excluded))
    if result.untestable:
        console.print("not testable with these records: " + ", ".join(result.untestable))
    if result.next_experiment is not None:
        console.print(experiment_sentence(result))
    for path in written:
        console.print(f"wrote {path}")


def experiment_sentence(result: GapResult) -> str:
    """The next experiment in words."""
    e = result.next_experiment
    assert e is not None
    low, high = e.band
    text = (
        f"next: {e.waveform}, {e.level:.3g} V peak-to-peak about {e.bias:.3g} V, {low:.3g}..{high:.3g} Hz, "
        f"{e.seconds:.3g} s; predicted squared separation {e.separation:.3g}"
    )
    return f"{text}; no voltage tells them apart, it takes {e.needs_sensor}" if e.needs_sensor else text


def run_next(gap_json: str, port: str, axis: str, output: str) -> None:
    """Record the proposed experiment."""
    from phaselead.gap.perform import perform

    try:
        content = json.loads(Path(gap_json).read_text(encoding="utf-8"))
        proposed = content["next_experiment"]
    except (OSError, ValueError, KeyError, TypeError):
        raise BadInput(f"{gap_json}: is no gap.json; make one with phaselead gap --json") from None
    if proposed is None:
        raise BadInput(f"{gap_json}: proposes no experiment; there is no tie to resolve")
    rows = perform(proposed, port, proposed.get("axis") or axis, output)
    Console(highlight=False).print(f"wrote {output}, {rows} samples; add it to --train and run gap again")
