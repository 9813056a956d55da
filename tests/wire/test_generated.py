"""The generated files are those of the schema, and the check notices when they are not."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
FILES = [
    "firmware/app/wire.h",
    "firmware/app/wire.c",
    "host/phaselead/device/wire.py",
    "docs/wire.md",
    "protocol/golden.json",
]


def generate(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(ROOT / "protocol" / "generate.py"), *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60)


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    for name in FILES:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    return tmp_path


def test_nothing_is_stale() -> None:
    result = generate("--check")
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize("name", FILES)
def test_a_touched_file_is_named(name: str, tree: Path) -> None:
    (tree / name).write_text((tree / name).read_text() + "\n")
    result = generate("--check", "--root", str(tree))
    assert result.returncode == 1
    assert result.stderr.splitlines() == [f"{name} is stale: run python protocol/generate.py"]


def test_a_missing_file_is_named_and_written_again(tree: Path) -> None:
    (tree / "docs/wire.md").unlink()
    assert "docs/wire.md is stale" in generate("--check", "--root", str(tree)).stderr
    assert generate("--root", str(tree)).stdout == "wrote docs/wire.md\n"
    assert generate("--check", "--root", str(tree)).returncode == 0


def test_a_changed_schema_makes_every_file_stale(tmp_path: Path) -> None:
    text = (ROOT / "protocol" / "schema.toml").read_text()
    changed = text.replace('{ name = "overruns", type = "u32"', '{ name = "overruns", type = "u64"')
    assert changed != text
    (tmp_path / "schema.toml").write_text(changed)
    result = generate("--check", "--schema", str(tmp_path / "schema.toml"))
    assert result.returncode == 1
    assert [line.split()[0] for line in result.stderr.splitlines()] == FILES


def fingerprint(tmp_path: Path, old: str, new: str) -> int:
    from layout import load

    text = (ROOT / "protocol" / "schema.toml").read_text()
    assert old in text
    (tmp_path / "schema.toml").write_text(text.replace(old, new, 1))
    return load(tmp_path / "schema.toml").fingerprint


def test_fingerprint_follows_the_layout_and_not_the_words(tmp_path: Path, schema: Any) -> None:
    assert fingerprint(tmp_path, "lower clamp, V", "the lower clamp") == schema.fingerprint
    assert fingerprint(tmp_path, 'states = ["parked"]', 'states = ["armed"]') == schema.fingerprint
    assert fingerprint(tmp_path, "locks_itself = true\n", "") == schema.fingerprint
    assert fingerprint(tmp_path, "the axis is idle; set", "the axis is idle: set") == schema.fingerprint
    assert fingerprint(tmp_path, "parked = 0", "parked = 9") != schema.fingerprint
    assert fingerprint(tmp_path, "max_payload = 1152", "max_payload = 1024") != schema.fingerprint
    assert fingerprint(tmp_path, "u_min_q24", "u_low_q24") != schema.fingerprint


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("number = 0x03", "number = 0x02", "share a number"),
        ('type = "axis_model[3]"', 'type = "axle[3]"', "unknown type axle"),
        ("max_payload = 1152", "max_payload = 40", "exceed max_payload"),
        ("feedback = 16", "feedback = 32", "one bit per field"),
        ('name = "u_max_q24"', 'name = "u_min_q24"', "occurs twice"),
        ('states = ["parked"]', 'states = ["asleep"]', "unknown state asleep"),
        ("refusals.bad_value", "refusals.bad_mood", "unknown status bad_mood"),
        ("the axis is idle", "the axis is idle" + 80 * "!", "longer than 90"),
        ('{ name = "offset", type = "u16"', '{ name = "offset", type = "bytes"', "must be the last"),
    ],
)
def test_a_schema_that_contradicts_itself_is_refused(old: str, new: str, message: str, tmp_path: Path) -> None:
    text = (ROOT / "protocol" / "schema.toml").read_text()
    assert old in text
    (tmp_path / "schema.toml").write_text(text.replace(old, new, 1))
    result = generate("--check", "--schema", str(tmp_path / "schema.toml"))
    assert result.returncode == 2
    assert message in result.stderr
    assert "Traceback" not in result.stderr
