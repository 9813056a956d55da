"""Write the page of the public names from their docstrings: ``python -m phaselead.api.page [docs]``.

With ``--check`` it says whether the page is stale instead. ``inspect`` is enough: a generator of whole sites would be
one more library to keep, for one page.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import phaselead
from phaselead.record import write_text

NAME = "api.md"
HEAD = """# The Python API

<!-- Written by python -m phaselead.api.page; edit the docstrings in host/phaselead/. -->

Every name of `import phaselead as pl`. Tasks, one screen each: [python.md](python.md). The examples run as tests.

| name | what it is |
|---|---|
{rows}
"""


def page() -> str:
    """The text of the page: a table of all names, then functions, classes and errors with their docstrings."""
    things = {name: getattr(phaselead, name) for name in phaselead.__all__ if not name.startswith("__")}
    order = sorted(things, key=lambda name: (_kind(things[name]), name.lower()))
    rows = "\n".join(f"| [`{name}`](#{_anchor(name, things[name])}) | {_summary(things[name])} |" for name in order)
    return HEAD.format(rows=rows) + "".join(_section(name, things[name]) for name in order)


def _kind(thing: Any) -> int:
    if not isinstance(thing, type):
        return 0
    return 2 if issubclass(thing, BaseException) else 1


def _heading(name: str, thing: Any) -> str:
    return f"class {name}" if isinstance(thing, type) else name


def _anchor(name: str, thing: Any) -> str:
    return _heading(name, thing).lower().replace(" ", "-")


def _summary(thing: Any) -> str:
    """The first sentence."""
    first = _doc(thing).split("\n\n")[0]
    sentence = re.split(r"(?<=\.)\s(?=[A-Z])", " ".join(first.split()))[0]
    return sentence.replace("|", "\\|").replace("``", "`")


def _section(name: str, thing: Any) -> str:
    parts = [f"\n## {_heading(name, thing)}\n"]
    if not isinstance(thing, type):
        parts.append(f"```python\n{_signature('pl.' + name, thing)}\n```\n")
    parts.append(_markdown(_doc(thing)))
    if _kind(thing) == 1:
        parts += [_member(name, key, member) for key, member in _members(thing)]
    return "\n".join(parts)


def _members(thing: type) -> Iterator[tuple[str, Any]]:
    """Public methods and properties that the package wrote, in the order of their classes' files."""
    seen = set()
    for base in thing.__mro__:
        if base.__module__.split(".")[0] != "phaselead":
            continue
        for key, member in vars(base).items():
            method = inspect.isfunction(member) or isinstance(member, property)
            if method and not key.startswith("_") and key not in seen and _doc(member):
                yield key, member
            seen.add(key)


def _member(owner: str, key: str, member: Any) -> str:
    if isinstance(member, property):
        return f"### {owner}.{key}\n\n{_markdown(_doc(member))}"
    return f"### {owner}.{key}\n\n```python\n{_signature(key, member)}\n```\n\n{_markdown(_doc(member))}"


def _signature(name: str, function: Any) -> str:
    """With one argument a line where it would be long, and without ``self``."""
    parameters = [p for p in inspect.signature(function).parameters.values() if p.name != "self"]
    returns = inspect.signature(function).return_annotation
    words: list[str] = []
    for i, parameter in enumerate(parameters):
        first_keyword = parameter.kind is parameter.KEYWORD_ONLY and (
            i == 0 or parameters[i - 1].kind is not parameter.KEYWORD_ONLY
        )
        words += ["*"] if first_keyword else []
        words.append(str(parameter).replace("'", "") if parameter.default is parameter.empty else _optional(parameter))
    ending = "" if returns is inspect.Signature.empty else f" -> {returns}"
    line = f"{name}({', '.join(words)}){ending}"
    return line if len(line) <= 100 else f"{name}(\n" + "".join(f"    {word},\n" for word in words) + f"){ending}"


def _optional(parameter: inspect.Parameter) -> str:
    """A default that is a function by its name, which no memory address is part of."""
    default = parameter.default
    shown = getattr(default, "__name__", "...") if callable(default) else repr(default)
    return f"{parameter.name}: {parameter.annotation} = {shown.replace('<lambda>', '...')}"


def _doc(thing: Any) -> str:
    own = thing.__dict__.get("__doc__") if isinstance(thing, type) else thing.__doc__
    return inspect.cleandoc(own or "")


def _markdown(text: str) -> str:
    """A docstring: double backquotes become single ones, examples become blocks of code."""
    found, code = [], False
    for line in text.splitlines():
        starts = line.startswith(">>>")
        if starts and not code:
            found.append("```python")
            code = True
        elif code and not line.strip():
            found.append("```")
            code = False
        found.append(re.sub(r"\s+# doctest: .*", "", line) if code else line.replace("``", "`"))
    return "\n".join([*found, *(["```"] if code else []), ""])


def main(arguments: list[str]) -> int:
    """Write the page, or with --check say that it is stale and return 1 if it is."""
    path = Path(next((a for a in arguments if not a.startswith("-")), "docs")) / NAME
    if "--check" not in arguments:
        write_text(path, page())
        return 0
    if path.is_file() and path.read_text("utf-8") == page():
        return 0
    print(f"{path} is stale; run: python -m phaselead.api.page {path.parent}", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
