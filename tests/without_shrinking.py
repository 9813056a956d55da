"""A pytest plugin for tests/mutation.py: a failure is enough, the smallest example is not looked for, and two runs try
the same examples."""

from typing import Any

from hypothesis import Phase, settings

register = settings.register_profile


def register_without(name: str, parent: settings | None = None, **options: Any) -> None:
    register(name, parent, phases=(Phase.explicit, Phase.generate), derandomize=True, **options)


type.__setattr__(settings, "register_profile", staticmethod(register_without))  # the class refuses it otherwise
