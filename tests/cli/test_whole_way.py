"""The whole way round on the built-in stage, through the command line, judged by the figures the product promises."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from phaselead.model.stage_file import load_stage

BUILT_IN = Path(__file__).parents[2] / "host/phaselead/sim/xyz250.toml"
HELD_OUT = [("sine:5V@5Hz", 5 / 5), ("sine:3V@15Hz", 5 / 15)]
UNUSED_SINES = [*HELD_OUT, ("sine:7V@3Hz", 5 / 3), ("sine:9V@9Hz", 5 / 9), ("sine:1.5V@11Hz", 5 / 11)]


@pytest.fixture(scope="session")
def tracked(run, stage_file, tmp_path_factory):
    """60 um at 5 Hz with the paper's gains, each controller from rest: figures and run file by mode."""
    folder = tmp_path_factory.mktemp("tracked")
    found = {}
    for mode in ("pid", "ff", "ff+pid"):
        path = folder / f"{mode}.h5"
        arguments = ("--model", stage_file, "--mode", mode, "--gains", "paper", "-o", path, "--json", "-")
        outcome = run("track", "sine:60um@5Hz", *arguments)
        assert outcome.status == 0, outcome.err
        found[mode] = (outcome.json, path)
    return found


def record(run, tmp_path: Path, wave: str, seconds: float) -> Path:
    path = tmp_path / f"{wave.replace(':', '-')}.h5"
    outcome = run("track", wave, "--mode", "open", "--duration", seconds, "-o", path)
    assert outcome.status == 0, outcome.err
    return path


@pytest.mark.parametrize(("wave", "seconds"), UNUSED_SINES)
def test_time_view_from_rest_on_sines_it_never_saw(run, stage_file, tmp_path, wave, seconds):
    path = record(run, tmp_path, wave, seconds)
    (found,) = run("verify", "--model", stage_file, path, "--json", "-").json["records"]
    assert found["mean_pct"] <= 0.5
    assert found["max_pct"] <= 2.0


def test_identify_finds_where_the_stage_bends_and_leaves_what_the_pages_say(stage_file):
    """The mode shows in the response of so many sines: thresholds are placed all the same."""
    view, truth = load_stage(stage_file).axes["x"].time, load_stage(BUILT_IN).axes["x"].time
    r, w = (np.array(v) for v in (truth.play_r_V, truth.play_w_um_per_V))
    reached = (w > 0) & (r < 4)  # the levels move no play beyond half their swing, and hardly one near it
    np.testing.assert_allclose(view.play_r_V[1:], r[reached][1:], rtol=0.06)
    assert view.deadzone_d_V == truth.deadzone_d_V
    assert view.residual_um_rms < 0.04


@pytest.mark.parametrize(("wave", "seconds"), HELD_OUT)
def test_table_view_from_rest_is_as_good_as_the_papers_and_no_easier(run, stage_file, tmp_path, wave, seconds):
    path = record(run, tmp_path, wave, seconds)
    (found,) = run("verify", "--model", stage_file, "--view", "table", path, "--json", "-").json["records"]
    assert 0.8 <= found["mean_pct"] <= 1.3
    assert 4.0 <= found["max_pct"] <= 6.0


def test_feedforward_and_pid_beats_pid_alone_ninefold_and_stays_below_one_per_cent(tracked):
    both, alone = tracked["ff+pid"][0], tracked["pid"][0]
    assert both["max_pct"] <= 1.0
    assert alone["max_um"] / both["max_um"] >= 9


def test_pid_alone_gives_what_a_stage_of_table_1_gives_and_not_the_papers_figure(tracked):
    assert tracked["pid"][0]["max_um"] == pytest.approx(5.3, rel=0.1)


def test_figures_are_those_of_the_recording(tracked):
    figures, path = tracked["ff"]
    with h5py.File(path) as run_file:
        error_um = run_file["r_um"][:] - run_file["x_um"][:]
    last = error_um[-4000:]
    assert figures["ticks"] == 10000
    assert figures["dropped"] == 0
    assert figures["range_um"] == pytest.approx(60, abs=1e-3)
    assert figures["max_um"] == pytest.approx(np.abs(last).max())
    assert figures["rms_um"] == pytest.approx(np.sqrt(np.mean(last**2)))
    assert figures["max_um_mean_removed"] == pytest.approx(np.abs(last - last.mean()).max())
    assert figures["from_rest"]["max_um"] == pytest.approx(np.abs(error_um).max())


