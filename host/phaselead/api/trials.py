"""The demo, and the blind campaign."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from phaselead.errors import BadInput

if TYPE_CHECKING:
    from phaselead.validation import CampaignResult


def demo(
    out: str | os.PathLike[str] = "phaselead-demo",
    *,
    overwrite: bool = False,
    say: Callable[[str], None] = print,
    on_progress: Callable[[float], None] | None = None,
) -> Path:
    """The whole story on the built-in stage: identify, fit, verify, upload, track, record, replay. One to four minutes.

    Keeps every file in the folder ``out`` and returns the path of the report; ``say`` is given a line per chapter.
    Raises BadInput where the folder holds anything already, unless ``overwrite``, PhaseleadError when a step fails.

    >>> import phaselead as pl
    >>> report = pl.demo("demo")  # doctest: +SKIP
    identified: 192 records, three axes; stage file demo/stage.toml
    """
    from phaselead.demo import run_demo

    return run_demo(os.fspath(out), say, on_progress, overwrite=overwrite)


def campaign(
    truth: str | os.PathLike[str],
    output: str | os.PathLike[str],
    *,
    set: str = "tuning",
    kinds: Sequence[str] | None = None,
    sizes: Sequence[float] = (0.05, 0.2, 1.0),
    scale: float = 1.0,
    limit: int | None = None,
    jobs: int | None = None,
    scheduler: str | None = None,
    mix: bool = False,
    table: str | os.PathLike[str] | None = None,
    on_progress: Callable[[float], None] = lambda share: None,
) -> CampaignResult:
    """Hides effects in stages of a foreign make and counts how often the gap workflow names them.

    ``truth`` is the folder of their generator, ``output`` the folder of cases.jsonl, campaign.json and campaign.html;
    finished cases are kept there, so that the same call goes on after an interrupt. ``kinds``: default all that the
    generator has but those on request. ``sizes`` are multiples of the typical, ``scale`` multiplies the number of
    cases, ``limit`` takes only the first. ``jobs``: processes, default one for each core. Raises BadInput.

    >>> import phaselead as pl
    >>> pl.campaign("nowhere", "out")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    phaselead.errors.BadInput: nowhere...
    """
    from phaselead.record import check_output, write_text
    from phaselead.report import write_campaign_report
    from phaselead.result import json_text
    from phaselead.validation import CampaignPlan, CampaignResult, run_campaign, write_table

    folder = Path(output)
    plan = CampaignPlan(Path(truth), set, tuple(kinds) if kinds else None, tuple(sizes), scale, limit)
    plan.cases()
    check_output(None if table is None else os.fspath(table))
    if folder.exists() and not folder.is_dir():
        raise BadInput(f"{folder}: is a file; give a folder")
    folder.mkdir(parents=True, exist_ok=True)
    result = run_campaign(
        plan,
        folder / "cases.jsonl",
        jobs=jobs or os.cpu_count() or 1,
        scheduler=scheduler,
        mix=mix,
        on_progress=on_progress,
    )
    write_text(folder / "campaign.json", json_text(result))
    write_campaign_report(folder / "campaign.html", result)
    if table is not None:
        write_table(Path(table), result)
    return CampaignResult(result)
