"""A model judged on recordings, as one result: a table, a figure, columns."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from phaselead.identify.verification import Verification, View, verification_dict
from phaselead.result import Result, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Verifications(Result, list[Verification]):
    """Errors of one view of a model, one entry for each driven axis of each recording: a list that prints as a table.

    Each entry has ``file``, ``axis``, ``max_um``, ``mean_um`` (mean of the error's size), ``range_um`` (measured
    peak-to-peak), and ``max_pct`` and ``mean_pct`` of that range.

    >>> import phaselead as pl
    >>> with pl.connect() as dev:
    ...     model = pl.fit(dev.record("sine:5V@5Hz", duration=1))
    ...     other = dev.record("sine:4V@5Hz", duration=1)
    >>> report = pl.verify(model, other)
    >>> len(report), report[0].axis, report[0].max_pct < 10
    (1, 'x', True)
    >>> print(report)  # doctest: +ELLIPSIS
    time view ...
    record       axis  max (µm)  mean |e| (µm)  range (µm)  max (%)  mean (%)
    sine:4V@5Hz  x     ...
    """

    def __init__(
        self,
        verifications: Iterable[Verification] = (),
        view: View = "time",
        model: str = "",
        model_sha256: str = "",
    ) -> None:
        list.__init__(self, verifications)
        self.model_sha256 = model_sha256
        self.view: View = view
        self.model_name = model

    @property
    def columns(self) -> dict[str, list[Any]]:
        """One entry for each verification: file, axis, max_um, mean_um, range_um, max_pct, mean_pct."""
        names = ("file", "axis", "max_um", "mean_um", "range_um", "max_pct", "mean_pct")
        return {name: [asdict(one)[name] for one in self] for name in names}

    def as_dict(self) -> dict[str, Any]:
        """As ``phaselead verify --json`` writes it."""
        return {"records": [verification_dict(one) for one in self]}

    def tables(self) -> list[Table | str]:
        headings = ("record", "axis", "max (µm)", "mean |e| (µm)", "range (µm)", "max (%)", "mean (%)")
        rows = tuple(
            (
                v.file,
                v.axis,
                *(f"{value:.4g}" for value in (v.max_um, v.mean_um, v.range_um)),
                *(f"{value:.2f}" for value in (v.max_pct, v.mean_pct)),
            )
            for v in self
        )
        return [Table(headings, rows, f"{self.view} view of {self.model_name}" if self.model_name else "")]

    def plot(self) -> Figure:
        """Largest and mean error of every record, in per cent of its range."""
        from phaselead.identify.pictures import error_bars  # matplotlib is slow to load and is needed here only

        labels = [f"{PurePath(v.file).name or 'recording'} ({v.axis})" for v in self]
        return error_bars(labels, [v.max_pct for v in self], [v.mean_pct for v in self])

    def __repr__(self) -> str:
        return f"<{len(self)} verifications, {self.view} view>"