@pytest.mark.parametrize("mode", ["pid", "ff", "ff+pid"])
def test_every_run_replays_and_a_bent_one_names_its_first_tick(run, tracked, tmp_path, mode):
    path = tracked[mode][1]
    assert run("replay", path).status == 0

    bent = tmp_path / "bent.h5"
    bent.write_bytes(path.read_bytes())
    with h5py.File(bent, "r+") as run_file:
        codes = run_file["device/x/dac"][:]
        codes[777] ^= 1
        first = int(run_file["device/tick"][777])
        del run_file["device/x/dac"]
        run_file["device/x/dac"] = codes
    outcome = run("replay", bent, "--json", "-")
    assert outcome.status == 1
    assert outcome.json["first_difference"] == first


def test_three_axes_run_together_each_on_its_own_path(run, tmp_path):
    stage = tmp_path / "three.toml"
    grid = ("--levels", "1,3,6V", "--frequencies", "2,6,20Hz", "--no-creep")
    assert run("identify", "--axis", "x,y,z", "-o", stage, *grid).status == 0
    waves = "x=sine:60um@5Hz,y=sine:40um@10Hz,z=goto:50um"
    outcome = run("track", waves, "--model", stage, "--json", "-")
    assert outcome.status == 0, outcome.err
    axes = outcome.json["axes"]
    assert set(axes) == {"x", "y", "z"}
    assert axes["x"]["max_pct"] < 1.5
    coupling = np.array(load_stage(stage).cross_coupling)
    built_in = [[1.0, 0.021, -0.013], [0.040, 1.0, 0.017], [-0.024, 0.031, 1.0]]
    np.testing.assert_allclose(coupling, built_in, atol=0.003)


def test_identify_gives_the_same_file_twice(run, tmp_path):
    files = [tmp_path / "once.toml", tmp_path / "again.toml"]
    for file in files:
        assert run("identify", "--levels", "1,2,3V", "--frequencies", "10,15,20Hz", "-o", file).status == 0
    once, again = map(load_stage, files)
    assert once.axes == again.axes


def test_fit_of_the_saved_records_is_the_fit_of_identify(run, tmp_path):
    """From the first rows on that the stage file says were used."""
    few, kept = ("--levels", "1,2,3V", "--frequencies", "10,15,20Hz", "-o", tmp_path / "a.toml"), tmp_path / "kept"
    assert run("identify", *few, "--save", kept).status == 0
    stage = load_stage(tmp_path / "a.toml")
    places = {path.stem: path for path in kept.rglob("*.h5")}
    records = [f"{places[one.file]}@{one.rows_s[0]}:" for one in stage.provenance.data]
    assert run("fit", *records, "-o", tmp_path / "b.toml").status == 0
    fitted, identified = load_stage(tmp_path / "b.toml").axes["x"], stage.axes["x"]
    assert fitted.table is not None
    assert identified.table is not None
    np.testing.assert_allclose(fitted.table.a_um_per_V, identified.table.a_um_per_V, rtol=1e-6)


def test_a_record_moved_in_time_is_fitted_alike_and_one_given_twice_is_refused(run, tmp_path):
    path = record(run, tmp_path, "sine:5V@5Hz", 1.0)
    exported = tmp_path / "later.csv"
    assert run("log", "export", path, exported).status == 0
    rows = np.loadtxt(exported, delimiter=",", skiprows=1)
    rows[:, 0] += 1000.0
    np.savetxt(exported, rows, delimiter=",", header="t_s,u_V,x_um", comments="", fmt="%.10g")
    residuals = []
    twice = run("fit", path, path, "-o", tmp_path / "s.toml")
    assert (twice.status, "give them once" in twice.err) == (2, True)
    assert not (tmp_path / "s.toml").exists()
    for one in (path, exported):
        outcome = run("fit", one, "-o", tmp_path / "s.toml", "--overwrite", "--json", "-")
        assert outcome.status == 0, outcome.err
        assert "rest" not in " ".join(outcome.json["messages"])
        residuals.append(outcome.json["axes"]["x"]["residual_um_rms"])
    assert max(residuals) < 1.2 * min(residuals)
    assert max(residuals) < 0.2
