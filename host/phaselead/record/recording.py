"""A recording: what was applied, what was measured and, in closed loop, what was asked for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from phaselead.record.axis_record import AxisRecord, Samples
from phaselead.record.columns import columns_of
from phaselead.record.digest import Source, samples_sha256
from phaselead.record.sampled import SampledResult
from phaselead.record.wall_clock import T0_UTC
from phaselead.result import Result, Table, pairs_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class Recording(SampledResult):
    """A uniformly sampled recording of one or three axes.

    ``axes`` is keyed "x", "y", "z"; a single-axis file without a note of its axis is "x".
    ``scored`` are the samples to judge: all of them unless the argument carried a window, in which case the
    rows before it only warm the model's memory (and rows after it have been cut off).

    The columns are attributes too, float64 arrays of shape (n,): ``t_s``, ``u_V``, ``x_um``, in closed loop ``r_um``
    (several axes: ``ux_V``, ``y_um``, ``rz_um`` ...). A column that is not there raises AttributeError.

    >>> import phaselead as pl
    >>> with pl.connect() as dev:
    ...     recording = dev.record("sine:5V@5Hz", duration=0.4)
    >>> recording.x_um.shape
    (2000,)
    >>> list(recording.columns)
    ['t_s', 'u_V', 'x_um']
    >>> print(recording)  # doctest: +ELLIPSIS
    source         sine:5V@5Hz
    samples        2000
    ...
    """

    t_s: Samples
    axes: dict[str, AxisRecord]
    scored: slice = field(default_factory=lambda: slice(None))
    source: str = ""
    """The argument it was read from, for messages."""
    sha256: str = ""
    """Of the file's bytes; empty where it was not read from one."""
    meta: dict[str, Any] = field(default_factory=dict)
    """Attributes of the file: stage file text, device, gaps ..."""
    trigger: NDArray[np.uint8] | None = None
    """What the device's triggers did in each row, shape (n,): bits 0 to 2 for an output that pulsed, bit 7 for an edge
    at the input. None where that was not recorded."""

    @property
    def rate_Hz(self) -> float:
        """Samples a second, from the first row to the last."""
        return (len(self.t_s) - 1) / float(self.t_s[-1] - self.t_s[0])

    @property
    def from_rest(self) -> bool:
        """Whether the memory starts from rest: no warm-up rows precede the scored ones."""
        return (self.scored.start or 0) == 0

    @property
    def scored_s(self) -> tuple[float, float]:
        """First and last time of the samples to judge."""
        judged_s = self.t_s[self.scored]
        return float(judged_s[0]), float(judged_s[-1])

    @property
    def columns(self) -> Mapping[str, Samples]:
        """The samples by column, in the order of a CSV header: arrays of shape (n,)."""
        return columns_of(self.t_s, self.axes)

    @property
    def samples_sha256(self) -> str:
        """SHA-256 of the samples, the same in every file that holds them to the last bit."""
        return samples_sha256(self.t_s, self.axes)

    @property
    def traced(self) -> Source:
        """Its name, and the SHA-256 of its file, else of its samples: what a report traces its numbers to."""
        return Source(self.source or "recording", self.sha256 or self.samples_sha256)

    def facts(self) -> dict[str, Any]:
        """Length, rate, axes and ranges, and what its file says of where it came from: what ``log info`` prints. With a
        window also what is judged; the rows before it are there to warm up a model's memory."""
        rate_Hz = _rate_Hz(self) if len(self.t_s) > 1 else None
        ends = float(self.t_s[0]), float(self.t_s[-1])
        facts = facts_of(len(self.t_s), rate_Hz, *ends, "".join(self.axes), self.ranges(), self.meta)
        return ({"source": self.source} if self.source else {}) | facts | self._window()

    def _window(self) -> dict[str, Any]:
        """What is judged, where that is not all."""
        judged = self.t_s[self.scored]
        if len(judged) in (0, len(self.t_s)):
            return {}
        return {"judged_samples": len(judged), "judged_from_s": float(judged[0]), "judged_to_s": float(judged[-1])}

    def ranges(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest value by axis, column and unit, as in "x_u_{}_V"."""
        found = {}
        for name, axis in self.axes.items():
            for label, unit, values in (("u", "V", axis.u_V), ("x", "um", axis.x_um), ("r", "um", axis.r_um)):
                if values is not None:
                    found[f"{name}_{label}_{{}}_{unit}"] = float(np.min(values)), float(np.max(values))
        return found

    def tables(self) -> list[Table | str]:
        return [pairs_table(self.facts())]

    def plot(self) -> Figure:
        """Voltage and position over time, and position over voltage; the reference dashed."""
        from phaselead.drawing import samples_figure  # matplotlib is slow to load and is needed here only

        return samples_figure(self.columns)

    def __repr__(self) -> str:
        name = PurePath(self.source).name or "recording"
        return f"<Recording {name}: {len(self.t_s)} samples, axes {''.join(self.axes)}>"


class Recordings(Result, list[Recording]):
    """Recordings in the order they were given: a list that prints as a table, one line each.

    >>> import phaselead as pl
    >>> with pl.connect() as dev:
    ...     first = dev.record("sine:5V@5Hz", duration=0.4)
    ...     second = dev.record("sine:3V@5Hz", duration=0.4)
    >>> print(pl.read([first, second]))
    recording    samples  rate (Hz)  from (s)  to (s)  axes  scored
    sine:5V@5Hz     2000       5000         0  0.3998  x       2000
    sine:3V@5Hz     2000       5000         0  0.3998  x       2000
    """

    def __init__(self, recordings: Iterable[Recording] = ()) -> None:
        list.__init__(self, recordings)

    @property
    def columns(self) -> dict[str, list[Any]]:
        """One entry for each recording: name, samples, rate, first and last time, axes, rows to score."""
        return {
            "recording": [PurePath(r.source).name or f"{i}" for i, r in enumerate(self, 1)],
            "samples": [len(r.t_s) for r in self],
            "rate_Hz": [r.facts()["rate_Hz"] for r in self],
            "from_s": [float(r.t_s[0]) for r in self],
            "to_s": [float(r.t_s[-1]) for r in self],
            "axes": ["".join(r.axes) for r in self],
            "scored": [len(r.t_s[r.scored]) for r in self],
        }

    def tables(self) -> list[Table | str]:
        headings = ("recording", "samples", "rate (Hz)", "from (s)", "to (s)", "axes", "scored")
        rows = zip(*self.columns.values(), strict=True)
        cells = (tuple(f"{c:.6g}" if isinstance(c, float) else str(c) for c in row) for row in rows)
        return [Table(headings, tuple(cells))]

    def plot(self) -> Figure:
        """Position over voltage of every recording, one panel for each axis."""
        from phaselead.drawing import loops_figure  # matplotlib is slow to load and is needed here only

        return loops_figure([(name, r.axes) for name, r in zip(self.columns["recording"], self, strict=True)])

    def __repr__(self) -> str:
        return f"<{len(self)} recordings: {', '.join(self.columns['recording'])}>"


def facts_of(
    samples: int,
    rate_Hz: float | None,
    from_s: float,
    to_s: float,
    axes: str,
    ranges: Mapping[str, tuple[float, float]],
    meta: Mapping[str, Any],
) -> dict[str, Any]:
    """``Recording.facts`` of a recording that need not be in memory; ``ranges`` as ``Recording.ranges``."""
    facts: dict[str, Any] = {
        "samples": samples,
        "rate_Hz": None if rate_Hz is None else round(rate_Hz, 6),
        "from_s": from_s,
        "to_s": to_s,
        "axes": axes,
    }
    for name, (low, high) in ranges.items():
        facts |= {name.format("min"): low, name.format("max"): high}
    told = (T0_UTC, "target", "build_id", "mode", "dropped_ticks", "missing_ticks", "gaps", "ended")
    return facts | {key: meta[key] for key in told if key in meta}


def _rate_Hz(recording: Recording) -> float:
    """The rate between gaps: the mean over the record counts lost samples as time without any."""
    return 1 / float(np.median(np.diff(recording.t_s))) if recording.meta.get("gaps") else recording.rate_Hz
