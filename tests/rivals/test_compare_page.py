"""The comparison as a page: every run by its hash, and who is nearest."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from compare import figures
from compare_page import drawn
from compare_report import write_report
from rivals import RIVALS, paths_for

RIVAL, OURS = next(iter(RIVALS)), "ours, tuned"


@pytest.fixture(name="whole")
def _whole() -> dict:
    path = paths_for("xyz250")[0]
    t_s = np.arange(round(path.seconds / 2e-4)) * 2e-4
    asked = path(t_s)
    near, far = figures(path, (asked, asked + 0.01)), figures(path, (asked, asked + 0.5))
    return {"xyz250": {path.name: {RIVAL: far, OURS: near}, "another": {RIVAL: {"ended": "rail"}, OURS: near}}}


def test_the_page_names_every_run_and_who_is_nearest(whole, tmp_path):
    (tmp_path / "xyz250.json").write_text(json.dumps(whole["xyz250"]))
    columns = [RIVAL, "ours, one shot", "ours, learned", OURS, "ours, tuned and learned"]
    write_report(tmp_path, whole, columns, drawn(whole, columns), lambda cell: cell.get("ended", "measured"))
    page = (tmp_path / "compare.html").read_text("utf-8")
    hashes = {cell["sha256"] for row in whole["xyz250"].values() for cell in row.values() if "sha256" in cell}
    assert len(hashes) == 2
    assert all(f'title="{one}"' in page for one in hashes)
    assert "<b>2 of 2</b>" in page
    assert "<b>0 of 2</b>" in page
    assert all(question.endswith("?") for question in re.findall(r"<h2>(.*?)</h2>", page))


def test_the_hash_of_a_run_is_that_of_its_samples():
    path = paths_for("xyz250")[0]
    asked = path(np.arange(8000) * 2e-4)
    assert figures(path, (asked, asked + 1))["sha256"] != figures(path, (asked, asked + 1 + 1e-12))["sha256"]
    assert figures(path, "rail") == {"ended": "rail"}
