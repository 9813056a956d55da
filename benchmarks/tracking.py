"""How well paths are followed, as docs/tracking.md has it: one shot and learned, tuned and as identified.

Prints rows of Markdown: largest error of the true position against the path as it was written, % of its swing, over the
last four periods; the worst of three seeds of the sensor's noise. The model is identified first, with the stage's data
sheet, and its loop tuned; "changed" is the same model on a stage with 10 % less gain, 30 % more hysteresis and a mode
10 % lower than it was identified with. `python benchmarks/tracking.py [PATH...] [untuned] [besides]`: "untuned" has the
gains of the identification, "besides" holds, forces, moves and other stages.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

import phaselead as pl
from phaselead.device import TICK_HZ
from phaselead.model import AxisModel, Stage
from phaselead.sim import built_in
from tuning import tune_x

PATHS = (
    "sine:60um@5Hz", "sine:60um@20Hz", "sine:30um@50Hz", "sine:30um@100Hz", "sine:10um@200Hz",
    "triangle:30um@50Hz", "file:ROUNDED@50Hz",
)  # fmt: skip
DURATION_S = 1.0
"""At least, of a run that is judged: ten periods of a fast path are over before its start has rung out."""
TRIALS = 10
SEEDS = (1, 2, 3)
"""Of the sensor's noise; none is that of the identification."""


