"""The settings that the page edits, of an axis, by name, in units: those of the stage file (limits, converters, gains,
filters, effects) and the hard limits, which the device keeps itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from phaselead.device import AxisLimits, Limits
from phaselead.errors import BadInput
from phaselead.model import AxisModel, Gains, Stage, explained, provenance_of
from phaselead.scope.filters_and_effects import (
    EFFECTS,
    FILTERS,
    effect_rows,
    filter_rows,
    with_effects,
    with_filters,
)

PARTS = ("limits", "gains", "sensor", "actuator")
TITLES = {"limits": "Limits", "gains": "Gains", "sensor": "Sensor", "actuator": "Output"}
NOT_EDITED = {"origin", "filters"}
"""Of the gains: where they come from is said of what is measured; filters are a part of their own."""
HARD = "hard"
HARD_TITLE = "Hard limits of the device"
HARD_WORDS = {
    "u_min_V": "lowest output, V",
    "u_max_V": "highest output, V",
    "slew_V_per_s": "largest rate of the output, V/s",
    "x_min_um": "lowest position, um",
    "x_max_um": "highest position, um",
}
NO_GAINS = {"kp_V_per_um": 0.0, "ki_V_per_um_s": 0.0, "kd_V_s_per_um": 0.0}


def settings_of(stage: Stage | None, hard: Limits | None = None) -> dict[str, list[dict[str, Any]]]:
    """By axis, every setting: part, its title, name, what it is, value (None: left out)."""
    axes = {} if stage is None else stage.axes
    found = {axis: _rows_of(model) for axis, model in axes.items()}
    for axis, limits in (hard.axes if hard is not None else {}).items():
        found.setdefault(axis, []).extend(_hard_rows(limits))
    return dict(sorted(found.items()))


def _rows_of(model: AxisModel) -> list[dict[str, Any]]:
    fields = [row for part in PARTS for row in _rows(model, part)]
    return [*fields, *filter_rows(model), *effect_rows(model)]


def _hard_rows(limits: AxisLimits) -> list[dict[str, Any]]:
    return [
        {"part": HARD, "title": HARD_TITLE, "name": name, "what": what, "value": getattr(limits, name)}
        for name, what in HARD_WORDS.items()
    ]


def changed_hard(limits: AxisLimits, given: Mapping[str, Any]) -> AxisLimits:
    """The hard limits with these replaced: "hard.u_max_V": 8, None for no limit. Raises BadInput as ``changed``."""
    values = {}
    for key, value in given.items():
        name = str(key).partition(".")[2]
        if name not in HARD_WORDS:
            raise BadInput(f"{key}: is no hard limit")
        if value is not None and (isinstance(value, bool) or not isinstance(value, int | float)):
            raise BadInput(f"{key} = {value!r}: must be a number")
        values[name] = value
    return replace(limits, **values)


def _rows(model: AxisModel, part: str) -> list[dict[str, Any]]:
    values = getattr(model, part)
    kind = Gains if values is None else type(values)
    return [
        {
            "part": part,
            "title": TITLES[part],
            "name": name,
            "what": field.description or "",
            "value": None if values is None else getattr(values, name),
        }
        for name, field in kind.model_fields.items()
        if name not in NOT_EDITED
    ]


def changed(stage: Stage, axis: str, given: Mapping[str, Any]) -> Stage:
    """The stage with settings of an axis replaced: "limits.u_max_V": 8, "filters.0.poles_Hz": 500,
    "effects.1.resonance.f_Hz": 190; None where one is left out, or an effect removed.

    Raises BadInput for one that is not there, is no number, or makes no sense beside the others, by its name.
    """
    before = stage.axis(axis)
    parts: dict[str, dict[str, Any]] = {}
    lists: dict[str, dict[str, Any]] = {}
    for key, value in given.items():
        part, _, name = str(key).partition(".")
        if part in (FILTERS, EFFECTS):
            lists.setdefault(part, {})[name] = value
            continue
        if name not in {row["name"] for row in (_rows(before, part) if part in PARTS else [])}:
            raise BadInput(f"{key}: is no setting of {axis}")
        parts.setdefault(part, {})[name] = value
    if not parts and not lists:
        raise BadInput("nothing was changed")
    content = before.model_dump(exclude_none=True)
    for part, values in parts.items():
        whole = {**content.get(part, NO_GAINS if part == "gains" else {}), **values}
        if part == "gains":
            whole.pop("origin", None)  # they are somebody's choice from here on
        content[part] = {name: value for name, value in whole.items() if value is not None}
    if FILTERS in lists:
        gains = {**content.get("gains", NO_GAINS)}
        gains.pop("origin", None)
        content["gains"] = with_filters(gains, lists[FILTERS])
    if EFFECTS in lists:
        effects = with_effects(before.effects, lists[EFFECTS])
        content["effects"] = [one.model_dump(exclude_none=True) for one in effects]
    with explained(f"axis {axis}"):
        after = AxisModel.model_validate(content)
    origin = provenance_of(stage, []).model_copy(update={"data": stage.provenance.data})
    return stage.model_copy(update={"axes": {**stage.axes, axis: after}, "provenance": origin})
