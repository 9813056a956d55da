"""The package as a user gets it: a wheel built from the sdist, installed in a bare environment, run outside the clone.

Where another version of Python is on the path, the same wheel runs under that one; ``PACKAGE_PYTHON`` names one.
"""

from __future__ import annotations

import json
import os
import re
import runpy
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BUILD_ID = runpy.run_path(str(ROOT / "firmware" / "build_id.py"))["build_id"](ROOT)
OTHERS = ("python3.13", "python3.12")


def run(*command: str | Path, cwd: Path, status: int = 0) -> subprocess.CompletedProcess[str]:
    """A command that must end with this status, with nothing of the clone or of pytest in its environment."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "PHASELEAD"))}
    done = subprocess.run(
        list(map(str, command)),
        cwd=cwd,
        env=environment | {"OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == status, (
        f"{command}: status {done.returncode}\n{done.stdout[-2000:]}\n{done.stderr[-4000:]}"
    )
    return done


@pytest.fixture(scope="module")
def dist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the sdist and of the wheel that was built from it."""
    folder = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, ROOT, cwd=folder)
    return folder


@pytest.fixture(scope="module")
def wheel(dist: Path) -> Path:
    (found,) = dist.glob("*.whl")
    return found


def locked(folder: Path) -> Path:
    """The versions of requirements.lock as constraints: with their hashes, pip would want one of our wheel too."""
    text = re.sub(r" \\\n +--hash=\S+", "", (ROOT / "requirements.lock").read_text())
    assert "--hash" not in text
    path = folder / "constraints.txt"
    path.write_text(text)
    return path


def python_for_the_wheel() -> str:
    """Another version than ours where one runs, else ours."""
    if named := os.environ.get("PACKAGE_PYTHON"):
        return named
    for name in OTHERS:
        if (path := shutil.which(name)) and not subprocess.run(
            [path, "-m", "venv", "-h"], capture_output=True
        ).returncode:
            return path
    return sys.executable


