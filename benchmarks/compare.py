"""The comparison in docs/compare.md: the paper's controllers, three that it cites, and ours, on the same stages.

`make compare`, or `python benchmarks/compare.py [CASE...]` for some of the cases. What is done is kept in out/compare,
so that a run that was cut short goes on; remove a file there to measure it again. Then the page is written.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path as File

import numpy as np

import phaselead as pl
from compare_page import write_page
from phaselead.control.joins import quiet_s
from phaselead.model import AxisModel, Stage, load_stage, save_stage, sensor_lag_s
from phaselead.model.operator import resting_at
from phaselead.sim import built_in
from rivals import RIVALS, Evidence, Path, Sine, drive, paths_for
from rivals.bench import Reference
from rivals.evidence import TICK_S
from tuning import tune_x

OUT = File("out/compare")
SEED, TRIALS, JUDGED_PERIODS = 1, 10, 4
"""The seed is of the sensor's noise, and not that of the identification."""


@dataclass(frozen=True)
class Case:
    """A stage, and whether it is 20 % off what the controllers were made on."""

    stage: str
    off: bool = False

    @property
    def name(self) -> str:
        return f"{self.stage}-off" if self.off else self.stage


CASES = (
    Case("xyz250"),
    Case("xyz250-hard"),
    Case("xy30"),
    Case("x100"),
    Case("x500"),
    Case("xyz250", off=True),
    Case("x100", off=True),
)


def off_by_a_fifth(stage: Stage) -> Stage:
    """20 % less gain, 20 % wider loops, modes 20 % lower, its sensor zeroed at rest again."""
    model = stage.axis("x")
    assert model.time is not None
    view = model.time
    time = view.model_copy(
        update={
            "gain_um_per_V": 0.8 * view.gain_um_per_V,
            "play_w_um_per_V": tuple(0.8 * 1.2 * w for w in view.play_w_um_per_V),
            "deadzone_s_um_per_V": tuple(0.8 * s for s in view.deadzone_s_um_per_V),
        }
    )
    lower = tuple(
        e.model_copy(update={"params": {**e.params, "f_Hz": tuple(0.8 * f for f in np.atleast_1d(e.params["f_Hz"]))}})
        if e.name == "resonance"
        else e
        for e in model.effects
    )
    changed = model.model_copy(update={"time": resting_at(time, 0.0), "effects": _shaped(lower, model)})
    return stage.model_copy(update={"axes": {**stage.axes, "x": changed}})


def _shaped(effects: tuple, model: AxisModel) -> tuple:
    """Numbers where the stage file has a number and not a list."""
    return tuple(
        new.model_copy(update={"params": {**new.params, "f_Hz": new.params["f_Hz"][0]}})
        if new.name == "resonance" and not isinstance(old.params["f_Hz"], tuple)
        else new
        for new, old in zip(effects, model.effects, strict=True)
    )


@dataclass(frozen=True)
class Made:
    """What every controller is made from, and our two models."""

    evidence: Evidence
    identified: Stage
    tuned: Stage


def made(stage: str) -> Made:
    """From one identification and one tuning of the built-in stage."""
    folder = OUT / stage
    evidence, identified, tuned = folder / "evidence.npz", folder / "identified.toml", folder / "tuned.toml"
    if not evidence.exists():
        folder.mkdir(parents=True, exist_ok=True)
        with pl.connect(f"sim://{stage}") as device:
            fitted = device.identify("x", creep=False)  # the rivals have no hold to learn it from
            save_stage(identified, fitted.model)
            loop = tune_x(device, fitted)
        save_stage(tuned, loop.model)
        sure = loop.measured.reliable()
        model = fitted.axis("x")
        Evidence(
            [_sine(record) for record in fitted.records],
            loop.measured.f_Hz[sure],
            loop.measured.gain[sure],
            (model.limits.u_min_V, model.limits.u_max_V),
            sensor_lag_s(model),
        ).save(evidence)
    return Made(Evidence.load(evidence), load_stage(identified), load_stage(tuned))


def _sine(record: pl.Recording) -> Sine:
    """Of a record of the identification; its name says swing and frequency."""
    _, swing, f_Hz = record.source.split("-")
    axis = record.axes["x"]
    settled = record.scored.start or 0
    return Sine(axis.u_V, axis.x_um, float(swing.rstrip("V")), float(f_Hz.removesuffix("Hz")), settled)


