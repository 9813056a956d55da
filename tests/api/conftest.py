"""A model of the built-in stage, and records of it, made once."""

from __future__ import annotations

import pytest

import phaselead as pl


@pytest.fixture(autouse=True)
def _default_port(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PHASELEAD_PORT", raising=False)


@pytest.fixture(scope="session")
def records() -> pl.Recordings:
    """Sines on x from rest: what is fitted first, what is held out last."""
    with pl.connect("sim://xyz250") as dev:
        return pl.read([dev.record(f"sine:{swing}V@5Hz", duration=0.8) for swing in (5, 3, 4)])


@pytest.fixture(scope="session")
def fitted(records: pl.Recordings) -> pl.FitResult:
    return pl.fit(records[:2])
