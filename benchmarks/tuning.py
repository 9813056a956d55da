"""The table of tuned loops in docs/tracking.md, measured on built-in stages in virtual time.

A stage is identified and tuned; then its own file, which neither saw, is changed (modes 10 % up and down) and pushed.
Run with `python benchmarks/tuning.py [STAGE...] [resting]`; the last adds what a held axis sees of another one.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

import phaselead as pl
from phaselead.control import Tuned
from phaselead.control.tuning.course import LEVEL_SHARE
from phaselead.identify import FitResult
from phaselead.model import AdoptedEffect, Stage, save_stage
from phaselead.sim import built_in

STAGES = ("xyz250", "xyz250-hard")
PUSH_s, LENGTH_s = 4.0, 4.6
SEEN_um, BACK_um = 0.1, 0.05
"""A push has begun once the stage has gone so far, two ticks after the force; it is over within this."""
TICK_HZ = 5000
MIDDLE_um = {"xy30": 15.0, "x100": 50.0}


def tune_x(device: pl.Controller, fitted: FitResult) -> pl.Tuned:
    """As it comes, or, where that is refused, with twice the level, as the refusal asks for."""
    try:
        return device.tune("x", model=fitted)
    except pl.BadInput as refusal:
        print(f"again with twice the level: {refusal}", flush=True)
        limits = fitted.model.axis("x").limits
        return device.tune("x", model=fitted, level=2 * LEVEL_SHARE * (limits.u_max_V - limits.u_min_V))


def moved(stage: Stage, factor: float) -> Stage:
    """The stage with every mode of x at ``factor`` times its frequency."""
    axis = stage.axis("x")
    effects = tuple(
        one.model_copy(update={"params": _scaled(one, factor)}) if "f_Hz" in one.params else one for one in axis.effects
    )
    return stage.model_copy(update={"axes": {**stage.axes, "x": axis.model_copy(update={"effects": effects})}})


def _scaled(effect: AdoptedEffect, factor: float) -> dict:
    f_Hz = effect.params["f_Hz"]
    scaled = tuple(factor * f for f in f_Hz) if isinstance(f_Hz, tuple) else factor * f_Hz
    return {**effect.params, "f_Hz": scaled}


def port_of(stage: Stage, folder: Path, query: str = "") -> str:
    path = folder / f"stage-{stage.sha256[:12]}.toml"
    if not path.exists():
        save_stage(path, stage)
    return f"sim://{path}{query}"


def back_ms(tuned: Tuned, stage: Stage, folder: Path, place_um: float) -> float:
    """After a push of 1 um on the stage itself: until its true position stays within 5 % of that."""
    with pl.connect(port_of(stage, folder, f"?force=x:1um@{PUSH_s:g}s")) as dev:
        run = dev.track(f"goto:{place_um:g}um", mode="pid", model=tuned.model, duration=LENGTH_s)
    true = run.true_um["x"]
    settled = slice(round((PUSH_s - 1.0) * TICK_HZ), round((PUSH_s - 0.5) * TICK_HZ))
    off = np.abs(true - true[settled].mean())[settled.stop :]
    pushed = int(np.argmax(off > SEEN_um))
    late = np.flatnonzero(off[pushed : pushed + TICK_HZ // 4] > BACK_um)
    return float((late[-1] + 1) / TICK_HZ * 1e3)


def rms_at_rest_nm(tuned: Tuned, stage: Stage, folder: Path, place_um: float) -> str:
    """Held: rms of the measured position, or what ended it."""
    try:
        with pl.connect(port_of(stage, folder)) as dev:
            run = dev.track(f"goto:{place_um:g}um", mode="pid", model=tuned.model, duration=2.0)
    except pl.DeviceFault as fault:
        return str(fault)[:20]
    return f"{1e3 * np.std(run.x_um[-2500:]):.1f}"


def resting_nm() -> dict[str, list[tuple[int, int, int]]]:
    """Of y, held at three places and tuned, while x moves 100 um at 5 Hz: largest way of its true position over four
    periods, largest of their mean, and rms of what differs from it; by mode."""
    with pl.connect("sim://xyz250") as dev:
        model = dev.identify("xy").model
        tuned = dev.tune("y", model=dev.tune("x", model=model).model).model
    found: dict[str, list[tuple[int, int, int]]] = {}
    for mode in ("pid", "ff+pid", "inverse", "inverse+pid"):
        for place_um in (20, 50, 90):
            with pl.connect("sim://xyz250?seed=1") as dev:
                run = dev.track(x="sine:100um@5Hz", y=f"goto:{place_um}um", mode=mode, model=tuned, duration=2.0)
            y_nm = 1e3 * (run.true_um["y"][-4000:] - run.true_um["y"][-4000:].mean()).reshape(4, 1000)
            repeats = y_nm.mean(axis=0)
            figures = np.abs(y_nm).max(), np.abs(repeats).max(), (y_nm - repeats).std()
            found.setdefault(mode, []).append((round(figures[0]), round(figures[1]), round(figures[2])))
    return found


def main(names: tuple[str, ...]) -> None:
    print("| stage | peak S, bandwidth over the range | as measured: predicted | measured | back after 1 um (ms), "
          "modes at 0.9, 1, 1.1 | held (nm rms), the same |\n|---|---|---|---|---|---|")  # fmt: skip
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        for name in names:
            stage, place_um = built_in(name), MIDDLE_um.get(name, 60.0)
            with pl.connect(f"sim://{name}") as dev:
                tuned = tune_x(dev, dev.identify("x"))
            low, high = tuned.predicted.bandwidth_Hz
            each = [moved(stage, factor) for factor in (0.9, 1.0, 1.1)]
            back = ", ".join(f"{back_ms(tuned, one, folder, place_um):.1f}" for one in each)
            rest = ", ".join(rms_at_rest_nm(tuned, one, folder, place_um) for one in each)
            expected, closed = tuned.expected, tuned.closed
            print(
                f"| `{name}` | {tuned.predicted.peak_sensitivity:.2f}, {low:.0f} to {high:.0f} Hz | "
                f"{expected.peak_sensitivity:.2f}, {expected.bandwidth_Hz[0]:.0f} Hz | "
                f"{closed.peak_sensitivity:.2f}, {closed.bandwidth_Hz:.0f} Hz | {back} | {rest} |"
            )
        if "resting" in sys.argv:
            for mode, figures in resting_nm().items():
                print(f"y held, {mode}, at 20, 50, 90 um: largest, repeating, rms of the rest, nm: {figures}")


if __name__ == "__main__":
    main(tuple(name for name in sys.argv[1:] if name != "resting") or STAGES)
