"""A campaign that is cut short, mixed up or given nonsense. The cases fail at once, so that none of it takes time."""

from __future__ import annotations

import json
import sys

import pytest
from click.testing import CliRunner

from phaselead.cli import main
from phaselead.errors import BadInput
from phaselead.validation import trial
from phaselead.validation.campaign import CampaignPlan
from phaselead.validation.journal import Journal
from phaselead.validation.pool import run_cases
from phaselead.validation.truth import UNDER_TEST, fingerprint, load_truth

GENERATOR = """
from dataclasses import dataclass
from pathlib import Path
from phaselead.errors import BadInput

@dataclass
class Case:
    name: str
    kind: str = "none"
    hidden = ()
    without = ()
    bits = 16
    def records(self):
        with open(Path(__file__).with_name("tried.txt"), "a") as file:
            file.write(self.name + "\\n")
        raise BadInput("no such luck")

def cases(set_name, kinds, sizes, scale):
    if set_name != "tuning":
        raise ValueError(f"no set {set_name!r}")
    return [Case(f"tuning/none/{i}") for i in range(round(4 * scale))]

def case(name):
    return Case(name)
"""


@pytest.fixture
def folder(tmp_path):
    made = tmp_path / "truth"
    made.mkdir()
    (made / "__init__.py").write_text(GENERATOR)
    yield made
    sys.modules.pop("phaselead_truth", None)


def tried(folder):
    path = folder / "tried.txt"
    return path.read_text().split() if path.exists() else []


def campaign(folder, out, *more):
    words = ["gap", "campaign", "--truth", folder, "--jobs", 1, "-o", out, *more]
    result = CliRunner().invoke(main, [str(word) for word in words])
    return result.exit_code, result.stderr


def test_what_is_finished_is_not_tried_again(folder, tmp_path):
    out = tmp_path / "out"
    assert campaign(folder, out, "--limit", 2) == (0, "")
    with open(out / "cases.jsonl", "a") as file:
        file.write('{"case": "tuning/none/2", "ki')  # killed while it wrote
    assert campaign(folder, out) == (0, "")
    assert tried(folder) == [f"tuning/none/{i}" for i in range(4)]
    result = json.loads((out / "campaign.json").read_text())
    assert result["cases"] == 4
    assert [f["error"] for f in result["failed"]] == ["no such luck"] * 4
    assert "no such luck" in (out / "campaign.html").read_text()
    assert campaign(folder, out) == (0, "")
    assert len(tried(folder)) == 4


def test_other_code_is_refused_unless_told(folder, tmp_path):
    out = tmp_path / "out"
    assert campaign(folder, out, "--limit", 1) == (0, "")
    sys.modules.pop("phaselead_truth")
    (folder / "__init__.py").write_text(GENERATOR + "\n# another\n")
    status, said = campaign(folder, out)
    assert status == 2
    assert "other code" in said
    assert said.count("\n") == 1
    assert campaign(folder, out, "--mix") == (0, "")
    assert tried(folder) == [f"tuning/none/{i}" for i in range(4)]


def test_a_generator_is_asked_for_the_kinds_that_it_has(folder):
    plan = CampaignPlan(folder, "tuning", scale=0.5)
    assert len(plan.cases()) == 2
    sys.modules.pop("phaselead_truth")
    strict = "\nKINDS = ('none',)\nall_cases = cases\ndef cases(set_name, kinds, sizes, scale):\n"
    strict += "    assert tuple(kinds) == KINDS\n    return all_cases(set_name, kinds, sizes, scale)\n"
    (folder / "__init__.py").write_text(GENERATOR + strict)
    assert len(plan.cases()) == 2


def test_narrow_cases_run_on_request(folder, tmp_path):
    refusing = "\nall_cases = cases\ndef cases(set_name, kinds, sizes, scale):\n"
    refusing += "    if 'narrow' in kinds:\n        raise ValueError('was asked for narrow')\n"
    refusing += "    return all_cases(set_name, kinds, sizes, scale)\n"
    (folder / "__init__.py").write_text(GENERATOR + refusing)
    assert len(CampaignPlan(folder, "tuning").cases()) == 4
    status, said = campaign(folder, tmp_path / "out", "--kinds", "single,narrow")
    assert status == 2
    assert "was asked for narrow" in said


