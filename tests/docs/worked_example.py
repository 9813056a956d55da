"""Does what a page of docs/ says: its code blocks, applied to a copy of the source tree."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
STEP = re.compile(r"(Write|Add to) `([^`]+)`:\n\n```\w*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
IGNORED = shutil.ignore_patterns("__pycache__", "*.egg-info", "*.partial")


@dataclass(frozen=True)
class Tree:
    """A copy of parts of the source tree, in which commands run."""

    root: Path

    def run(self, *words: str, check: bool = True) -> subprocess.CompletedProcess[str]:
        """Runs Python with these words in the copy. Raises AssertionError with its output unless it succeeds."""
        paths = [str(self.root / "host"), *filter(None, [os.environ.get("PYTHONPATH")])]
        env = os.environ | {"PYTHONPATH": os.pathsep.join(paths), "COLUMNS": "100", "OMP_NUM_THREADS": "1"}
        done = subprocess.run(
            [sys.executable, *words], cwd=self.root, env=env, capture_output=True, text=True, check=False
        )
        assert not check or done.returncode == 0, done.stdout + done.stderr
        return done

    def text(self, path: str) -> str:
        return (self.root / path).read_text("utf-8")


def copy_tree(to: Path, *parts: str) -> Tree:
    """Copies files and folders of the source tree."""
    for part in parts:
        source, target = ROOT / part, to / part
        if source.is_dir():
            shutil.copytree(source, target, ignore=IGNORED)
        else:
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(source, target)
    return Tree(to)


def follow(page: str, tree: Tree) -> list[str]:
    """Writes the files that the page says to write and adds what it says to add; gives their paths."""
    steps = STEP.findall((ROOT / "docs" / page).read_text("utf-8"))
    for verb, path, block in steps:
        file = tree.root / path
        assert file.exists() == (verb == "Add to"), f"{page}: {verb} {path}"
        before = file.read_text("utf-8") if verb == "Add to" else ""
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(before + ("\n" if before else "") + block, "utf-8")
    assert steps, f"{page} says to write nothing"
    return [path for _, path, _ in steps]