@pytest.fixture(scope="module")
def bare(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The programs of an environment that holds the wheel and what it depends on."""
    folder = tmp_path_factory.mktemp("bare")
    run(python_for_the_wheel(), "-m", "venv", folder / "venv", cwd=folder)
    programs = folder / "venv" / "bin"
    install = ("install", "--disable-pip-version-check", "--no-compile", "-q", "-c", locked(folder))
    run(programs / "python", "-m", "pip", *install, wheel, cwd=folder)
    return programs


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the commands are run; each test adds its files."""
    return tmp_path_factory.mktemp("work")


@pytest.fixture(scope="module")
def tracked(bare: Path, folder: Path) -> tuple[str, str]:
    """Two short runs on the built-in stage."""
    for volts in (5, 3):
        wave = f"sine:{volts}V@10Hz"
        run(bare / "phaselead", "track", wave, "--mode", "open", "--duration", "0.3", "-o", f"{volts}.h5", cwd=folder)
    return "5.h5", "3.h5"


@pytest.fixture(scope="module")
def stage(bare: Path, folder: Path, tracked: tuple[str, str]) -> str:
    run(bare / "phaselead", "fit", tracked[0], "--base", "linear", "-o", "stage.toml", cwd=folder)
    return "stage.toml"


def test_the_wheel_fits_every_python_3_of_its_platform(wheel):
    assert re.fullmatch(r"phaselead-[\d.]+-py3-none-[^-]+\.whl", wheel.name)
    names = zipfile.ZipFile(wheel).namelist()
    libraries = {name for name in names if name.endswith((".so", ".pyd"))}
    expected = {"phaselead/model/_kernel", "phaselead/sim/_firmware"}
    expected |= {"phaselead/sim/_emulator"} if sys.platform == "linux" else set()
    assert {name.split(".")[0] for name in libraries} == expected
    assert all(name.count(".") == 1 for name in libraries)
    assert [name for name in names if name.endswith((".c", ".h"))] == []


def test_the_wheel_has_the_whole_page(wheel):
    """With the licence of what others wrote."""
    static = ROOT / "host/phaselead/scope/static"
    wanted = {f"phaselead/scope/static/{path.relative_to(static)}" for path in static.rglob("*") if path.is_file()}
    assert "phaselead/scope/static/vendor/uPlot-LICENSE.txt" in wanted
    assert wanted <= set(zipfile.ZipFile(wheel).namelist())


def test_the_wheel_says_what_it_needs_and_may_be_used_for(wheel):
    archive = zipfile.ZipFile(wheel)
    (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
    lines = archive.read(name).decode().splitlines()
    assert {"License-Expression: MIT", "License-File: LICENSE", "Requires-Python: >=3.11"} <= set(lines)
    needs = [line.split(";") for line in lines if line.startswith("Requires-Dist:")]
    assert [need[0] for need in needs if "==" in need[0] and 'extra == "board"' not in need[-1]] == []
    assert ["Requires-Dist: numpy>=2.0"] in needs


def test_the_sdist_holds_the_whole_firmware(dist, tmp_path):
    (sdist,) = dist.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        archive.extractall(tmp_path, filter="data")
    (source,) = tmp_path.iterdir()
    assert runpy.run_path(str(source / "firmware" / "build_id.py"))["build_id"](source) == BUILD_ID
    assert {"requirements.lock", "Makefile", "setup.sh", "CHANGELOG.md", "CITATION.cff", "tests", "docs"} <= {
        path.name for path in source.iterdir()
    }
    assert not list(source.rglob("*.so"))


def test_the_package_is_imported_from_where_it_was_installed(bare, folder):
    said = run(bare / "python", "-c", "import phaselead; print(phaselead.__file__, phaselead.__version__)", cwd=folder)
    path, version = said.stdout.split()
    assert bare.parent in Path(path).parents
    assert version == "0.1.0"


def test_help_and_ports(bare, folder):
    assert "selftest" in run(bare / "phaselead", "--help", cwd=folder).stdout
    assert "Cause: " in run(bare / "phaselead", "explain", "host_timeout", cwd=folder).stdout
    assert "ports" in json.loads(run(bare / "phaselead", "ports", "--json", "-", cwd=folder).stdout)


def test_the_firmware_inside_is_the_clone_s(bare, folder):
    info = json.loads(run(bare / "phaselead", "info", "--json", "-", cwd=folder).stdout)
    assert info["build_id"] == BUILD_ID


def test_a_path_is_tracked_and_replayed(bare, folder):
    track = ("track", "sine:60um@20Hz", "--mode", "pid", "--duration", "0.3", "-o", "pid.h5", "--json", "-")
    assert json.loads(run(bare / "phaselead", *track, cwd=folder).stdout)["dropped"] == 0
    assert "the same" in run(bare / "phaselead", "replay", "pid.h5", cwd=folder).stdout


def test_a_model_is_fitted_and_verified(bare, folder, tracked, stage):
    verify = ("verify", "--model", stage, tracked[1], "--json", "-")
    (record,) = json.loads(run(bare / "phaselead", *verify, cwd=folder).stdout)["records"]
    assert 0 < record["mean_pct"] < 20


def test_a_gap_is_looked_for_and_shown(bare, folder, tracked, stage):
    records = ("--train", tracked[0], "--holdout", tracked[1])
    files = ("-o", "next.toml", "--report", "gap.html", "--json", "gap.json")
    run(bare / "phaselead", "gap", "--model", stage, *records, *files, cwd=folder)
    assert json.loads((folder / "gap.json").read_text())["verdicts"]
    assert "<svg" in (folder / "gap.html").read_text()


@pytest.mark.parametrize(
    ("command", "missing"),
    [
        (("status", "--port", "qemu://nucleo_f446re"), "run `make firmware` in the source tree, or give ?elf=FILE"),
        (("flash", "--check-only"), "flash needs phaselead's source tree"),
        (("gap", "campaign", "--truth", "truth", "-o", "out"), "the source tree has one in tests/gap/truth"),
    ],
)
def test_what_only_the_source_tree_has_is_said_in_one_line(bare, folder, command, missing):
    (line,) = run(bare / "phaselead", *command, cwd=folder, status=2).stderr.splitlines()
    assert missing in line