@pytest.mark.parametrize(
    ("kind", "asked"),
    [(kind, True) for kind in ("single", "sines", "closed_loop", "narrow", "slow_sines")]
    + [("pair", False), ("poor", False)],
)
def test_the_proposed_experiment_is_run_for_what_can_be_scored(kind, asked, monkeypatch):
    class Tried:
        without, hidden = (), ()

        def __init__(self, kind):
            self.kind = kind

        def records(self):
            return [], [], []

        def bare_holdout(self):
            return None

    monkeypatch.setattr(trial, "base_model", lambda *_: None)
    monkeypatch.setattr(trial, "run_gap", lambda *_, **__: None)
    monkeypatch.setattr(trial, "answer", lambda *_: {})
    monkeypatch.setattr(trial, "_after_next", lambda *_: "tried")
    assert ("after_next" in trial._tried(Tried(kind), follow_up=True)) == asked
    assert "after_next" not in trial._tried(Tried(kind), follow_up=False)


def test_a_base_needs_records():
    with pytest.raises(BadInput, match="no records to make the base of"):
        trial.base_model(type("Tried", (), {"name": "mine/1"})(), [])


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["--set", "other"], "no set"),
        (["--kinds", "single,wild"], "no kind wild"),
        (["--kinds", ""], "no kind"),
        (["--sizes", "0"], "sizes above 0"),
        (["--sizes", "big"], "sizes above 0"),
        (["--table", "nowhere/page.md"], "no folder"),
    ],
)
def test_nonsense_is_one_line(folder, tmp_path, words, why):
    out = tmp_path / "out"
    status, said = campaign(folder, out, *words)
    assert status == 2
    assert why in said
    assert said.count("\n") == 1
    assert not out.exists()


def test_a_folder_without_a_generator_is_refused(tmp_path):
    with pytest.raises(BadInput, match="holds no generator"):
        load_truth(tmp_path)
    (tmp_path / "__init__.py").write_text("x = 1\n")
    with pytest.raises(BadInput, match="no function cases and no case"):
        load_truth(tmp_path)
    (tmp_path / "__init__.py").write_text("1 / 0\n")
    with pytest.raises(BadInput, match="ZeroDivisionError"):
        load_truth(tmp_path)


@pytest.mark.parametrize("room", UNDER_TEST, ids=lambda room: room.name)
def test_the_fingerprint_covers_code(room):
    assert list(room.rglob("*.py"))


def test_the_fingerprint_follows_the_generator(folder):
    before = fingerprint(folder)
    assert fingerprint(folder) == before
    (folder / "more.py").write_text("pass\n")
    assert fingerprint(folder) != before


def test_a_journal_of_something_else_is_refused(tmp_path):
    path = tmp_path / "cases.jsonl"
    path.write_text("[1, 2]\n")
    with pytest.raises(BadInput, match="line 1 is no finished case"):
        Journal(path, "ab")


def test_several_processes_share_the_cases(folder):
    names = [f"tuning/none/{i}" for i in range(3)]
    found = []
    run_cases(str(folder), names, found.append, jobs=2)
    assert sorted(o["case"] for o in found) == names
    assert {o["error"] for o in found} == {"no such luck"}


def test_a_scheduler_runs_the_cases(folder):
    distributed = pytest.importorskip("distributed", reason="needs the extra cluster (Dask)")
    names = [f"tuning/none/{i}" for i in range(3)]
    found = []
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        run_cases(str(folder), names, found.append, jobs=1, scheduler=cluster.scheduler_address)
    assert sorted(o["case"] for o in found) == names


def test_a_scheduler_that_is_not_there_is_one_line(folder):
    pytest.importorskip("distributed", reason="needs the extra cluster (Dask)")
    with pytest.raises(BadInput, match="no Dask scheduler"):
        run_cases(str(folder), ["tuning/none/0"], print, jobs=1, scheduler="tcp://127.0.0.1:1")
