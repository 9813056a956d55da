"""What a command prints and what the same call gives in Python are the same figures."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest
from click.testing import CliRunner

import phaselead as pl
from phaselead.cli import main
from phaselead.result import jsonable

COUNTERPARTS = {
    "demo": "demo",
    "identify": "Controller.identify",
    "fit": "fit",
    "verify": "verify",
    "predict": "predict",
    "upload": "Controller.upload",
    "track": "Controller.track",
    "learn": "Controller.learn",
    "tune": "Controller.tune",
    "move": "Controller.move",
    "hold": "Controller.hold",
    "where": "Controller.where",
    "arm": "Controller.arm",
    "park": "Controller.park",
    "stop": "stop",
    "status": "Controller.status",
    "info": "Controller.info",
    "ports": "ports",
    "log record": "Controller.record",
    "limits": "Controller.set_limits",
    "log faults": "Controller.fault_log",
    "log trigger": "Controller.trigger",
    "log pull": "Controller.pull",
    "log info": "Recording.facts",
    "log export": "export",
    "log import": "import_recordings",
    "log recover": "recover",
    "replay": "replay",
    "gap": "gap",
    "gap next": "gap_next",
    "gap campaign": "campaign",
    "scope": "scope",
    "gcs": "gcs",
    "sim": "sim",
    "flash": "flash",
    "selftest": "Controller.selftest",
    "explain": "explain",
    "doctor": "Controller.doctor",
    "plot": "plot",
}


def commands() -> set[str]:
    """Every command; a group counts where it does something by itself."""
    found = set()
    for name in main.list_commands(click.Context(main)):
        command = main.get_command(click.Context(main), name)
        if isinstance(command, click.Group):
            found |= {f"{name} {part}" for part in command.commands}
        if not isinstance(command, click.Group) or command.invoke_without_command:
            found.add(name)
    return found


def test_every_command_has_its_counterpart() -> None:
    assert commands() == {*COUNTERPARTS, "completion"}
    for path in COUNTERPARTS.values():
        thing: Any = pl
        for name in path.split("."):
            thing = getattr(thing, name)
        assert callable(thing)


def cli(*words: object) -> Any:
    """The JSON of a command."""
    result = CliRunner().invoke(main, [*map(str, words), "--json", "-"])
    assert result.exit_code in (0, 1), result.stderr
    return json.loads(result.stdout)


def plain(figures: Any) -> Any:
    """As JSON would give them back."""
    return json.loads(json.dumps(jsonable(figures)))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, records: pl.Recordings, fitted: pl.FitResult) -> Path:
    """The records as CSV, a.csv and b.csv fitted, c.csv held out; and the model."""
    found = tmp_path_factory.mktemp("kept")
    for name, record in zip("abc", records, strict=True):
        pl.export(record, found / f"{name}.csv")
    fitted.save(found / "stage.toml")
    return found


def test_fit(folder: Path, tmp_path: Path) -> None:
    files = [folder / "a.csv", folder / "b.csv"]
    printed = cli("fit", *files, "-o", tmp_path / "out.toml")
    result = pl.fit(files)
    assert plain(result.as_dict()) == {key: value for key, value in printed.items() if key != "output"}
    written, made = pl.load(tmp_path / "out.toml"), result.model
    assert written.axes == made.axes
    assert written.provenance.data == made.provenance.data


def test_verify(folder: Path) -> None:
    printed = cli("verify", "--model", folder / "stage.toml", folder / "c.csv")
    assert plain(pl.verify(folder / "stage.toml", folder / "c.csv").as_dict()) == printed


def test_predict(folder: Path, tmp_path: Path) -> None:
    cli("predict", "--model", folder / "stage.toml", folder / "c.csv", "-o", tmp_path / "out.csv")
    (written,) = pl.read(tmp_path / "out.csv")
    assert np.array_equal(written.x_um, pl.predict(folder / "stage.toml", folder / "c.csv").x_um)


@pytest.mark.parametrize(
    ("wave", "words", "options"),
    [
        ("sine:60um@5Hz", ["--mode", "pid"], {"mode": "pid"}),
        (
            "sine:40um@5Hz",
            ["--mode", "inverse+pid", "--gains", "paper", "--force"],  # the model has no modes: with these it swings
            {"mode": "inverse+pid", "gains": "paper", "force": True},
        ),
        ("sine:5V@5Hz", ["--mode", "open", "--axis", "y"], {"mode": "open", "axis": "y"}),
        ("goto:30um", ["--mode", "pid", "--gains", "0,2,0"], {"mode": "pid", "gains": (0, 2, 0)}),
    ],
)
def test_track(folder: Path, wave: str, words: list[str], options: dict[str, Any]) -> None:
    model = [] if wave.startswith("sine:5V") else ["--model", folder / "stage.toml"]
    printed = cli("track", wave, *words, *model, "--duration", 1)
    with pl.connect() as dev:
        run = dev.track(wave, duration=1, model=folder / "stage.toml" if model else None, **options)
    assert plain(run.figures) == printed


def test_several_axes() -> None:
    printed = cli("track", "x=sine:60um@5Hz,y=sine:30um@5Hz", "--mode", "pid", "--duration", 0.4)
    runs = []
    for call in (
        {"wave": {"x": "sine:60um@5Hz", "y": "sine:30um@5Hz"}},
        {"x": "sine:60um@5Hz", "y": "sine:30um@5Hz"},
        {"wave": "x=sine:60um@5Hz,y=sine:30um@5Hz"},
    ):
        with pl.connect() as dev:
            wave = call.pop("wave", None)
            runs.append(dev.track(wave, mode="pid", duration=0.4, **call))
    assert [plain(run.figures) for run in runs] == [printed] * 3
    assert list(runs[0].columns) == ["t_s", "ux_V", "uy_V", "x_um", "y_um", "rx_um", "ry_um"]


def test_record_and_info(tmp_path: Path) -> None:
    printed = cli("log", "record", "--drive", "sine:5V@5Hz", "--duration", 0.4, "-o", tmp_path / "cli.h5")
    with pl.connect() as dev:
        record = dev.record("sine:5V@5Hz", duration=0.4, output=tmp_path / "here.h5")
    facts = plain(record.facts())
    assert facts.pop("source") == str(tmp_path / "here.h5")
    assert facts == {key: value for key, value in printed.items() if key != "output"}
    (read,) = pl.read(tmp_path / "cli.h5")
    hashes = {"sha256": read.sha256, "samples_sha256": read.samples_sha256}
    assert plain(read.facts()) | hashes == cli("log", "info", tmp_path / "cli.h5")
    assert plain(pl.replay(tmp_path / "here.h5").as_dict()) == cli("replay", tmp_path / "here.h5")


def test_device(folder: Path) -> None:
    with pl.connect() as dev:
        assert plain(dev.info()) == cli("info")
    with pl.connect() as dev:
        uploaded = dev.upload(folder / "stage.toml", persist=True)
    printed = cli("upload", folder / "stage.toml", "--persist")
    assert plain(uploaded.as_dict()) == {key: value for key, value in printed.items() if key != "model"}
    with pl.connect() as dev:
        assert plain(dev.selftest("x").as_dict()) == cli("selftest", "--axis", "x", "--yes")
    assert plain({"ports": [{"url": p.url, "description": p.description} for p in pl.ports()]}) == cli("ports")
    with pl.connect() as dev:
        assert dev.arm().state == cli("arm")["state"] == "armed"
    with pl.connect() as dev:
        assert dev.park().state == cli("park")["state"] == "parked"


def test_the_port_is_looked_up_when_it_is_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PHASELEAD_PORT", "sim://xyz250?seed=7")
    with pl.connect() as dev:
        assert dev.info()["port"] == "sim://xyz250?seed=7"


def test_gap(tmp_path: Path) -> None:
    def made(f_Hz: float, seed: int) -> str:
        t_s = np.arange(300) / 200
        u_V = 2.5 - 2.5 * np.cos(2 * np.pi * f_Hz * t_s)
        x_um = 20 * u_V + np.random.default_rng(seed).normal(0, 0.01, 300)
        path = tmp_path / f"{f_Hz:g}-{seed}.csv"
        pl.export(pl.recording(t_s=t_s, u_V=u_V, x_um=x_um), path)
        return str(path)

    train, holdout = made(2, 1), made(3, 2)
    pl.fit(train, base="linear").save(tmp_path / "base.toml")
    words = ["--model", tmp_path / "base.toml", "--train", train, "--holdout", holdout]
    printed = cli("gap", *words, "-o", tmp_path / "next.toml", "--report", tmp_path / "cli.html")
    result = pl.gap(tmp_path / "base.toml", train=train, holdout=holdout)
    assert plain(result.as_json()) == printed
    assert result.next_model.axes == pl.load(tmp_path / "next.toml").axes
    pl.write_report(result, tmp_path / "here.html")
    result.save_json(tmp_path / "gap.json")
    assert json.loads((tmp_path / "gap.json").read_text()) == printed
    with pytest.raises(pl.BadInput, match="exists"):
        result.save_json(tmp_path / "gap.json")
    shows_itself(result)


PROPOSAL = {
    "ties": [["creep", "delay"]],
    "next_experiment": {
        "waveform": "sine", "level": 2.0, "band": [5.0, 5.0], "bias": 1.0, "axis": None, "seconds": 0.4,
        "separation": 9.0, "needs_sensor": None,
    },
}  # fmt: skip


def test_gap_next(tmp_path: Path) -> None:
    (tmp_path / "gap.json").write_text(json.dumps(PROPOSAL))
    result = CliRunner().invoke(main, ["gap", "next", str(tmp_path / "gap.json"), "-o", str(tmp_path / "cli.h5")])
    assert result.exit_code == 0, result.stderr
    record = pl.gap_next(tmp_path / "gap.json", output=tmp_path / "here.h5")
    written = pl.read(tmp_path / "cli.h5")[0]
    assert all(np.array_equal(record.columns[name], written.columns[name]) for name in ("t_s", "u_V", "x_um"))


def test_recover(tmp_path: Path) -> None:
    """Of a program that ended without a word in the middle of a run."""
    program = (
        "import os, phaselead as pl; dev = pl.connect(); "
        f"dev.track('sine:60um@5Hz', mode='pid', output={str(tmp_path / 'run.h5')!r}, "
        "on_progress=lambda done: done > 0.5 and os._exit(9))"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 9
    recording = pl.recover(tmp_path / "run.h5.journal", tmp_path / "run.h5")
    assert recording.meta["mode"] == "pid"
    assert (recording.meta["torn_bytes"], recording.meta["damaged_frames"]) == (0, 0)
    assert 0 < len(recording.t_s) < 10000
    assert not (tmp_path / "run.h5.journal").exists()


def shows_itself(result: Any) -> None:
    assert str(result)
    assert repr(result).startswith("<")
    assert "<table>" in result._repr_html_()
    assert result.plot()._repr_png_().startswith(b"\x89PNG")
    assert list(result.to_pandas().columns) == list(result.columns)
