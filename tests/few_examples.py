"""A pytest plugin for tests/coverage_of_c.py: properties try few examples, and two runs try the same."""

import pytest
from hypothesis import Phase, settings

MOST = 25
SETTINGS = "_hypothesis_internal_use_settings"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        function = getattr(item, "obj", None)
        own = getattr(function, SETTINGS, None) or (hasattr(function, "hypothesis") and settings.default)
        if own:
            few = min(own.max_examples, MOST)
            phases = (Phase.explicit, Phase.generate)
            setattr(function, SETTINGS, settings(own, max_examples=few, phases=phases, derandomize=True, database=None))
