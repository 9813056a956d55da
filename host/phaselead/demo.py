"""The whole story on the built-in stage: identify, fit, verify, upload, track, record, replay, report."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from zlib import crc32

import numpy as np

from phaselead.control import PAPER_GAINS, Run, track, with_gains
from phaselead.device import Device, device_model, read_capture, write_run
from phaselead.errors import BadInput, PhaseleadError
from phaselead.identify import HELD_OUT, Experiment, Verification, identify_device, run_experiment, verify
from phaselead.model import Stage, predict, save_stage
from phaselead.record import Recording, check_output
from phaselead.report import DemoResults, HeldOut, figures, save_png, tracked, write_demo_report
from phaselead.sim import replay
from phaselead.waveforms import parse_wave

PORT = "sim://xyz250"
WAVE = "sine:60um@5Hz"
CONTROLLERS = ("pid", "ff", "ff+pid")
LOOP_FREQUENCIES_HZ = (1.0, 5.0, 10.0, 20.0)
LOOP_SWING_V = 8.0
PERIODS = 5
STAGE_FILE, REPORT = "stage.toml", "report.html"

Say = Callable[[str], None]


def run_demo(
    out: str | Path, say: Say, on_progress: Callable[[float], None] | None = None, *, overwrite: bool = False
) -> Path:
    """Runs everything, keeps every file in ``out``, and returns the report's path.

    ``say`` is given a line per chapter, ``on_progress`` the fraction done.

    Raises:
        BadInput: ``out`` is a folder that holds anything and ``overwrite`` is False, or is none that can be written to.
        PhaseleadError: a step failed, or a recording did not replay bit for bit.
    """
    made = not Path(out).exists()
    folder = _own_folder(Path(out), overwrite)
    try:
        return _run(folder, say, on_progress or (lambda fraction: None))
    except BaseException:
        if made:
            with suppress(OSError):  # something is in it
                folder.rmdir()
        raise


def _run(folder: Path, say: Say, step: Callable[[float], None]) -> Path:
    say("identifying the three axes of the built-in stage, which takes most of the time: one to four minutes in all")
    with Device.open(PORT) as device:
        identified = identify_device(device, "xyz", lambda done: step(0.6 * done))
        build_id = device.hello.build_id.hex()
    stage = with_gains(replace_name(identified.stage))
    save_stage(folder / STAGE_FILE, stage)
    say(f"identified: {len(identified.recordings)} records, three axes; stage file {folder / STAGE_FILE}")

    held_out = [verify_from_rest(stage, folder, experiment) for experiment in held_out_experiments()]
    for item in held_out:
        time, table = item.verifications["time"], item.verifications["table"]
        say(
            f"verified on {item.experiment.swing_V:g} V {item.experiment.f_Hz:g} Hz, from rest: "
            f"time view mean {time.mean_pct:.2f} % max {time.max_pct:.2f} %, "
            f"table view mean {table.mean_pct:.2f} % max {table.max_pct:.2f} % of range"
        )
    step(0.7)

    runs = {mode: track_from_rest(stage, folder, mode) for mode in CONTROLLERS}
    for mode, run in runs.items():
        say(f"tracked {WAVE} with {mode}: max {run.figures['max_um']:.3f} um, {run.figures['max_pct']:.2f} % of range")
    loops = [record_open(folder, Experiment("x", LOOP_SWING_V, f, 0, PERIODS)) for f in LOOP_FREQUENCIES_HZ]
    across = record_open(folder, Experiment("x", 10.0, 1.0, 0, 2), alone=False)
    step(0.8)

    replayed_ticks = replay_all(sorted(folder.glob("*.h5")))
    say(f"replayed {replayed_ticks} ticks: every DAC code is the same")
    step(0.9)

    report = folder / REPORT
    write_demo_report(
        report,
        DemoResults(stage, identified, held_out, runs, loops, across, replayed_ticks, build_id, model_crc(stage)),
    )
    save_png(figures.tracking({mode: tracked(run) for mode, run in runs.items()}), folder / "tracking.png")
    step(1.0)
    return report


def _own_folder(folder: Path, overwrite: bool) -> Path:
    """Made where it is not there. Empty but for hidden files, so that nothing in it is taken for this demo's."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        there = sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))
    except OSError as error:
        raise BadInput(f"{folder}: no folder can be made there ({error.strerror}); give another with --out") from None
    if there and not overwrite:
        earlier = " of an earlier demo" if STAGE_FILE in there and REPORT in there else ""
        raise BadInput(
            f"{folder}: holds {there[0]}{earlier}, and the demo keeps its files in a folder of its own; give another "
            "with --out, or write into this one with --overwrite (in Python overwrite=True)"
        )
    check_output(folder / REPORT)
    return folder


def replace_name(stage: Stage) -> Stage:
    """The same stage under the name it has in the demo."""
    return stage.model_copy(update={"name": "xyz250 as identified"})


def model_crc(stage: Stage) -> int:
    """CRC-32 of the model blob, as `phaselead info` prints it."""
    return crc32(device_model(stage))


def held_out_experiments() -> list[Experiment]:
    """The paper's two verification inputs, five cycles from rest, as in its figures."""
    return [Experiment("x", swing, f, 0, PERIODS, held_out=True) for swing, f in sorted(HELD_OUT, reverse=True)]


def record_open(folder: Path, experiment: Experiment, *, alone: bool = True) -> Recording:
    """One open-loop sine on a device fresh from power-on, kept in ``folder``."""
    with Device.open(PORT) as device:
        capture, recording = run_experiment(device, experiment, alone=alone)
    write_run(folder / f"open-{recording.source}{'' if alone else '-all-axes'}.h5", capture, recording)
    return recording


def verify_from_rest(stage: Stage, folder: Path, experiment: Experiment) -> HeldOut:
    """Both views against a record that starts from rest and was not used for the fit; nothing is refitted."""
    recording = replace(record_open(folder, experiment), scored=slice(None))
    verifications: dict[str, Verification] = {}
    for view in ("time", "table"):
        (verifications[view],) = verify(stage, [recording], view)
    time_um = predict(stage, recording).axes["x"].x_um
    table = stage.axis("x").table
    assert time_um is not None
    assert table is not None
    table_um = np.asarray(table.response(recording.t_s, experiment.swing_V, experiment.f_Hz))
    return HeldOut(experiment, recording, {"table view": table_um, "time view": time_um}, verifications)


def track_from_rest(stage: Stage, folder: Path, mode: str) -> Run:
    """One controller on a device fresh from power-on, with the paper's gains."""
    with Device.open(PORT) as device:
        run = track(device, {"x": parse_wave(WAVE)}, mode, stage=stage, gains={"x": PAPER_GAINS})
    write_run(folder / f"track-{mode.replace('+', '-')}.h5", run.capture, run.recording)
    return run


def replay_all(paths: Sequence[Path]) -> int:
    """Executes every run again; returns the ticks compared.

    Raises:
        PhaseleadError: a DAC code differed.
    """
    ticks = 0
    for path in paths:
        capture = read_capture(path)
        first_difference = replay(capture)
        if first_difference is not None:
            raise PhaseleadError(f"{path}: does not replay: the DAC code of tick {first_difference} differs")
        ticks += len(capture.ticks)
    return ticks
