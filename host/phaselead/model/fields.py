"""Field types of the stage file: numbers, lists of numbers, spans, intervals; and ``Part``, the base of its tables."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, Strict
from pydantic_core import PydanticCustomError

from phaselead.model.validation_errors import fault

LARGEST = 1e9
"""No coefficient of a stage is beyond this in the units of the file; a larger one is a slip."""


def _as_number(value: object) -> object:
    """NumPy scalars are numbers too; booleans and text are not."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        fault("must be a number")
    if isinstance(value, float) and not math.isfinite(value):
        fault("must be a finite number")
    if abs(value) > LARGEST:
        fault(f"is out of range; no coefficient is larger than {LARGEST:g}: check its unit")
    return float(value)


def _as_list(value: object) -> object:
    return value.tolist() if isinstance(value, np.ndarray) else value


def _parameter(value: object) -> float | tuple[float, ...]:
    value = _as_list(value)
    if isinstance(value, (list, tuple)):
        return tuple(_element(item, f"[{i}]") for i, item in enumerate(value))
    return _element(value, "")


def _interval(value: object) -> tuple[Any, ...]:
    """(low, high), or one such pair per element of a list parameter."""
    value = _as_list(value)
    if not isinstance(value, (list, tuple)):
        fault("must be [low, high], or a list of such pairs")
    if value and all(isinstance(item, (list, tuple)) for item in value):
        return tuple(_interval_pair(item, f"[{i}]") for i, item in enumerate(value))
    return _interval_pair(value, "")


def _interval_pair(value: Sequence[object], suffix: str) -> tuple[float, float]:
    if len(value) != 2:
        fault("must be [low, high]", suffix)
    low, high = (_element(item, f"{suffix}[{i}]") for i, item in enumerate(value))
    if low > high:
        fault(f"has its low end {low:g} above its high end {high:g}; swap them", suffix)
    return low, high


def _element(value: object, suffix: str) -> float:
    try:
        return float(_as_number(value))  # type: ignore[arg-type]
    except PydanticCustomError as error:
        fault(str((error.context or {})["text"]), suffix)


Number = Annotated[float, BeforeValidator(_as_number)]
Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Numbers = Annotated[tuple[Number, ...], BeforeValidator(_as_list)]
Numbers3 = Annotated[tuple[Number, Number, Number], BeforeValidator(_as_list)]
Numbers6 = Annotated[tuple[Number, Number, Number, Number, Number, Number], BeforeValidator(_as_list)]
Matrix3 = Annotated[tuple[Numbers3, Numbers3, Numbers3], BeforeValidator(_as_list)]
Matrix6 = Annotated[tuple[Numbers6, Numbers6, Numbers6, Numbers6, Numbers6, Numbers6], BeforeValidator(_as_list)]
ParameterValue = Annotated[float | tuple[float, ...], BeforeValidator(_parameter)]
Interval95 = Annotated[
    tuple[float, float] | tuple[tuple[float, float], ...],
    BeforeValidator(_interval),
]


def _rising(value: tuple[float, float]) -> tuple[float, float]:
    if not value[0] < value[1]:
        fault(f"must be [lowest, highest], but {value[0]:g} is not below {value[1]:g}")
    return value


Times = Annotated[tuple[Annotated[float, Strict()], Annotated[float, Strict()]], AfterValidator(_rising)]
"""Of a clock of any kind, which ``Number`` is too narrow for."""
Span = Annotated[tuple[Number, Number], BeforeValidator(_as_list), AfterValidator(_rising)]


class Part(BaseModel):
    """A table of the stage file: every key known, nothing changed in place."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, hide_input_in_errors=True)
