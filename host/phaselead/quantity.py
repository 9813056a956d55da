"""Numbers with a unit, as a user writes them on the command line and in Python."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from numbers import Real

from phaselead.errors import BadInput

Quantity = float | str
"""A number in the unit that the argument names, or text with one: 0.5, "500ms"."""
Quantities = str | Iterable[Quantity]
"""Several of them, or one text: [1, 2], "1V,500mV"."""

IN_SECONDS: Mapping[str, float] = {"": 1.0, "s": 1.0, "ms": 1e-3, "min": 60.0}
VOLTS: Mapping[str, float] = {"V": 1.0, "mV": 1e-3}
"""A voltage says its unit: 500 may be meant as either."""
HERTZ: Mapping[str, float] = {"": 1.0, "Hz": 1.0, "kHz": 1e3, "mHz": 1e-3}
V_PER_S: Mapping[str, float] = {"V/s": 1.0, "V/ms": 1e3, "mV/s": 1e-3}
"""As a voltage. The first unit of each of these that has a name is the usual one."""
UM_PER_S: Mapping[str, float] = {"": 1.0, "um/s": 1.0, "mm/s": 1e3}
UM: Mapping[str, float] = {"": 1.0, "um": 1.0, "nm": 1e-3, "mm": 1e3}
PURE: Mapping[str, float] = {"": 1.0}
SHARES: Mapping[str, float] = {"": 1.0, "%": 0.01}


def digits(value: float, count: int) -> str:
    """A number with so many digits that count, up to a million without an exponent: "1000", not "1e+03"."""
    return f"{float(f'{value:.{count}g}'):g}"


def numbers(name: str, text: str | None, units: Mapping[str, float]) -> list[float] | None:
    """``1V,500mV`` or ``1,2,4V`` as numbers in the first of ``units``; None stays None. A number without a unit has
    that of the next. Raises BadInput."""
    if text is None:
        return None
    found: list[float] = []
    unit = ""
    for part in reversed(text.replace("\N{MICRO SIGN}", "u").replace("\N{GREEK SMALL LETTER MU}", "u").split(",")):
        written = part.strip()
        match = re.fullmatch(r"([^a-zA-Z%]*(?:[eE][+-]?\d+)?)\s*([a-zA-Z%][a-zA-Z/]*)?", written)
        unit = match[2] or unit if match else unit
        if not unit and "" not in units:
            raise BadInput(f"{name} {text}: {written} has no unit; write {' or '.join(written + u for u in units)}")
        known = " or ".join(filter(None, units))
        try:
            found.append(float(match[1]) * units[unit] if match else math.nan)
        except (ValueError, KeyError):
            raise BadInput(f"{name}: {written!r} is no number with a unit of {known}") from None
        if not math.isfinite(found[-1]):
            raise BadInput(f"{name}: {written!r} is no finite number with a unit of {known}")
    return found[::-1]


def number(name: str, text: str | None, units: Mapping[str, float]) -> float | None:
    """One of them. Raises BadInput."""
    found = numbers(name, text, units)
    if found is not None and len(found) != 1:
        raise BadInput(f"{name} {text}: give one number")
    return None if found is None else found[0]


def quantity(name: str, value: Quantity | None, units: Mapping[str, float]) -> float | None:
    """An argument of a method: a number is in the first of ``units``, text says its unit; None stays None. Raises
    BadInput for anything else."""
    if value is None or isinstance(value, str):
        return number(name, value, units)
    if isinstance(value, bool) or not isinstance(value, Real):
        known = " or ".join(repr(f"1{unit}") for unit in units if unit)
        raise BadInput(f"{name}: a {type(value).__name__} is no number; give one, or text as in {known}")
    if not math.isfinite(value):
        raise BadInput(f"{name} {float(value):g}: give a finite number")
    return float(value)


def required(name: str, value: Quantity, units: Mapping[str, float]) -> float:
    """An argument that cannot be left out. Raises BadInput."""
    found = quantity(name, value, units)
    if found is None:
        raise BadInput(f"{name}: None is no number; give one")
    return found


def quantities(name: str, values: Quantities | None, units: Mapping[str, float]) -> list[float] | None:
    """Several. Raises BadInput."""
    if values is None or isinstance(values, str):
        return numbers(name, values, units)
    if not isinstance(values, Iterable):
        raise BadInput(f"{name}: a {type(values).__name__} is no list; give one, as in [1, 2]")
    return [required(name, value, units) for value in values]
