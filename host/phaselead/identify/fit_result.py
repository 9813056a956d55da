"""A fit as one result: the model, how it was come by, and how it does on held-out records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

from phaselead.identify.fitting import FitReport
from phaselead.identify.verification import View
from phaselead.identify.verifications import Verifications
from phaselead.identify.words import describe_axis, describe_coupling
from phaselead.model import AxisModel, Stage, predict
from phaselead.record import Recording, Samples
from phaselead.result import Result, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


FAR_WORSE = 10.0
"""Held-out error over that of the model's own records, both as shares of the range. It is 0.15 to 0.45
with the default sines on the built-in stages, and 350 with a single sine of 2 V on xyz250."""


@dataclass(frozen=True, repr=False)
class FitResult(Result):
    """A fitted model. It is taken wherever a model is, and prints in words what was fitted and what the fit left;
    ``report.lines()`` has every number.

    ``model`` is the ``Stage``, ``report`` has the standard errors and residuals, ``records`` are what was fitted,
    ``held_out`` are verifications by view ("time", "table"), after ``identify`` only; ``holds`` by axis what was
    recorded for creep.

    >>> import phaselead as pl
    >>> with pl.connect() as dev:
    ...     fitted = pl.fit(dev.record("sine:5V@5Hz", duration=1))
    >>> fitted
    <FitResult 'fitted': axes x, 1 records>
    >>> fitted.model.axis("x").time.residual_um_rms < 1
    True
    >>> print(fitted)  # doctest: +ELLIPSIS
    axis x: ... um/V, hysteresis ... % of the travel, ...
    >>> fitted.save("stage.toml")
    """

    model: Stage
    report: FitReport
    records: Sequence[Recording] = ()
    held_out: Mapping[View, Verifications] = field(default_factory=dict)
    holds: Mapping[str, Recording] = field(default_factory=dict)

    @property
    def axes(self) -> Mapping[Any, AxisModel]:
        """The model's axes, keyed "x", "y", "z"."""
        return self.model.axes

    def axis(self, name: str) -> AxisModel:
        """The model of one axis. Raises BadInput where there is none."""
        return self.model.axis(name)

    @property
    def columns(self) -> dict[str, list[Any]]:
        """The model's parameters: axis, part, parameter, value, low_95, high_95."""
        return self.model.columns

    def as_dict(self) -> dict[str, Any]:
        """As ``--json`` writes it: residuals, standard errors, records, messages; after identify ``held_out``."""
        held_out = {view: found.as_dict()["records"] for view, found in self.held_out.items()}
        return self.report.as_dict() | ({"held_out": held_out} if held_out else {})

    def summary(self) -> list[str]:
        """Each axis in a line of words."""
        straight = self.report.base == "linear"
        found = [
            describe_axis(axis, self.model.axis(axis), self.records, straight=straight) for axis in self.report.time
        ]
        return found if self.report.coupling is None else [*found, describe_coupling(self.report.coupling[0])]

    def doubts(self) -> list[str]:
        """One line for each axis whose time view predicts held-out records far worse than those it was fitted to."""
        found = []
        for axis, result in self.report.time.items():
            own_pct = 100 * max(one.rms_um / one.range_um for one in result.records)
            apart_pct = max((one.mean_pct for one in self.held_out.get("time", ()) if one.axis == axis), default=0.0)
            if apart_pct > FAR_WORSE * own_pct:
                found.append(
                    f"axis {axis}: held-out records are off by up to {apart_pct:.2g} % of their range, the model's own "
                    f"by {own_pct:.2g} %: these records do not tell what the stage does elsewhere; identify it "
                    "with more levels and frequencies"
                )
        return found

    def tables(self) -> list[Table | str]:
        held_out = [part for found in self.held_out.values() for part in found.tables()]
        return [*self.summary(), *self.report.remarks(), *self.doubts(), *held_out]

    def _repr_html_(self) -> str:
        return self.model._repr_html_() + "".join(found._repr_html_() for found in self.held_out.values())

    def plot(self) -> Figure:
        """Measurement, model and what the model leaves over the scored rows of the record that it fits worst; without
        records, the model's loop."""
        from phaselead.identify.pictures import against_model  # matplotlib is slow to load and is needed here only

        worst = self._worst()
        if worst is None:
            return self.model.plot()
        record, axis = worst
        measured_um, model_um = record.axes[axis].x_um, self.predicted_um(record, axis)
        assert measured_um is not None
        name = f"{PurePath(record.source).name} ({axis})"
        rows = record.scored
        return against_model(name, record.t_s[rows], measured_um[rows], model_um[rows])

    def predicted_um(self, record: Recording, axis: str) -> Samples:
        """The model's position (n,) in um in one of the records of the fit, from where that found it to begin and at
        the offset that it has."""
        found = self.report.time[axis]
        known = next(one for one in found.records if one.source == record.source)
        turned_V = {} if known.turned_V is None else {axis: known.turned_V}
        x_um = predict(self.model, record, turned_V=turned_V).axes[axis].x_um
        assert x_um is not None
        return x_um + known.mean_um if found.own_offsets else x_um

    def _worst(self) -> tuple[Recording, str] | None:
        """The record and axis with the largest residual, in parts of its range."""
        known = {record.source: record for record in self.records}
        left = [
            (one.rms_um / one.range_um, one.source, axis)
            for axis, result in self.report.time.items()
            for one in result.records
            if one.source in known
        ]
        if not left:
            return None
        _, source, axis = max(left)
        return known[source], axis

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Writes the model's stage file, whole or not at all. Raises BadInput where it exists and ``overwrite`` is
        False, OSError where it cannot be written."""
        self.model.save(path, overwrite=overwrite)

    def __repr__(self) -> str:
        return f"<FitResult {self.model.name!r}: axes {', '.join(sorted(self.axes))}, {len(self.records)} records>"
