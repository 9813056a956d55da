"""How well paths are followed on the built-in stage, as docs/tracking.md has it: one shot and learned.

Prints one row of Markdown a path: largest error of the true position against the path as it was written, % of its
swing, over the last four periods; the worst of three seeds of the sensor's noise. The model is identified first, with
the stage's data sheet; "changed" is the same model on a stage with 10 % less gain, 30 % more hysteresis and a mode 10 %
lower than it was identified with.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

import phaselead as pl
from phaselead.model import AxisModel, Stage
from phaselead.sim import built_in

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


def row(wave: str, port: str, model: Stage) -> list[str]:
    """One shot: largest and rms of the true position, and largest from rest; learned: largest, and after how many
    trials. Each is the worst of all seeds."""
    f_Hz = float(wave.rpartition("@")[2].removesuffix("Hz"))
    seconds = max(DURATION_S, 10 / f_Hz)
    found = []
    for seed in SEEDS:
        with pl.connect(f"{port}?seed={seed}") as device:
            shot = device.track(wave, mode="inverse+pid", model=model, duration=seconds).figures["true"]
        with pl.connect(f"{port}?seed={seed}") as device:
            table = device.learn(wave, model=model, trials=TRIALS)
            after = device.track(wave, model=model, learned=table, duration=seconds).figures["true"]
        rms_pct = 100 * shot["rms_um"] / shot["range_um"]
        found.append(
            (shot["max_pct"], rms_pct, shot["from_rest"]["max_pct"], after["max_pct"], float(table.best.number))
        )
    return [f"{number:.3g}" for number in np.max(found, axis=0)]


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        rounded, other = Path(folder) / "rounded.csv", Path(folder) / "changed.toml"
        rounded_triangle(rounded)
        stage = built_in("xyz250")
        axes = {axis: changed(model) for axis, model in stage.axes.items()}
        stage.model_copy(update={"axes": axes}).save(other)
        with pl.connect("sim://xyz250") as device:
            model = device.identify("x").model
        print("| stage | path | one shot | its rms | from rest | learned | trials |")
        print("|---|---|---|---|---|---|---|")
        for name, port in (("xyz250", "sim://xyz250"), ("changed", f"sim://{other}")):
            for wave in sys.argv[1:] or PATHS:
                cells = row(wave.replace("ROUNDED", str(rounded)), port, model)
                print(f"| {name} | `{wave.replace('ROUNDED', 'rounded.csv')}` | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
