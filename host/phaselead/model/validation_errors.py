"""The one line that says what is wrong with a stage file, and what to do."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NoReturn, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import PydanticCustomError

from phaselead.errors import BadInput


def fault(text: str, suffix: str = "") -> NoReturn:
    """Refuse a value in a validator; ``suffix`` extends the key path, e.g. ``"[3]"`` or ``".u_max_V"``."""
    raise PydanticCustomError("phaselead", "{text}", {"text": text, "suffix": suffix})


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
