"""The numbers along an axis of the scope, run as the browser runs them."""

from __future__ import annotations

import json
import shutil
import subprocess
from importlib.resources import files

import pytest

PLOTS = files("phaselead.scope") / "static" / "plots.js"
NODE = shutil.which("node")


@pytest.mark.skipif(NODE is None, reason="no node")
@pytest.mark.parametrize(
    ("values", "step", "shown"),
    [
        ([-0.001, -0.0005, 0, 0.0005, 0.001], 0.0005, ["-0.001", "-0.0005", "0", "0.0005", "0.001"]),
        ([0, 0.25, 0.5], 0.25, ["0", "0.25", "0.5"]),
        ([0.1 + 0.2, 0.4], 0.1, ["0.3", "0.4"]),
        ([0, 50, 1000], 50, ["0", "50", "1,000"]),
    ],
)
def test_neighbours_are_told_apart_however_small_the_range(values, step, shown):
    """At rest the effort's read 0.001, 0.001, 0, -0.001, -0.001."""
    said = f"\nconsole.log(JSON.stringify(numbers({json.dumps(values)}, {step})));"
    script = PLOTS.read_text(encoding="utf-8") + said
    ran = subprocess.run(
        [str(NODE), "--input-type=module", "-"], input=script, capture_output=True, text=True, check=True,
        env={"LC_ALL": "en_US.UTF-8", "LANG": "en_US.UTF-8"},
    )  # fmt: skip
    assert json.loads(ran.stdout) == shown
