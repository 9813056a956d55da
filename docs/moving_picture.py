"""The moving picture of the README, drawn from three runs on the built-in stage: ``make picture``."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

import phaselead as pl
from phaselead.drawing import BLUE, GREY, ORANGE, RED, figure_style, new_figure
from phaselead.record import Samples

PICTURE = Path(__file__).parent / "images" / "tracking.gif"
CONTROLLERS = {
    "pid": ("PID alone", RED),
    "ff": ("feed-forward alone", ORANGE),
    "ff+pid": ("both", BLUE),
}
SHOWN_S, FRAMES, FRAME_MS, HELD_MS = 0.4, 48, 80, 2500
"""Two periods, ten times slower than they are; then the whole picture stands still."""
COLOURS = 48


def tracked() -> dict[str, pl.Run]:
    """A run of each controller from rest, with the published gains."""
    with pl.connect("sim://xyz250") as dev:
        model = dev.identify()
    runs = {}
    for mode in CONTROLLERS:
        with pl.connect("sim://xyz250") as dev:
            runs[mode] = dev.track("sine:60um@5Hz", mode=mode, gains="paper", model=model)
    return runs


def frames(runs: dict[str, pl.Run]) -> Iterator[Image.Image]:
    """Paths above, their errors below, drawn from left to right."""
    with figure_style():
        figure = new_figure(8.0, 4.6)
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[1, 1.25])
        shown = runs["pid"].t_s <= SHOWN_S
        t_ms, path_um = 1e3 * runs["pid"].t_s[shown], runs["pid"].r_um[shown]
        upper.plot(t_ms, path_um, color=GREY, linewidth=5, alpha=0.3, label="path")
        lines: list[tuple[Line2D, Samples]] = []
        for mode, (name, colour) in CONTROLLERS.items():
            run = runs[mode]
            (position,) = upper.plot([], [], color=colour)
            (error,) = lower.plot([], [], color=colour, label=f"{name}: {run.figures['max_um']:.2g} µm")
            lines += [(position, run.x_um[shown]), (error, (run.r_um - run.x_um)[shown])]
        upper.set(ylabel="position (µm)", ylim=(-4, 66))
        upper.set_title("A piezo stage on a path of 60 µm at 5 Hz: who keeps up?", loc="left", fontsize=11)
        lower.set(xlabel="time (ms)", ylabel="error (µm)", xlim=(0, 1e3 * SHOWN_S), ylim=(-6.5, 6.5))
        lower.set_title("largest error", loc="left", fontsize=9)
        upper.legend(loc="upper right")
        lower.legend(loc="lower right", bbox_to_anchor=(1, 0.98), ncols=3, handlelength=1.2, columnspacing=1.2)
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
        for frame in range(1, FRAMES + 1):
            rows = round(len(t_ms) * frame / FRAMES)
            for line, up in lines:
                line.set_data(t_ms[:rows], up[:rows])
            yield drawn(figure)


def drawn(figure: Figure) -> Image.Image:
    """The figure as it is now."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=100)
    return Image.open(buffer).convert("RGB")


def write_gif(pictures: list[Image.Image], path: Path) -> None:
    """All in the colours of the last one, so that what stands still costs nothing."""
    palette = pictures[-1].quantize(COLOURS)
    first, *others = (one.quantize(palette=palette, dither=Image.Dither.NONE) for one in pictures)
    held = [FRAME_MS] * len(others) + [HELD_MS]
    first.save(path, save_all=True, append_images=others, duration=held, loop=0, optimize=True)


if __name__ == "__main__":
    write_gif(list(frames(tracked())), PICTURE)
    print(f"wrote {PICTURE}, {PICTURE.stat().st_size / 1e3:.0f} kB")