def rounded_triangle(path: Path, swing_um: float = 30.0, share: float = 0.05, rows: int = 1000) -> None:
    """A triangle whose corners are parabolas over ``share`` of the period."""
    corners = 1 - np.abs(2 * np.arange(rows) / rows - 1)
    spectrum = np.fft.rfft(corners) * np.sinc(share * np.arange(rows // 2 + 1))
    values = np.fft.irfft(spectrum, rows)
    np.savetxt(path, swing_um * (values - values.min()) / np.ptp(values), header="x_um", comments="")


def changed(model: AxisModel) -> AxisModel:
    """10 % less gain, 30 % more hysteresis, the mode 10 % lower."""
    assert model.time is not None
    view = model.time
    time = view.model_copy(
        update={
            "gain_um_per_V": 0.9 * view.gain_um_per_V,
            "play_w_um_per_V": tuple(0.9 * 1.3 * w for w in view.play_w_um_per_V),
            "deadzone_s_um_per_V": tuple(0.9 * s for s in view.deadzone_s_um_per_V),
        }
    )
    lower = [
        e.model_copy(update={"params": {**e.params, "f_Hz": 0.9 * float(e.params["f_Hz"])}})  # type: ignore[arg-type]
        if e.name == "resonance"
        else e
        for e in model.effects
    ]
    return model.model_copy(update={"time": time, "effects": tuple(lower)})


def row(wave: str, port: str, model: Stage, mode: str = "inverse+pid") -> list[str]:
    """One shot: largest and rms of the true position, and largest from rest; learned: largest, and after how many
    trials. Each is the worst of all seeds."""
    f_Hz = float(wave.rpartition("@")[2].removesuffix("Hz"))
    seconds = max(DURATION_S, 10 / f_Hz)
    found = []
    for seed in SEEDS:
        with pl.connect(f"{port}?seed={seed}") as device:
            shot = device.track(wave, mode=mode, model=model, duration=seconds).figures["true"]
        with pl.connect(f"{port}?seed={seed}") as device:
            table = device.learn(wave, mode=mode, model=model, trials=TRIALS)
            after = device.track(wave, model=model, learned=table, duration=seconds).figures["true"]
        rms_pct = 100 * shot["rms_um"] / shot["range_um"]
        found.append(
            (shot["max_pct"], rms_pct, shot["from_rest"]["max_pct"], after["max_pct"], float(table.best.number))
        )
    return [f"{number:.3g}" for number in np.max(found, axis=0)]


def rests_pct(model: Stage, mode: str) -> float:
    """Of y, held at 50 um, while x moves 100 um at 5 Hz: largest way of its true position over the last four periods, %
    of the 100 um."""
    with pl.connect("sim://xyz250?seed=1") as device:
        run = device.track(x="sine:100um@5Hz", y="goto:50um", mode=mode, model=model, duration=2.0)
    last = run.true_um["y"][-round(4 / 5 * TICK_HZ) :]
    return float(np.abs(last - 50.0).max())


def back_ms(model: Stage, mode: str) -> float:
    """After a force of 1 um on an axis held at 50 um: until its true position stays within 5 % of it; infinite where it
    does not within a second. The force is 4 s after the device was opened."""
    with pl.connect("sim://xyz250?seed=1&force=x:1um@4s") as device:
        run = device.track("goto:50um", mode=mode, model=model, duration=5.0)
    true = run.true_um["x"]
    before, watched = 3 * TICK_HZ, round(3.5 * TICK_HZ)
    off = np.abs(true - true[before:watched].mean())[watched:]
    pushed = int(np.argmax(off > 0.1))
    late = np.flatnonzero(off[pushed:] > 0.05)
    return float((late[-1] + 1) / TICK_HZ * 1e3) if late[-1] + 1 < len(off) - pushed else float("inf")


def there_ms(model: Stage, mode: str) -> float:
    """From the begin of `goto:100um@0.01s`: until the measured position stays within 0.1 um of its end."""
    with pl.connect("sim://xyz250?seed=1") as device:
        run = device.track("goto:100um@0.01s", mode=mode, model=model, duration=1.0)
    late = np.flatnonzero(np.abs(run.x_um - 100.0) > 0.1)
    return float((late[-1] + 1) / TICK_HZ * 1e3)


def besides(model: Stage) -> None:
    """What is no periodic path, by mode."""
    modes = ("inverse", "inverse+pid", "ff+pid", "pid")
    print(f"| besides | {' | '.join(modes)} |\n|---|---|---|---|---|")
    for name, measure in (("force", back_ms), ("goto", there_ms)):
        print(f"| {name} | {' | '.join(f'{measure(model, mode):.4g}' for mode in modes)} |", flush=True)
    with pl.connect("sim://xyz250") as device:
        both = device.identify("xy").model
    print(f"| y held | {' | '.join(f'{rests_pct(both, mode):.2g}' for mode in modes)} |", flush=True)


def others() -> None:
    """A path on stages whose modes lie lower or are several, by gains and mode: as `row`."""
    for name in ("x500", "xyz250-hard"):
        with pl.connect(f"sim://{name}") as device:
            fitted = device.identify("x")
        with pl.connect(f"sim://{name}") as device:
            tuned = tune_x(device, fitted).model
        for said, model, mode in (
            ("", fitted.model, "inverse"), ("", fitted.model, "inverse+pid"), (", tuned", tuned, "inverse+pid")
        ):  # fmt: skip
            try:
                cells = row("sine:30um@100Hz", f"sim://{name}", model, mode)
            except (pl.BadInput, pl.DeviceFault) as error:
                cells = [str(error)]
            print(f"| {name} | {mode}{said} | {' | '.join(cells)} |", flush=True)


def main() -> None:
    words = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        rounded, other = Path(folder) / "rounded.csv", Path(folder) / "changed.toml"
        rounded_triangle(rounded)
        stage = built_in("xyz250")
        axes = {axis: changed(model) for axis, model in stage.axes.items()}
        stage.model_copy(update={"axes": axes}).save(other)
        with pl.connect("sim://xyz250") as device:
            model = device.identify("x").model
        if "besides" in words:
            besides(model)
            others()
            return
        if "untuned" not in words:
            with pl.connect("sim://xyz250") as device:
                model = device.tune("x", model=model).model
        print("| stage | path | one shot | its rms | from rest | learned | trials |")
        print("|---|---|---|---|---|---|---|")
        for name, port in (("xyz250", "sim://xyz250"), ("changed", f"sim://{other}")):
            for wave in [word for word in words if word != "untuned"] or PATHS:
                cells = row(wave.replace("ROUNDED", str(rounded)), port, model)
                print(f"| {name} | `{wave.replace('ROUNDED', 'rounded.csv')}` | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
