"""Field types of the stage file, and the one line that explains why one of them is wrong."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Annotated, Any, NoReturn, get_args

import numpy as np
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError
from pydantic_core import PydanticCustomError

from phaselead.errors import BadInput

LARGEST = 1e9
"""No coefficient of a stage is beyond this in the units of the file; a larger one is a slip."""


def fault(text: str, suffix: str = "") -> NoReturn:
    """Refuse a value in a validator; ``suffix`` extends the key path, e.g. ``"[3]"`` or ``".u_max_V"``."""
    raise PydanticCustomError("phaselead", "{text}", {"text": text, "suffix": suffix})


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
Parameter = Annotated[float | tuple[float, ...], BeforeValidator(_parameter)]
Interval95 = Annotated[
    tuple[float, float] | tuple[tuple[float, float], ...],
    BeforeValidator(_interval),
]


def _rising(value: tuple[float, float]) -> tuple[float, float]:
    if not value[0] < value[1]:
        fault(f"must be [lowest, highest], but {value[0]:g} is not below {value[1]:g}")
    return value


Span = Annotated[tuple[Number, Number], BeforeValidator(_as_list), AfterValidator(_rising)]


class Part(BaseModel):
    """A table of the stage file: every key known, nothing changed in place."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, hide_input_in_errors=True)


@contextmanager
def explained(source: str) -> Iterator[None]:
    """Turn a ValidationError of the stage models into one BadInput line that names ``source`` and the key."""
    try:
        yield
    except ValidationError as error:
        raise BadInput(f"{source}: {explain(error)}") from None


def explain(error: ValidationError, root: type[BaseModel] | None = None) -> str:
    """The first (most telling) error as ``key = value: what is wrong; what to do``."""
    errors = error.errors(include_url=False)
    # A misspelt key shows up twice, as unknown and as missing: the unknown one carries the hint.
    errors.sort(key=lambda item: item["type"] != "extra_forbidden")
    first = errors[0]
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    return _explain_one(dict(first), root) + more


def _explain_one(error: dict[str, Any], root: type[BaseModel] | None) -> str:
    kind, context = error["type"], error.get("ctx", {})
    if error["loc"] and error["loc"][-1] == "[key]":
        return f"{key_path(error['loc'][:-1])}: {context.get('text') or _reworded(error)}"
    key = (key_path(error["loc"]) + str(context.get("suffix", ""))).removeprefix(".") or "content"
    if kind == "missing":
        return f"{key}: missing key; add it"
    if kind == "extra_forbidden":
        return f"{key}: unknown key{_suggestion(error['loc'], root)}"
    text = context["text"] if kind == "phaselead" else _reworded(error)
    if text.startswith("= "):  # shows its value itself
        return f"{key} {text}"
    return f"{key}{_shown(error.get('input'), context)}: {text}"


def _reworded(error: dict[str, Any]) -> str:
    kind, context = error["type"], error.get("ctx", {})
    bounds = {"greater_than": "above", "greater_than_equal": "at least", "less_than": "below"}
    names = {"greater_than": "gt", "greater_than_equal": "ge", "less_than": "lt", "less_than_equal": "le"}
    if kind in names:
        return f"is out of range; it must be {bounds.get(kind, 'at most')} {context[names[kind]]:g}"
    if kind == "int_type":
        return "must be a whole number, without a decimal point"
    if kind in ("too_long", "too_short"):
        wanted = context.get("max_length", context.get("min_length"))
        return f"has {context['actual_length']} elements; it must have {wanted}"
    if kind == "string_pattern_mismatch":
        return "must be a SHA-256, 64 lower-case hex digits"
    if kind in ("model_type", "dict_type", "model_attributes_type"):
        return "must be a table"
    if kind in ("tuple_type", "list_type"):
        return "must be a list"
    message = str(error["msg"])
    return "must be " + message.split("should be ", 1)[1] if "should be " in message else message


def _shown(value: object, context: dict[str, Any]) -> str:
    if isinstance(value, (bool, int, float, str)) and not context.get("suffix"):
        text = repr(value)
        return f" = {text if len(text) <= 40 else text[:37] + '...'}"
    return ""


def key_path(location: Sequence[int | str]) -> str:
    """``("axes", "x", "time", "play_r_V", 3)`` as ``axes.x.time.play_r_V[3]``."""
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{_plain(part)}" if text else _plain(part)
    return text


def _plain(key: str) -> str:
    """Keys come from the file: keep the message on one line and short."""
    shown = key if key.isprintable() else ascii(key)[1:-1]
    return shown if len(shown) <= 60 else shown[:57] + "..."


def _suggestion(location: Sequence[int | str], root: type[BaseModel] | None) -> str:
    known = list(_keys_at(root, location[:-1])) if root else []
    close = difflib.get_close_matches(str(location[-1]), known, n=1)
    if close:
        return f"; did you mean {close[0]}?"
    return f"; known here: {', '.join(known)}" if known else "; remove it"


def _keys_at(root: type[BaseModel], location: Sequence[int | str]) -> list[str]:
    """The keys the schema has at ``location``."""
    here: Any = root
    for part in location:
        if _is_model(here):
            here = here.model_fields[str(part)].annotation
        else:  # dict[str, X] or tuple[X, ...]
            here = [argument for argument in get_args(here) if argument is not ...][-1]
        if type(None) in get_args(here):  # X | None
            here = get_args(here)[0]
    return list(here.model_fields) if _is_model(here) else []


def _is_model(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)
