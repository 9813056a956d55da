"""Figures that set runs beside each other: positions, errors or spectra."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import PurePath
from typing import Literal, get_args

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.signal import welch

from phaselead.drawing import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, SCALE, figure_style, new_figure, thin
from phaselead.errors import BadInput
from phaselead.record import AxisRecord, Recording, Samples

Shown = Literal["position", "error", "spectrum"]
SHOWN: tuple[Shown, ...] = get_args(Shown)
COLOURS = (BLUE, ORANGE, GREEN, RED, PURPLE)
"""Of the first recordings; of more a scale of colours."""
SEGMENT_S = 1.0
"""Of a periodogram: lines 1 Hz apart, and as many averages as the record has seconds."""
TITLES = {"position": "Where did the stage go?", "error": "How far was it from where it should be?"}


def runs_figure(recordings: Sequence[Recording], shown: Shown = "position", *, titled: bool = True) -> Figure:
    """One panel for each axis; every recording in a colour of its own. A spectrum is of the error or, where there is no
    reference, of the position about its mean: amplitude density in um per root Hz. ``titled``: with the question that
    it answers, which a page has as a heading.

    Raises BadInput when no recording has what is asked for.
    """
    if shown not in SHOWN:
        raise BadInput(f"of={shown!r}: a figure shows one of {', '.join(SHOWN)}")
    axes = [axis for axis in ("x", "y", "z") if any(_signal(one, axis, shown) is not None for one in recordings)]
    if not axes:
        instead = 'a reference, so no error; give --of position (in Python of="position")'
        what = instead if shown == "error" else "a measured position"
        raise BadInput(f"none of these recordings has {what}")
    with figure_style():
        figure = new_figure(9.4, 1.0 + 2.8 * len(axes))
        for panel, axis in zip(figure.subplots(len(axes), 1, squeeze=False)[:, 0], axes, strict=True):
            for i, recording in enumerate(recordings):
                many = SCALE(i / max(len(recordings) - 1, 1))
                _draw(panel, recording, axis, shown, COLOURS[i] if len(recordings) <= len(COLOURS) else many)
            panel.set(xlabel=_across(shown), ylabel=f"{axis}: {_up(shown, recordings, axis)}")
            panel.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=4)
        if titled:
            title = TITLES.get(shown) or f"At which frequencies is the {_spectra_of(recordings, axes)}?"
            figure.suptitle(title, x=0.02, ha="left")
        return figure


def _across(shown: Shown) -> str:
    return "frequency (Hz)" if shown == "spectrum" else "time (s)"


def _up(shown: Shown, recordings: Sequence[Recording], axis: str) -> str:
    if shown == "spectrum":
        return f"{_spectra_of(recordings, axis)} (\u00b5m/\u221aHz)"
    return {"position": "position (\u00b5m)", "error": "reference \u2212 measured (\u00b5m)"}[shown]


def _spectra_of(recordings: Sequence[Recording], axes: Iterable[str]) -> str:
    """Whether their spectra are of the error, of the position, or of the error here and of the position there."""
    drawn = [one.axes[a] for one in recordings for a in axes if a in one.axes and one.axes[a].x_um is not None]
    each = dict.fromkeys("error" if record.r_um is not None else "position" for record in drawn)
    return " or ".join(sorted(each))


def _signal(recording: Recording, axis: str, shown: Shown) -> Samples | None:
    """What is drawn of an axis, (n,); None where the recording lacks it."""
    record: AxisRecord | None = recording.axes.get(axis)
    if record is None or record.x_um is None or shown == "position":
        return None if record is None else record.x_um
    if record.r_um is not None:
        return np.asarray(record.r_um - record.x_um)
    return None if shown == "error" else np.asarray(record.x_um - record.x_um.mean())


def _draw(panel: Axes, recording: Recording, axis: str, shown: Shown, colour: object) -> None:
    values = _signal(recording, axis, shown)
    if values is None:
        return
    name = PurePath(recording.source).name or "recording"
    if shown == "spectrum":
        rows = min(len(values), max(16, round(SEGMENT_S * recording.rate_Hz)))
        f_Hz, density = welch(values, fs=recording.rate_Hz, nperseg=rows)
        panel.loglog(f_Hz[1:], np.sqrt(density[1:]), color=colour, label=name, linewidth=1.0)
        return
    reference = recording.axes[axis].r_um
    if shown == "position" and reference is not None:
        first = "reference" not in panel.get_legend_handles_labels()[1]
        label = "reference" if first else None
        panel.plot(*thin(recording.t_s, reference), color=GREY, linewidth=2.4, alpha=0.5, label=label)
    rms = f", {np.sqrt(np.mean(values**2)):.3g} \u00b5m rms" if shown == "error" else ""
    panel.plot(*thin(recording.t_s, values), color=colour, label=f"{name}{rms}", linewidth=1.0)
