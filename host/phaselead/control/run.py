"""One tracking run as a result: samples, figures, a table, a figure, a file."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from phaselead.device import TICK_HZ, Capture, Pulses, pulses_of, write_run
from phaselead.record import RUN_SUFFIXES, Recording, SampledResult, Samples, export
from phaselead.result import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NEVER_AT_REST = "the path never rested for 10 ms with the axis within its window"
"""Of a trigger output that waits for a step to settle."""


@dataclass(frozen=True, repr=False)
class Run(SampledResult):
    """One tracking run: the recording, the capture behind it, and its figures.

    ``figures`` are those of ``phaselead track --json``: ``mode``, ``max_um``, ``rms_um``, ``range_um``, ``max_pct``,
    ``max_um_mean_removed`` over the rows that ``judged`` names (the last four periods, of a move the whole
    record, of a path that is driven once the whole path), ``from_rest`` over every sample, ``ticks``, ``dropped``; with
    several axes they are under ``axes``. Error = the path that was asked for - measured position.

    The columns of the recording are attributes, float64 arrays of shape (n,): ``t_s``, ``u_V``, ``x_um``, ``r_um``
    (several axes: ``ux_V``, ``y_um``, ``rz_um`` ...).

    >>> import phaselead as pl
    >>> with pl.connect() as dev:
    ...     run = dev.track("sine:60um@5Hz", mode="pid", duration=1)
    >>> run.x_um.shape, bool(abs(run.error_um["x"]).max() < 6)
    ((5000,), True)
    >>> round(run.figures["max_um"], 1)
    5.6
    >>> run.save("run.h5")
    >>> print(run)  # doctest: +ELLIPSIS
    mode pid
    axis                     max (µm)  max (%)  rms (µm)  mean removed (µm)
    x     last four periods  ...
    """

    recording: Recording
    capture: Capture
    figures: dict[str, Any]
    true_um: dict[str, Samples] | None = None
    """Where a virtual stage truly was, shape (n,) per axis; None on a real port."""
    triggers: Mapping[str, Samples] = field(default_factory=dict)
    """When each trigger output pulsed, by what it was told ("line"): times from the first tick of the path, shape (n,);
    those of joins into and out of it are left out."""
    meant_um: Mapping[str, Samples] = field(default_factory=dict)
    """The path that each axis is judged by, shape (n,): the one that was asked for, where the sensor's lag is known as
    the sensor would show it. ``r_um`` is what the device played of it. Empty in mode open."""

    @property
    def error_um(self) -> dict[str, Samples]:
        """What the figures are of: ``meant_um`` - measured position, shape (n,) per axis. Empty in mode open."""
        measured = {axis: self.recording.axes[axis].x_um for axis in self.meant_um}
        return {axis: self.meant_um[axis] - x_um for axis, x_um in measured.items() if x_um is not None}

    def with_pulses(self, pulses: Sequence[Pulses]) -> Run:
        """With what these outputs were recorded to do; their numbers are the figures ``triggers``."""
        ticks, begin, end = self.capture.ticks, self.capture.recorded_from, self.capture.end_tick
        found: dict[str, Samples] = {}
        for output, one in enumerate(pulses):
            pulsed = pulses_of(self.capture.axes, output)
            if pulsed is not None:
                found[one.name] = (ticks[pulsed & (ticks >= begin) & (ticks < end)] - begin) / TICK_HZ
        if not found:
            return self
        counts = {name: len(times_s) for name, times_s in found.items()}
        return replace(self, figures=self.figures | {"triggers": counts}, triggers=found)

    def with_predicted(self, predicted: Mapping[str, Mapping[str, Any]]) -> Run:
        """With what the rehearsal said of each axis among its figures, as ``predicted``."""
        of_axes = ((axis, one) for axis, one in self.of_axes() if axis in predicted)
        figures = {axis: one | {"predicted": dict(predicted[axis])} for axis, one in of_axes}
        if not figures:
            return self
        whole = {"axes": self.figures["axes"] | figures} if "axes" in self.figures else next(iter(figures.values()))
        return replace(self, figures=self.figures | whole)

    @property
    def t_s(self) -> Samples:
        """Times, shape (n,); 0 is the first tick of the path."""
        return self.recording.t_s

    @property
    def columns(self) -> Mapping[str, Samples]:
        """The samples by column, in the order of a CSV header: arrays of shape (n,)."""
        return self.recording.columns

    @property
    def mode(self) -> str:
        """The mode it was driven in."""
        return str(self.figures["mode"])

    def of_axes(self) -> Iterator[tuple[str, dict[str, Any]]]:
        """The figures of each axis."""
        several: Mapping[str, dict[str, Any]] | None = self.figures.get("axes")
        yield from several.items() if several else ((axis, self.figures) for axis in self.recording.axes)

    def tables(self) -> list[Table | str]:
        headings = ("axis", "", "max (µm)", "max (%)", "rms (µm)", "mean removed (µm)")
        rows, said = [], []
        for axis, figures in self.of_axes():
            if figures["max_um"] is None:
                moved = f"{figures['measured_range_um']:.4g} µm peak-to-peak"
                said.append(f"{axis} moved {moved} (open loop: no error to judge)")
                continue
            parts = [(figures["judged"], figures)]
            if any(figures[name] != value for name, value in figures["from_rest"].items()):
                parts.append(("from rest", figures["from_rest"]))
            if "true" in figures:
                parts.append(("true position", figures["true"]))
            for label, part in parts:
                numbers = (f"{part[name]:.4g}" for name in ("rms_um", "max_um_mean_removed"))
                rows.append((axis, label, f"{part['max_um']:.4g}", f"{part['max_pct']:.2f}", *numbers))
        counted = f"{self.figures['ticks']} ticks, {self.figures['dropped']} dropped"
        if self.triggers:
            said.append("pulses: " + ", ".join(f"{name} {len(times_s)}" for name, times_s in self.triggers.items()))
            said += [f"{name} never pulsed: {NEVER_AT_REST}" for name in self.triggers if self._never_settled(name)]
        return [*said, *([Table(headings, tuple(rows), f"mode {self.mode}")] if rows else []), counted]

    def _never_settled(self, name: str) -> bool:
        return name.endswith("target") and not len(self.triggers[name])

    def plot(self) -> Figure:
        """Reference, position and error of every axis; in mode open voltage and position."""
        if self.mode == "open":
            return self.recording.plot()
        from phaselead.control.pictures import tracking_figure  # matplotlib is slow to load and is needed here only

        return tracking_figure(self.recording, self.meant_um)

    def save(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
        """Writes .h5 with all that a replay needs, or .csv, .mat or .parquet with the columns alone.

        Raises BadInput for another suffix, and where the file exists and ``overwrite`` is False.
        """
        if Path(path).suffix.lower() in RUN_SUFFIXES and (overwrite or not Path(path).exists()):
            write_run(path, self.capture, self.recording, self.true_um)
        else:
            export(self.recording, path, overwrite=overwrite)

    def __repr__(self) -> str:
        return f"<Run {self.mode}: {len(self.t_s)} ticks, axes {''.join(self.recording.axes)}>"
