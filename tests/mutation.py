"""Breaks firmware/core and firmware/app in many places, one at a time, and counts what the tests notice: make mutation.

python tests/mutation.py [--count 200] [--seed 1] [--only firmware/core/pid.c] [--parallel 1] [--again SOURCE.jsonl]

A mutant changes one token: a condition, a limit, a sign, a constant, or a lock that is not taken. The places are drawn
with a fixed seed, from every file by its length. Results are appended to out/mutation/SOURCE.jsonl, where SOURCE is the
hash of firmware, host and tests: a run that was cut short goes on, and one of other sources begins anew. The tests of
the broken file come first for all mutants, then all others for those that are left. --again tries
only those that survived in another such file, after tests were added. docs/promises.md lists those that survive, with
the reason.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import random
import re
import signal
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

from firmware_tree import ROOT, FirmwareTree

LEFT_OUT = ("test_builds.py", "test_arrows.py", "test_neighbours.py", "test_generated.py")
"""They read the source, or would tell any change of it."""
TESTS = [
    str(path.relative_to(ROOT))
    for room in ("core", "app", "soak", "wire")
    for path in sorted((ROOT / "tests" / room).glob("test_*.py"))
    if path.name not in LEFT_OUT
]
PLUGIN = ("-p", "without_shrinking")
STRICT = ("-Wall", "-Wextra", "-Werror")
"""A mutant that gives a warning does not build, here as in the tests."""
FIRST_CPU_S, REST_CPU_S = 60, 400
"""Of one run of tests, which take 15 and 80 s at most: processor time, so that a busy machine makes no mutant hang."""
TESTS_FAILED = 1
"""What pytest exits with then; from 2 on it could not run them."""
GENERATED = ("wire.c", "wire.h")
FIRST = {
    "axes": ("app/test_paths", "app/test_motion"),
    "axis": ("core/test_axis", "core/test_watch"),
    "axis_mode": ("core/test_axis",),
    "axis_path": ("core/test_axis", "app/test_paths", "app/test_motion"),
    "boot_record": ("app/test_update", "app/test_update_cut"),
    "commands_axis": ("app/test_paths", "app/test_device_session", "app/test_motion"),
    "commands_model": ("app/test_model", "app/test_before_arm"),
    "commands_motion": ("app/test_motion", "app/test_queue_fault"),
    "commands_own": ("app/test_hard_limits", "app/test_own_records_journal"),
    "commands_points": ("app/test_points",),
    "commands_state": ("app/test_device_session", "app/test_before_arm", "app/test_supervisor"),
    "commands_stream": ("app/test_recorder",),
    "commands_transient": ("app/test_transient",),
    "commands_update": ("app/test_update", "app/test_update_cut"),
    "compensation": ("core/test_compensation", "core/test_axis", "core/test_inverse"),
    "decoupling": ("core/test_decouple", "app/test_expand_model"),
    "device": ("app/test_hard_limits", "app/test_before_arm", "app/test_model"),
    "device_tick": ("app/test_faults", "app/test_paths"),
    "axis_state": ("core/test_axis",),
    "events": ("app/test_motion", "app/test_paths"),
    "line": ("app/test_device_session",),
    "fault_log": ("app/test_own_records_journal", "app/test_faults"),
    "fault_writing": ("app/test_own_records_journal",),
    "feedforward_tables": ("core/test_feedforward",),
    "flash_port": ("app/test_flash", "app/test_storage_attack"),
    "hard_limits": ("app/test_hard_limits",),
    "image": ("app/test_update",),
    "inverse_make": ("core/test_inverse",),
    "inverse_memory": ("core/test_inverse",),
    "journal": ("app/test_own_records_journal", "app/test_storage_attack"),
    "model_check": ("app/test_model",),
    "model_inverse": ("app/test_model",),
    "model_slot": ("app/test_model",),
    "model_store": ("app/test_flash", "app/test_storage_attack", "app/test_model"),
    "motion": ("app/test_motion",),
    "path_check": ("app/test_paths", "app/test_motion"),
    "reaction": ("app/test_faults", "app/test_supervisor"),
    "recorder": ("app/test_recorder", "app/test_lost_ticks"),
    "segment": ("core/test_segment", "app/test_motion", "core/test_axis"),
    "service": ("app/test_device_session", "app/test_recorder"),
    "cobs": ("wire/test_cobs_decoder", "wire/test_codec"),
    "crc32": ("wire/test_codec",),
    "frame": ("wire/test_codec",),
    "update": ("app/test_update",),
}
"""Tests that are run first, by the name of the file; without an entry the one of its own name."""

SWAPS = {
    "condition": {"==": "!=", "!=": "==", "&&": "||", "||": "&&"},
    "limit": {" < ": " <= ", " <= ": " < ", " > ": " >= ", " >= ": " > "},
    "sign": {" + ": " - ", " - ": " + ", "(-": "(", "= -": "= "},
    "constant": {"true": "false", "false": "true"},
    "lock": {"device_lock(device);": "(void)device;", "device_unlock(device);": "(void)device;"},
}


class Mutant(NamedTuple):
    path: str
    line: int
    """From 1."""
    column: int
    kind: str
    old: str
    new: str


def blank_comments(text: str) -> str:
    """The same text with comments, strings and preprocessor lines as spaces."""
    pattern = r"/\*.*?\*/|\"(?:\\.|[^\"\\])*\"|'(?:\\.|[^'\\])*'|^#(?!define)[^\n]*|^_Static_assert.*?;"
    return re.sub(pattern, lambda m: re.sub(r"[^\n]", " ", m[0]), text, flags=re.S | re.M)


def places(path: Path) -> Iterator[Mutant]:
    """Every mutant of a file."""
    name = str(path.relative_to(ROOT))
    for number, line in enumerate(blank_comments(path.read_text()).splitlines(), 1):
        for kind, swaps in SWAPS.items():
            for old, new in swaps.items():
                for found in re.finditer(re.escape(old), line):
                    yield Mutant(name, number, found.start(), kind, old, new)
        for found in re.finditer(r"(?<![\w.])([1-9]\d*)(?=u?\b)", line):
            yield Mutant(name, number, found.start(), "constant", found[1], str(int(found[1]) + 1))
        if (found := re.match(r"\s*if \((.*)\)$", line)) and "&&" not in line and "||" not in line:
            yield Mutant(name, number, found.start(1), "condition", found[1], f"!({found[1]})")


def sample(count: int, seed: int, only: str | None) -> list[Mutant]:
    """So many places, drawn evenly over all of the code; a twentieth of them are locks, of which there are few."""
    files = [f for part in ("core", "app") for f in sorted((ROOT / "firmware" / part).glob("*.[ch]"))]
    found = [m for f in files if f.name not in GENERATED for m in places(f) if only in (None, m.path)]
    draw = random.Random(seed)
    locks = [m for m in found if m.kind == "lock"]
    others = [m for m in found if m.kind != "lock"]
    chosen = draw.sample(locks, min(count // 20, len(locks)))
    return [*draw.sample(others, min(count - len(chosen), len(others))), *chosen]


def order(mutant: Mutant) -> tuple[list[str], list[str]]:
    """Test files for a mutant: those to run first, and the rest of those that run this code."""
    path = Path(mutant.path)
    rooms = {"core", "app", "soak"} if path.parent.name == "core" else {"app", "soak"}
    if path.stem in ("cobs", "crc32", "frame"):
        rooms.add("wire")
    first = [f"tests/{name}.py" for name in FIRST.get(path.stem, (f"core/test_{path.stem}", f"app/test_{path.stem}"))]
    if mutant.kind == "lock":
        first = ["tests/soak/test_soak.py"]
    known = [name for name in TESTS if Path(name).parent.name in rooms]
    return [name for name in first if name in known], [name for name in known if name not in first]


def outcome(tree: FirmwareTree, files: list[str], cpu_s: int) -> str:
    """`survived`, `caught` by a failing test, `crashes` or `hangs`: the process that ran it ended, or did not.
    Exits where the tests could not be run, which says nothing of the mutant."""
    done = tree.test("-x", *PLUGIN, *files, cpu_s=cpu_s)
    if done.returncode > TESTS_FAILED:
        raise SystemExit(f"the tests could not be run:\n{done.stdout}{done.stderr}")
    if done.returncode < 0:
        return "hangs" if -done.returncode == signal.SIGXCPU else "crashes"
    return "caught" if done.returncode == TESTS_FAILED else "survived"


def try_mutant(tree: FirmwareTree, mutant: Mutant, files: list[str], cpu_s: int) -> str:
    """The outcome of these tests, or `invalid`: it does not build."""
    path = tree.folder / mutant.path
    text = path.read_text()
    lines = text.splitlines(keepends=True)
    line = lines[mutant.line - 1]
    assert line[mutant.column :].startswith(mutant.old), mutant
    lines[mutant.line - 1] = line[: mutant.column] + mutant.new + line[mutant.column + len(mutant.old) :]
    path.write_text("".join(lines))
    try:
        if not tree.build():
            return "invalid"
        return outcome(tree, files, cpu_s) if files else "survived"
    finally:
        path.write_text(text)


def source_hash(tree: FirmwareTree) -> str:
    """Of all that decides whether a mutant is caught."""
    digest = hashlib.sha256()
    for name in tree.names:
        if name.startswith(("firmware/", "host/", "tests/")) and not name.endswith(".so"):
            digest.update(name.encode() + b"\0" + (tree.folder / name).read_bytes())
    return digest.hexdigest()[:12]


def read_results(path: Path) -> dict[Mutant, str]:
    rows = map(json.loads, path.read_text().splitlines()) if path.is_file() else ()
    return {Mutant(*row["mutant"]): row["result"] for row in rows}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", help="one file")
    parser.add_argument("--again", type=Path, help="results whose survivors are tried")
    parser.add_argument("--parallel", type=int, default=1)
    parser.add_argument("--least", type=float, default=95.0, help="per cent caught")
    arguments = parser.parse_args()
    folder = ROOT / "out" / "mutation"
    folder.mkdir(parents=True, exist_ok=True)
    if arguments.again:
        chosen = [mutant for mutant, result in read_results(arguments.again).items() if result == "survived"]
    else:
        chosen = sample(arguments.count, arguments.seed, arguments.only)
    trees = [FirmwareTree(folder / f"tree{i}", *STRICT) for i in range(arguments.parallel)]
    results = folder / f"{source_hash(trees[0])}.jsonl"
    done = read_results(results)
    if not all(tree.build() for tree in trees):
        raise SystemExit("the firmware does not compile")
    if not done and outcome(trees[0], TESTS, REST_CPU_S) != "survived":
        raise SystemExit("the tests fail without any mutant")

    def take(mutant: Mutant, part: int) -> None:
        tree, begun = trees.pop(), time.monotonic()
        found = try_mutant(tree, mutant, order(mutant)[part], (FIRST_CPU_S, REST_CPU_S)[part])
        done[mutant] = "passed first" if (part, found) == (0, "survived") else found
        row = {"mutant": mutant, "result": done[mutant], "seconds": round(time.monotonic() - begun, 1)}
        with results.open("a") as file:
            file.write(json.dumps(row) + "\n")
        trees.append(tree)

    for part, begins_with in ((0, None), (1, "passed first")):
        with ThreadPoolExecutor(arguments.parallel) as pool:
            left = [mutant for mutant in chosen if done.get(mutant) == begins_with]
            list(pool.map(take, left, [part] * len(left)))
    valid = [mutant for mutant in chosen if done[mutant] != "invalid"]
    survivors = [mutant for mutant in valid if done[mutant] == "survived"]
    for m in survivors:
        print(f"{m.path}:{m.line}: {m.kind}: {m.old.strip()} -> {m.new.strip()}")
    caught = 100 * (1 - len(survivors) / max(1, len(valid)))
    print(f"{len(valid) - len(survivors)} of {len(valid)} caught, {caught:.1f} %", file=sys.stderr)
    return 0 if caught >= arguments.least else 1


if __name__ == "__main__":
    raise SystemExit(main())
