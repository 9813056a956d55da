"""The command line as a function, and a stage file that was identified through it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from phaselead.cli import main


@dataclass(frozen=True)
class Outcome:
    """What a command left: exit status, both outputs, and the JSON it printed, if it did."""

    status: int
    out: str
    err: str
    error: BaseException | None

    @property
    def json(self) -> Any:
        return json.loads(self.out)


Run = Callable[..., Outcome]


def run_command(*arguments: object) -> Outcome:
    """Runs `phaselead ARGUMENTS` in this process."""
    result = CliRunner().invoke(main, [str(argument) for argument in arguments])
    crash = result.exception if not isinstance(result.exception, SystemExit) else None
    return Outcome(result.exit_code, result.stdout, result.stderr, crash)


@pytest.fixture(name="run", scope="session")
def _run() -> Run:
    return run_command


@pytest.fixture(scope="session")
def stage_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built-in stage, identified through the command line; its records are beside it, in ``kept``."""
    path = tmp_path_factory.mktemp("identified") / "stage.toml"
    outcome = run_command("identify", "-o", path, "--save", path.parent / "kept")
    assert outcome.status == 0, outcome.err
    return path
