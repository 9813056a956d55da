"""What of an axis is a list, as the page edits it: the filters behind its PID, and the effects of its model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from phaselead.errors import BadInput
from phaselead.model import SECTIONS_IN_LOOP, AdoptedEffect, AxisModel, LoopFilter, catalogue

FILTERS, EFFECTS = "filters", "effects"
FILTERS_TITLE = "Filters of the loop"
LEAST = 1e-6
"""Of a time or a frequency without a range of its own."""
Row = dict[str, Any]


def filter_rows(model: AxisModel) -> list[Row]:
    """Every field of every place that a filter can have; None where there is none."""
    there = model.gains.filters if model.gains is not None else None
    return [
        {
            "part": FILTERS,
            "title": FILTERS_TITLE,
            "name": f"{i}.{name}",
            "what": field.description or "",
            "value": getattr(there[i], name) if there and i < len(there) else None,
        }
        for i in range(SECTIONS_IN_LOOP)
        for name, field in LoopFilter.model_fields.items()
    ]


def effect_rows(model: AxisModel) -> list[Row]:
    """Every number of every effect, with its range."""
    return [
        {
            "part": _part(i, adopted),
            "title": catalogue()[adopted.name].title,
            "name": name,
            "what": what,
            "value": value,
            "low": low,
            "high": high,
        }
        for i, adopted in enumerate(model.effects)
        for name, (value, what, low, high) in _numbers(adopted).items()
    ]


def _part(i: int, adopted: AdoptedEffect) -> str:
    return f"{EFFECTS}.{i}.{adopted.name}"


def _numbers(adopted: AdoptedEffect) -> dict[str, tuple[float, str, float | None, float | None]]:
    """Value, words and range of each number; those of a list are called k.0, k.1."""
    known = {one.name: one for one in catalogue()[adopted.name].parameters}
    found: dict[str, tuple[float, str, float | None, float | None]] = {}
    for name, value in adopted.params.items():
        about = known.get(name)
        what = ", ".join(filter(None, (about.doc, about.unit if about.unit != "1" else ""))) if about else _words(name)
        low, high = (about.low, about.high) if about else (LEAST if name.endswith(("_s", "_Hz")) else None, None)
        many = value if isinstance(value, tuple) else (value,)
        for i, one in enumerate(many):
            found[f"{name}.{i}" if isinstance(value, tuple) else name] = (one, what, low, high)
    return found


def _words(name: str) -> str:
    """Of a number that the catalogue does not list: the other form of an effect, or one of several alike."""
    return {"s": "time constant, s", "Hz": "frequency, Hz"}.get(name.rpartition("_")[2], "share of the motion")


def with_filters(content: dict[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """The gains, as a stage file has them, with fields of filters replaced: "0.poles_Hz": 500. A filter of which all is
    left out is removed. Raises BadInput for one that is not there or is no number; the stage file checks the rest."""
    places: list[dict[str, Any]] = [dict(one) for one in content.get("filters", ())]
    places += [{} for _ in range(SECTIONS_IN_LOOP - len(places))]
    for key, value in given.items():
        place, _, name = key.partition(".")
        if not (place.isdecimal() and int(place) < len(places) and name in LoopFilter.model_fields):
            raise BadInput(f"{FILTERS}.{key}: is no setting")
        _refuse_no_number(f"{FILTERS}.{key}", value, may_lack=True)
        places[int(place)][name] = value
    kept = [{name: value for name, value in one.items() if value is not None} for one in places]
    for one in filter(None, kept):
        if not one.get("zeros_Hz"):  # poles alone
            one.update(zeros_Hz=0.0, zeros_zeta=one.get("zeros_zeta", 0.0))
    rest = {name: value for name, value in content.items() if name != "filters"}
    return rest | ({"filters": tuple(filter(None, kept))} if any(kept) else {})


def with_effects(effects: tuple[AdoptedEffect, ...], given: Mapping[str, Any]) -> tuple[AdoptedEffect, ...]:
    """The effects with numbers replaced, "1.resonance.f_Hz": 190, or removed, "1.resonance": None.

    A number that somebody chose has no interval, and what the effect explains is not known any more. Raises BadInput
    for one that is not there, is no number, or lies outside its range.
    """
    found: list[AdoptedEffect | None] = list(effects)
    for key, value in given.items():
        at, _, rest = key.partition(".")
        name, _, number = rest.partition(".")
        i = int(at) if at.isdecimal() else len(effects)
        if i >= len(effects) or effects[i].name != name:
            raise BadInput(f"{EFFECTS}.{key}: is no effect of this model; look at the page again")
        adopted = found[i]
        if not number:
            if value is not None:
                raise BadInput(f"{EFFECTS}.{key} = {value!r}: an effect is removed, or its numbers are given")
            found[i] = None
        elif adopted is not None:
            found[i] = _with_number(adopted, number, value)
    return tuple(one for one in found if one is not None)


def _with_number(adopted: AdoptedEffect, key: str, value: Any) -> AdoptedEffect:
    if key not in _numbers(adopted):
        raise BadInput(f"{adopted.name}.{key}: is no number of this effect")
    _refuse_no_number(f"{adopted.name}.{key}", value)
    _, _, low, high = _numbers(adopted)[key]
    least, most = -math.inf if low is None else low, math.inf if high is None else high
    if not least <= value <= most:
        bounds = f"{least:g} to {most:g}" if math.isfinite(most) else f"at least {least:g}"
        raise BadInput(f"{adopted.name}.{key} = {value:g}: must be {bounds}")
    name, _, at = key.partition(".")
    old = adopted.params[name]
    new = tuple(value if str(i) == at else one for i, one in enumerate(old)) if isinstance(old, tuple) else value
    ci95 = {one: interval for one, interval in adopted.ci95.items() if one != name}
    return adopted.model_copy(update={"params": {**adopted.params, name: new}, "ci95": ci95, "share": None})


def _refuse_no_number(key: str, value: Any, *, may_lack: bool = False) -> None:
    if may_lack and value is None:
        return
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise BadInput(f"{key} = {value!r}: must be a number")
