"""The fine steering mirror: three axes driven at once, at two levels. From lines to modes, coupling and softening."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from phaselead.cli import main
from phaselead.model import load_stage

DATA = Path(os.environ.get("PHASELEAD_DATA", Path(__file__).parents[3] / "shared" / "data")) / "fsm"
HEADER = "t_s,ux_V,uy_V,uz_V,x_um,y_um,z_um"
RATE_HZ, PERIOD_s = 6400, 1.28
BAR = {"0.099": 6.37, "0.3": 4.19}
"""Error of the published neural model of all levels, in % of the output's rms."""

pytestmark = pytest.mark.skipif(
    not DATA.exists(), reason=f"{DATA} is not there; set PHASELEAD_DATA to the folder of measured data"
)


def phaselead(*arguments: object) -> tuple[str, str]:
    result = CliRunner().invoke(main, [str(argument) for argument in arguments])
    assert result.exit_code == 0, result.output
    return result.stdout, result.stderr


@pytest.fixture(scope="module")
def records(tmp_path_factory) -> dict[tuple[int, int], str]:
    """Recording arguments by level in mV and experiment from 1, the second period to be used."""
    folder = tmp_path_factory.mktemp("fsm")
    found = {}
    for level in (100, 300):
        u, y = (np.load(DATA / f"{name}_{level}mV_train.npy") for name in "uy")
        for e in range(u.shape[2]):
            u_V, x_um = (v[:, :, e].transpose(2, 0, 1).reshape(-1, 3) for v in (u, 1e6 * y))
            t_s = np.arange(len(u_V)) / RATE_HZ
            path = folder / f"fsm{level}_{e + 1}.csv"
            np.savetxt(path, np.column_stack([t_s, u_V, x_um]), "%.9g", ",", header=HEADER, comments="")
            found[level, e + 1] = f"{path}@{PERIOD_s}:"
    return found


@pytest.fixture(scope="module")
def weak(records, tmp_path_factory) -> tuple[Path, dict]:
    """The stage after the 100 mV records, and what was found in them."""
    folder = tmp_path_factory.mktemp("weak")
    train, held = ([records[100, e] for e in part] for part in ((1, 2, 3), (4, 5, 6)))
    phaselead("fit", *train, "--base", "linear", "-o", folder / "static.toml")
    phaselead(
        "gap", "--model", folder / "static.toml", "--train", *train, "--holdout", *held,
        "-o", folder / "weak.toml", "--json", folder / "weak.json",
    )  # fmt: skip
    return folder / "weak.toml", json.loads((folder / "weak.json").read_text())


def test_static_gains_lack_modes_and_coupling(weak):
    _, found = weak
    assert {(e["name"], e["axis"]) for e in found["effects"]} == {
        (name, axis) for name in ("resonance", "cross_coupling") for axis in "xyz"
    }
    assert "softening" in found["untestable"]
    assert found["gap"]["after"] < 0.0637 * found["gap"]["before"]
    f_Hz = np.array(found["effects"][0]["params"]["f_Hz"]["value"])
    for mode in (640, 813, 924, 1002):
        assert np.min(np.abs(f_Hz / mode - 1)) < 0.01


def test_another_level_shows_softening(records, weak, tmp_path):
    stage, _ = weak
    train, held = ([records[v, e] for v in (100, 300) for e in part] for part in ((1, 2, 3), (4, 5, 6)))
    said, _ = phaselead(
        "gap", "--model", stage, "--train", *train, "--holdout", *held,
        "-o", tmp_path / "next.toml", "--json", tmp_path / "gap.json",
    )  # fmt: skip
    found = json.loads((tmp_path / "gap.json").read_text())
    assert {"softening"} <= {e["name"] for e in found["effects"]} <= {"softening", "crossover_distortion"}
    softening = next(e["params"] for e in found["effects"] if e["name"] == "softening")
    assert softening["exponent"]["ci95"] == [0.5, 2.0]  # two levels fix a line, whatever the power
    assert "is not determined" in said
    assert found["ties"] == []
    proposed = found["next_experiment"]
    assert (proposed["axis"], proposed["needs_sensor"]) == ("x,y,z", None)
    assert proposed["level"] == pytest.approx(1.32, rel=0.1)  # between 0.87 and 2.2 V peak-to-peak
    after = {
        words[3]: float(words[-3])
        for words in (line.split() for line in said.splitlines())
        if words[:2] == ["held", "out"]
    }
    assert set(after) == set(BAR)
    assert all(after[level] < bar for level, bar in BAR.items())
    assert after["0.099"] < 4.2
    assert after["0.3"] <= 3.6  # 3.56 or 3.60, by the last digits of the gain that the search begins with
    amplifiers = [
        e.params for a in load_stage(tmp_path / "next.toml").axes.values() for e in a.effects
        if e.name == "crossover_distortion"
    ]  # fmt: skip
    assert len(amplifiers) == 3
    for name, typical in (("width_V", 0.0245), ("tau_s", 8.3e-5)):  # three of one type
        assert [a[name] for a in amplifiers] == pytest.approx([typical] * 3, rel=0.15)
