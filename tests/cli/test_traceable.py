"""Every page says where its numbers come from: recordings by hashes that can be looked up, and what made them."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

import numpy as np
import pytest

import phaselead as pl
from phaselead.control.kept_runs import KeptRuns
from phaselead.errors import BadInput
from phaselead.record import Source
from phaselead.report.results import result_page


def shown(page: str) -> dict[str, str]:
    """The hashes on a page by the names they stand behind."""
    return dict(re.findall(r'<li>(\S+) <code title="([0-9a-f]{64})">', page))


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture(name="kept", scope="module")
def _kept(tmp_path_factory: pytest.TempPathFactory) -> tuple[pl.FitResult, Path]:
    folder = tmp_path_factory.mktemp("kept")
    with pl.connect() as dev:
        return dev.identify(levels=[1, 2, 3], frequencies=[10, 15, 20], save=folder), folder


def test_samples_have_one_hash_in_every_file(tmp_path, run):
    with pl.connect() as dev:
        made = dev.track("sine:20um@10Hz", mode="pid", duration=0.2)
    for name in ("run.h5", "run.csv"):
        made.save(tmp_path / name)
        found = run("log", "info", tmp_path / name, "--json", "-").json
        assert found["samples_sha256"] == made.recording.samples_sha256
        assert found["sha256"] == digest(tmp_path / name)


@pytest.mark.parametrize("column", ["t_s", "x_um", "r_um"])
def test_any_other_number_has_another(column):
    t_s = np.arange(20) / 100
    columns = {"t_s": t_s, "u_V": np.sin(t_s), "x_um": np.cos(t_s), "r_um": np.sin(t_s)}
    other = {**columns, column: columns[column] + 1e-12 * (np.arange(20) + 1)}
    assert pl.recording(**columns).samples_sha256 != pl.recording(**other).samples_sha256
    assert pl.recording(**columns).traced == Source("arrays", pl.recording(**columns).samples_sha256)


def test_a_fit_names_every_recording(kept):
    fitted, folder = kept
    found = shown(result_page(fitted))
    assert {f"{name}.h5" for name in found} == {path.name for path in folder.glob("*.h5")}
    for name, sha256 in found.items():
        assert pl.read(folder / f"{name}.h5")[0].samples_sha256 == sha256
    assert fitted.model.sha256[:12] in result_page(fitted)


def test_a_verification_names_the_files(kept):
    fitted, folder = kept
    files = sorted(folder.glob("*.h5"))[:2]
    found = shown(result_page(pl.verify(fitted, [str(file) for file in files])))
    assert found == {file.name: digest(file) for file in files}


def test_a_run_is_named_by_its_file_or_its_samples(tmp_path):
    with pl.connect() as dev:
        kept = dev.track("sine:20um@10Hz", mode="pid", duration=0.2, output=tmp_path / "run.h5")
    with pl.connect() as dev:
        free = dev.track("sine:20um@10Hz", mode="pid", duration=0.2)
    assert shown(result_page(kept)) == {"run.h5": digest(tmp_path / "run.h5")}
    assert shown(result_page(free)) == {"sine:20um@10Hz": pl.read(tmp_path / "run.h5")[0].samples_sha256}


def test_learning_keeps_the_run_of_every_trial(kept, tmp_path):
    fitted, _ = kept
    with pl.connect() as dev:
        learned = dev.learn("sine:20um@15Hz", model=fitted, trials=2, save=tmp_path / "runs")
    files = {file.name: digest(file) for file in (tmp_path / "runs").glob("*.h5")}
    assert len(files) == len(learned.trials)
    assert shown(result_page(learned)) == files
    learned.save(tmp_path / "learned.h5")
    assert [one["source"] for one in learned.as_dict()["trials"]] == [one.source._asdict() for one in learned.trials]
    with pl.connect() as dev, pytest.raises(BadInput, match="holds recordings already"):
        dev.learn("sine:20um@15Hz", model=fitted, trials=2, save=tmp_path / "runs")


@pytest.mark.usefixtures("short_search")
def test_tuning_keeps_every_run(tmp_path):
    with pl.connect() as dev:
        tuned = dev.tune(save=tmp_path / "runs")
    files = {file.name: digest(file) for file in (tmp_path / "runs").glob("*.h5")}
    assert len(files) == 6
    assert shown(result_page(tuned)) == files


def test_a_gap_names_what_it_learned_from_and_was_judged_on(kept):
    fitted, folder = kept
    train, holdout, reference = sorted(folder.glob("*.h5"))[:3]
    found = pl.gap(fitted, train=str(train), holdout=str(holdout), reference=str(reference))
    pl.write_report(found, folder / "gap.html")
    page = (folder / "gap.html").read_text("utf-8")
    assert shown(page) == {file.name: digest(file) for file in (train, holdout, reference)}
    assert fitted.model.sha256[:12] in page
    assert found.next_model.sha256[:12] in page


def test_runs_are_kept_nowhere_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match="no folder that can be written to"):
        KeptRuns(tmp_path / "file" / "runs")
    KeptRuns(tmp_path / "new" / "runs")
    assert not (tmp_path / "new").exists()
