"""What ``phaselead gap`` does once its options are parsed. Importing it loads the numerical libraries."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from pathlib import Path

from phaselead.api import gap_next
from phaselead.cli.common import confirmed, emit, progress, read_recordings, show
from phaselead.cli.outputs import overwriting
from phaselead.errors import BadInput
from phaselead.freed_memory import keep_freed_memory
from phaselead.gap import (
    GapResult,
    axis_driven,
    check_port,
    excitation_of,
    modes_crossed_Hz,
    read_proposal,
    refuse_other_rate,
    run_gap,
    verified_on,
)
from phaselead.model import load_stage, stage_text
from phaselead.record import write_texts
from phaselead.result import Table, json_text


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
    keep_freed_memory()
    stage = load_stage(model_path)
    every = iter(read_recordings((*train, *holdout, *reference), column_map, rate))
    parts = [list(islice(every, len(part))) for part in (train, holdout, reference)]
    if verify_on:
        check_port(verify_on)
    with progress("comparing", 1.0) as advance:
        result = run_gap(stage, *parts, frozen=frozen, on_progress=advance)
    if verify_on:
        with progress(f"verifying on {verify_on}", 1.0) as advance:
            result = verified_on(verify_on, stage, result, advance)
    texts = {output: stage_text(result.stage)} if output else {}
    if report:
        from phaselead.report import gap_page

        named = Path(json_to).name if json_to and json_to != "-" else "gap.json"
        texts[report] = gap_page(result, Path(model_path).name, named)
    if json_to and json_to != "-":
        texts[json_to] = json_text(result.as_json())
    write_texts(texts, overwrite=overwriting())
    show(result.as_json(), json_to, [*printed(result, list(texts)), *_to_record(result, model_path, json_to)])


def printed(result: GapResult, written: Sequence[str]) -> list[Table | str]:
    """What is printed for a person: the result, and the files that hold it."""
    return [*result.tables(), *(f"wrote {path}" for path in written)]


def _to_record(result: GapResult, model_path: str, json_to: str | None) -> list[str]:
    """The command that records the experiment that is proposed, where there is one that it can run."""
    proposed = result.next_experiment
    if proposed is None or proposed.needs_sensor or proposed.several_axes or json_to == "-":
        return []
    if json_to is None:
        return ["to have it recorded, run this again with --json gap.json"]
    from phaselead.report import next_command

    return [f"to record it: {next_command(json_to, model_path)}"]


def run_next(
    gap_json: str,
    port: str,
    axis: str | None,
    output: str,
    model_path: str | None,
    yes: bool,
    json_to: str | None,
) -> None:
    """Record the experiment that gap.json proposes, once somebody has agreed to what it does to a known mode."""
    proposed = read_proposal(gap_json)
    stage = load_stage(model_path) if model_path else None
    driven = axis_driven(proposed, axis)
    refuse_other_rate(stage, driven)
    modes_Hz = modes_crossed_Hz(proposed, stage, driven)
    if modes_Hz:
        low, high = excitation_of(proposed).driven_Hz
        where = " and ".join(f"{f_Hz:.4g} Hz" for f_Hz in modes_Hz)
        drive = f"{proposed['level']:g} V from {low:g} to {high:g} Hz"
        confirmed(f"This drives {driven} with {drive}, across its mode at {where}. May it?", yes)
    with progress("recording", 1.0) as advance:
        recording = gap_next(
            gap_json, port, output=output, axis=driven, model=stage, overwrite=overwriting(), on_progress=advance
        )
    said = (
        f"wrote {output}, {len(recording.t_s)} samples from {port}; add it to --train (to --reference if the stage was "
        "as before), run gap again with the same --model"
    )
    emit(recording.facts() | {"output": output}, json_to, [said])
