"""Every public name says what it is, and its example does what it shows."""

from __future__ import annotations

import doctest
import inspect
from pathlib import Path
from typing import Any

import pytest

import phaselead as pl

NAMES = [name for name in pl.__all__ if not name.startswith("__")]


@pytest.mark.usefixtures("short_search")
@pytest.mark.parametrize("name", NAMES)
def test_the_example_is_true(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each in a folder of its own, with nothing imported and the error's text compared."""
    monkeypatch.chdir(tmp_path)
    text = inspect.getdoc(getattr(pl, name)) or ""
    example = doctest.DocTestParser().get_doctest(text, {}, name, None, None)
    assert example.examples, f"{name} has no example"
    said: list[str] = []
    failures = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(example, out=said.append)
    assert failures.failed == 0, "".join(said)


def public_methods() -> list[tuple[str, Any]]:
    """Methods and properties that a public class has of its own or from a base of ours."""
    found = []
    for name in NAMES:
        thing = getattr(pl, name)
        if isinstance(thing, type):
            members = inspect.getmembers(thing, lambda m: inspect.isfunction(m) or isinstance(m, property))
            found += [
                (f"{name}.{key}", member)
                for key, member in members
                if not key.startswith("_") and (_module(member) or "").startswith("phaselead")
            ]
    return found


def _module(member: Any) -> str | None:
    return getattr(member.fget if isinstance(member, property) else member, "__module__", None)


@pytest.mark.parametrize(("name", "member"), public_methods(), ids=[name for name, _ in public_methods()])
def test_every_method_says_what_it_does(name: str, member: Any) -> None:
    assert (inspect.getdoc(member) or "").strip(), name
