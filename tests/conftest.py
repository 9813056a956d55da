"""Settings of all tests: a slow machine is no failure."""

import pytest
from hypothesis import settings

settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")


@pytest.fixture
def short_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """``tune`` searches for seconds: it finds loops with the same margin, if not the widest."""
    from phaselead.control.tuning import shaping  # slow to load, and few tests need it

    for budget, value in (("GENERATIONS", 15), ("SIMPLEX", 250), ("SIMPLEXES", 2)):
        monkeypatch.setattr(shaping, budget, value)
