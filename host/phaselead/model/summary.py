"""A stage as tables, as columns and as a figure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from phaselead.model.axis import AdoptedEffect, AxisModel
from phaselead.model.chain import simulate
from phaselead.model.effects import Place, effect
from phaselead.record import AxisRecord
from phaselead.result import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Row = tuple[str, str, str, float, float, float]
"""Axis, part ("time view", an effect's name), parameter, value, and its 95 % interval, nan where not known."""

SHOWN = 6
"""Elements of a list that a line has room for."""
LOOP_Hz, LOOP_ROWS = 1.0, 1000
"""The loop that is drawn: two periods of a slow sine, the second of them shown."""


def parameter_rows(axes: Mapping[Any, AxisModel]) -> list[Row]:
    """Every parameter of every axis: gain, plays, dead zones, table coefficients, gains and adopted effects."""
    found: list[Row] = []
    for name, model in axes.items():
        if model.time is not None:
            found += _rows(name, "time view", model.time.model_dump(exclude={"u_range_V", "rate_Hz"}))
        if model.table is not None:
            found += _rows(name, "table view", model.table.model_dump(include={"a_um_per_V", "b_deg", "c_um"}))
        if model.gains is not None:
            found += _rows(name, "gains", model.gains.model_dump(exclude_none=True, exclude={"origin"}))
        for adopted in model.effects:
            found += _rows(name, adopted.name, adopted.params, _intervals(adopted))
    return found


def _intervals(adopted: AdoptedEffect) -> dict[str, tuple[tuple[float, float], ...]]:
    """One interval for each element of a parameter."""
    pairs: dict[str, Any] = dict(adopted.ci95)
    return {key: pair if isinstance(pair[0], tuple) else (pair,) for key, pair in pairs.items() if pair}


def _rows(
    axis: str, part: str, values: Mapping[str, Any], ci95: Mapping[str, tuple[tuple[float, float], ...]] | None = None
) -> list[Row]:
    found = []
    for name, value in values.items():
        several = isinstance(value, tuple | list)
        elements = tuple(value) if several else (value,)
        pairs = (ci95 or {}).get(name, ())
        for i, element in enumerate(elements):
            low, high = pairs[i] if i < len(pairs) else (np.nan, np.nan)
            found.append((axis, part, f"{name} {i + 1}" if several else name, float(element), low, high))
    return found


def parameter_columns(axes: Mapping[Any, AxisModel]) -> dict[str, list[Any]]:
    """The parameters as the columns of a data frame."""
    names = ("axis", "part", "parameter", "value", "low_95", "high_95")
    return {name: [row[i] for row in parameter_rows(axes)] for i, name in enumerate(names)}


def axis_table(axes: Mapping[Any, AxisModel]) -> Table:
    """One line for each axis: which views it has, how well they fit, what was adopted."""
    headings = (
        "axis",
        "views",
        "gain without plays (um/V)",
        "voltages (V)",
        "residual (um rms)",
        "limits (V)",
        "effects",
    )
    rows = []
    for name, model in axes.items():
        view, limits = model.time, model.limits
        rows.append(
            (
                str(name),
                " and ".join(kind for kind in ("time", "table") if getattr(model, kind) is not None) or "none",
                f"{view.gain_um_per_V:.4g}" if view else "",
                f"{view.u_range_V[0]:.3g}..{view.u_range_V[1]:.3g}" if view else "",
                f"{view.residual_um_rms:.3g}" if view else "",
                f"{limits.u_min_V:.3g}..{limits.u_max_V:.3g}",
                ", ".join(adopted.name for adopted in model.effects) or "none",
            )
        )
    return Table(headings, tuple(rows))


def parameter_table(axes: Mapping[Any, AxisModel]) -> Table:
    """The parameters with their intervals, where these are known; a list in one line, its first elements shown."""
    lists: dict[tuple[str, str, str], list[Row]] = {}
    for row in parameter_rows(axes):
        lists.setdefault((row[0], row[1], row[2].partition(" ")[0]), []).append(row)
    rows = []
    for (axis, part, name), elements in lists.items():
        shown = ", ".join(f"{row[3]:.5g}" for row in elements[:SHOWN]) + (", ..." if len(elements) > SHOWN else "")
        low, high = elements[0][4:]
        interval = f"{low:.4g} .. {high:.4g}" if len(elements) == 1 and low <= high else ""
        rows.append((axis, part, name if len(elements) == 1 else f"{name} ({len(elements)})", shown, interval))
    headings, known = ("axis", "part", "parameter", "value", "95 % interval"), any(row[-1] for row in rows)
    return Table(headings, tuple(rows)) if known else Table(headings[:-1], tuple(row[:-1] for row in rows))


def stage_figure(axes: Mapping[Any, AxisModel]) -> Figure:
    """The steady loop of every axis over the voltages it was fitted on, without the adopted effects."""
    from phaselead.drawing import loops_figure  # matplotlib is slow to load and is needed here only

    return loops_figure([("model", {name: steady_loop(model) for name, model in axes.items()})])


def steady_loop(model: AxisModel) -> AxisRecord:
    """One period of a slow sine through the time view, without its delay, with what else the axis has of memory; else
    through the table view; empty without either."""
    t_s = np.arange(2 * LOOP_ROWS) / (LOOP_Hz * LOOP_ROWS)
    rise = 0.5 * (1 - np.cos(2 * np.pi * LOOP_Hz * t_s))
    if model.time is not None:
        low, high = model.time.u_range_V
        u_V = low + (high - low) * rise
        memory = tuple(e for e in model.effects if effect(e.name).place is Place.HYSTERESIS)
        slow = model.model_copy(update={"time": model.time.model_copy(update={"delay_s": 0.0}), "effects": memory})
        return AxisRecord(u_V[LOOP_ROWS:], simulate(slow, t_s, u_V)[LOOP_ROWS:])
    if model.table is not None:
        swing_V, f_Hz = model.table.swing_V[1], model.table.f_Hz[0]
        u_V = swing_V * rise
        return AxisRecord(u_V, np.asarray(model.table.response(t_s * LOOP_Hz / f_Hz, swing_V, f_Hz)))
    return AxisRecord(None, None)