Outcome = tuple[np.ndarray, np.ndarray] | str
"""Path and true position in um (n,), or why there is none."""


def rival(case: Case, known: Made, name: str, path: Path) -> Outcome:
    stage = off_by_a_fifth(built_in(case.stage)) if case.off else built_in(case.stage)
    enter_s = quiet_s(known.identified.axis("x"))
    reference = Reference(path, enter_s, known.evidence.sensor_lag_s)
    driven = drive(stage, RIVALS[name](known.evidence, path, reference), path, enter_s=enter_s, seed=SEED)
    return driven.ended or (driven.asked_um, driven.true_um)


def ours(case: Case, model: Stage, path: Path, trials: int = 0) -> Outcome:
    """In mode inverse+pid with these gains, after so many trials of learning."""
    port = f"sim://{_stage_file(case)}?seed={SEED}" if case.off else f"sim://{case.stage}?seed={SEED}"
    wave = _wave(path)
    try:
        with pl.connect(port) as device:
            table = device.learn(wave, model=model, trials=trials) if trials else None
            run = device.track(wave, mode="inverse+pid", model=model, learned=table, duration=path.seconds)
    except pl.DeviceFault as fault:
        return f"stopped: {str(fault).split()[1]}"
    except pl.BadInput as refusal:
        return f"refused: {refusal}"
    return path(run.t_s), run.true_um["x"]


def _stage_file(case: Case) -> File:
    file = OUT / f"{case.name}.toml"
    if not file.exists():
        save_stage(file, off_by_a_fifth(built_in(case.stage)))
    return file


def _wave(path: Path) -> str:
    if path.sine:
        return f"sine:{path.swing_um:g}um@{path.f_Hz:g}Hz"
    file = OUT / f"{path.name.split()[0]}-{path.swing_um:g}um.csv"
    np.savetxt(file, path.rows(), header="x_um", comments="")
    return f"file:{file}@{path.f_Hz:g}Hz"


def figures(path: Path, outcome: Outcome) -> dict:
    """Largest and rms error, % of swing, of the last four periods and of the first, and the hash of path and true
    position; or the reason."""
    if isinstance(outcome, str):
        return {"ended": outcome}
    error = 100 * (outcome[0] - outcome[1]) / path.swing_um
    period = round(1 / (path.f_Hz * TICK_S))
    run = hashlib.sha256(b"".join(part.astype("<f8").tobytes() for part in outcome)).hexdigest()
    parts = {"steady": error[-JUDGED_PERIODS * period :], "first": error[:period]}
    return {"sha256": run} | {
        f"{name}_{kind}": float(value)
        for name, part in parts.items()
        for kind, value in (("max", np.abs(part).max()), ("rms", np.sqrt(np.mean(part**2))))
    }


def controllers(case: Case, known: Made) -> dict[str, Callable[[Path], Outcome]]:
    """By name, in the order of the tables."""
    found: dict[str, Callable[[Path], Outcome]] = {
        name: lambda path, name=name: rival(case, known, name, path) for name in RIVALS
    }
    found["ours, one shot"] = lambda path: ours(case, known.identified, path)
    found["ours, learned"] = lambda path: ours(case, known.identified, path, TRIALS)
    found["ours, tuned"] = lambda path: ours(case, known.tuned, path)
    found["ours, tuned and learned"] = lambda path: ours(case, known.tuned, path, TRIALS)
    return found


def measure(case: Case) -> None:
    """Everything of a case that is not there yet."""
    kept = OUT / f"{case.name}.json"
    results = json.loads(kept.read_text()) if kept.exists() else {}
    for name, controller in controllers(case, made(case.stage)).items():
        for path, plain in zip(paths_for(case.stage), paths_for("xyz250"), strict=True):
            row = results.setdefault(plain.name, {})
            if name in row:
                continue
            outcome = controller(path)
            row[name] = figures(path, outcome)
            kept.write_text(json.dumps(results, indent=1))
            print(f"{case.name:12} {plain.name:34} {name:16} {row[name]}", flush=True)


def main(names: list[str]) -> None:
    OUT.mkdir(parents=True, exist_ok=True)
    known = {case.name: case for case in CASES}
    for name in names or known:
        try:
            measure(known[name])
        except pl.BadInput as refusal:
            print(f"{name}: left out: {refusal}", flush=True)
    write_page(OUT, list(known))


if __name__ == "__main__":
    main(sys.argv[1:])
