"""A campaign from its options to its result and pages."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from phaselead.errors import BadInput
from phaselead.validation.journal import Journal
from phaselead.validation.pool import run_cases
from phaselead.validation.summary import summary
from phaselead.validation.truth import KINDS, Case, fingerprint, load_truth

Progress = Callable[[float], None]


@dataclass(frozen=True)
class Plan:
    """What to run."""

    folder: Path
    set_name: str
    kinds: tuple[str, ...] = KINDS
    sizes: tuple[float, ...] = (0.05, 0.2, 1.0)
    scale: float = 1.0
    limit: int | None = None

    def cases(self) -> list[Case]:
        """Raises BadInput for a set, kind or size that there is not."""
        truth = load_truth(self.folder)
        try:
            found = list(truth.cases(self.set_name, self.kinds, self.sizes, self.scale))
        except ValueError as error:
            raise BadInput(f"{self.folder}: {error}") from None
        if not found:
            raise BadInput(f"{self.folder}: has no case of that set, kind and size")
        return found[: self.limit]


def run_campaign(
    plan: Plan,
    journal_path: Path,
    *,
    jobs: int,
    scheduler: str | None = None,
    mix: bool = False,
    on_progress: Progress = lambda share: None,
) -> dict[str, Any]:
    """Run what is not yet in the journal and sum everything up. Raises BadInput.

    An interrupt leaves the journal with what was finished.
    """
    names = [case.name for case in plan.cases()]
    code, commit = fingerprint(plan.folder), _commit(plan.folder)  # now: others may change it while this runs
    journal = Journal(journal_path, code, mix=mix)
    left = [name for name in names if name not in journal.outcomes]
    done = len(names) - len(left)

    def take(outcome: dict[str, Any]) -> None:
        nonlocal done
        journal.add(outcome)
        done += 1
        on_progress(done / len(names))

    on_progress(done / len(names))
    run_cases(str(plan.folder.resolve()), left, take, jobs=jobs, scheduler=scheduler)
    outcomes = [journal.outcomes[name] for name in names]
    return {**summary(outcomes), "run": _provenance(plan, code, commit, outcomes)}


def _provenance(plan: Plan, code: str, commit: str, outcomes: Sequence[dict[str, Any]]) -> dict[str, Any]:
    return {
        "set": plan.set_name,
        "scale": plan.scale,
        "limit": plan.limit,
        "version": version("phaselead"),
        "commit": commit,
        "code": code,
        "cpu_hours": sum(o.get("cpu_seconds") or 0.0 for o in outcomes) / 3600,
    }


def _commit(folder: Path) -> str:
    """Of the repository that the generator lies in, with a mark when tracked files were changed since; or nothing."""
    words = ["git", "-C", str(folder), "describe", "--always", "--dirty=+changes", "--abbrev=12", "--exclude=*"]
    try:
        return subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""
