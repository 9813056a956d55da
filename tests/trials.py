"""Long trials: of a law whose examples take long, `make test` has one or two, and `make trials` the others."""

from __future__ import annotations

from typing import Any

import pytest


def in_trials(*examples: Any) -> list[Any]:
    """These examples of a parameter, a tuple of several parameters, for `make trials` alone."""
    return [pytest.param(*(one if isinstance(one, tuple) else (one,)), marks=pytest.mark.trial) for one in examples]
