"""A campaign of blind trials, from its options to its result."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from phaselead.errors import BadInput
from phaselead.validation.journal import Journal, Outcome
from phaselead.validation.pool import run_cases
from phaselead.validation.summary import summary
from phaselead.validation.truth import KINDS, Case, fingerprint, load_truth
from phaselead.version import VERSION

Progress = Callable[[float], None]


@dataclass(frozen=True)
class CampaignPlan:
    """Which cases to run: ``kinds`` of them (None: all that the generator has, but none on request); ``sizes`` are of
    single effects, as multiples of the typical one.
    """

    folder: Path
    set_name: str
    kinds: tuple[str, ...] | None = None
    sizes: tuple[float, ...] = (0.05, 0.2, 1.0)
    scale: float = 1.0
    limit: int | None = None

    def cases(self) -> list[Case]:
        """The cases, in order. Raises BadInput for a set, kind or size that the generator does not have."""
        truth = load_truth(self.folder)
        kinds = self.kinds if self.kinds is not None else tuple(getattr(truth, "KINDS", KINDS))
        try:
            found = list(truth.cases(self.set_name, kinds, self.sizes, self.scale))
        except ValueError as error:
            raise BadInput(f"{self.folder}: {error}") from None
        if not found:
            raise BadInput(f"{self.folder}: has no case of that set, kind and size")
        return found[: self.limit]


def run_campaign(
    plan: CampaignPlan,
    journal_path: Path,
    *,
    jobs: int,
    scheduler: str | None = None,
    mix: bool = False,
    on_progress: Progress = lambda share: None,
) -> dict[str, Any]:
    """Run the cases that are not in the journal yet, and summarise all of them as plain JSON types.

    ``jobs`` is the number of processes; with a ``scheduler`` a Dask cluster is used instead. ``mix`` keeps cases run
    with other code. An interrupt leaves the finished cases in the journal. Raises BadInput.
    """
    names = [case.name for case in plan.cases()]
    code, commit = fingerprint(plan.folder), _commit(plan.folder)  # taken now: the files may change while this runs
    journal = Journal(journal_path, code, mix=mix)
    to_run = [name for name in names if name not in journal.outcomes]
    done = len(names) - len(to_run)

    def take(outcome: Outcome) -> None:
        nonlocal done
        journal.add(outcome)
        done += 1
        on_progress(done / len(names))

    on_progress(done / len(names))
    run_cases(str(plan.folder.resolve()), to_run, take, jobs=jobs, scheduler=scheduler)
    outcomes = [journal.outcomes[name] for name in names]
    return {**summary(outcomes), "run": _provenance(plan, code, commit, outcomes)}


def _provenance(plan: CampaignPlan, code: str, commit: str, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    return {
        "set": plan.set_name,
        "scale": plan.scale,
        "limit": plan.limit,
        "version": VERSION,
        "commit": commit,
        "code": code,
        "cpu_hours": sum(o.get("cpu_seconds") or 0.0 for o in outcomes) / 3600,
    }


def _commit(folder: Path) -> str:
    """Commit of the generator's repository, marked when tracked files differ; empty without a repository."""
    words = ["git", "-C", str(folder), "describe", "--always", "--dirty=+changes", "--abbrev=12", "--exclude=*"]
    try:
        return subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""
