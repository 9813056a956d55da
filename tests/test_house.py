"""The rooms of the host package: arrows run one way, doors are used, and no files import each other in a circle."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import NamedTuple

import pytest

HOST = Path(__file__).parents[1] / "host"
ROOMS = (
    "cli", "api", "demo", "drivers", "gcs", "scope", "report", "validation", "gap", "control", "identify", "sim",
    "device", "waveforms", "model", "record", "drawing", "serial_ports", "result", "quantity", "compiled", "interrupt",
    "freed_memory", "source_tree", "nearest", "version", "errors",
)  # fmt: skip
"""From the top floor down: each may import only what stands after it. docs/design.md draws the same order."""
FACE = {"", "__main__"}
"""``import phaselead`` and ``python -m phaselead``: they open doors and are imported by nobody but for the version."""


class File(NamedTuple):
    """What the rules need to know of a module."""

    imports: tuple[tuple[str, str | None], ...]
    """(module, name) of every import below ``phaselead``, wherever it stands; name is None for ``import module``."""
    offered: frozenset[str] | None
    """``__all__``; None where it has none."""


Files = Mapping[str, File]


def read_file(text: str) -> File:
    found: list[tuple[str, str | None]] = []
    offered = None
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, "say where from in full"
            found += [(str(node.module), alias.name) for alias in node.names]
        elif isinstance(node, ast.Import):
            found += [(alias.name, None) for alias in node.names]
        elif isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            offered = frozenset(ast.literal_eval(node.value))
    return File(tuple(one for one in found if one[0].split(".")[0] == "phaselead"), offered)


def target(files: Files, module: str, name: str | None) -> str:
    """The file that an import reads."""
    return f"{module}.{name}" if f"{module}.{name}" in files else module


def room(module: str) -> str:
    return module.split(".")[1] if "." in module else ""


def climbs(files: Files) -> list[str]:
    """Imports that go up."""
    return [
        f"{reader} imports {module}, which is above it"
        for reader, file in files.items()
        for module, name in file.imports
        if room(reader) not in FACE and (above := room(target(files, module, name))) not in FACE
        if ROOMS.index(above) < ROOMS.index(room(reader))
    ]


def windows(files: Files) -> list[str]:
    """Imports that reach into another room past its door, or take from the door what it does not offer."""
    found = []
    for reader, file in files.items():
        for module, name in file.imports:
            if room(module) in ("", room(reader)):
                continue
            if module.count(".") > 1:
                found.append(f"{reader} reaches into {module}; import from phaselead.{room(module)}")
            elif files[module].offered is not None and name not in (files[module].offered or ()):
                found.append(f"{reader} takes {name} from {module}, whose __all__ does not offer it")
    return found


def inner_windows(files: Files) -> list[str]:
    """The same inside a room: imports that reach into one of its folders past that folder's door."""
    folders = {module for module in files if module.count(".") > 1 and any(f.startswith(f"{module}.") for f in files)}
    return [
        f"{reader} reaches into {module}; import from {folder}"
        for reader, file in files.items()
        for module, name in file.imports
        for folder in folders
        if target(files, module, name).startswith(f"{folder}.") and not f"{reader}.".startswith(f"{folder}.")
    ]


def circle(files: Files) -> list[str]:
    """Files that import each other in a circle, empty where there are none."""
    graph = {reader: {target(files, *one) for one in file.imports} - {reader} for reader, file in files.items()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def namesakes(files: Files) -> list[str]:
    """Doors that offer a function from a file of the same name: the import of one would hide the other."""
    return [
        f"{door} offers {name} from {module}; call the file otherwise"
        for door, file in files.items()
        for module, name in file.imports
        if door.count(".") == 1 and module == f"{door}.{name}"
    ]


@pytest.fixture(scope="module")
def files() -> dict[str, File]:
    """Every module of the package by its dotted name."""
    return {
        ".".join(path.relative_to(HOST).with_suffix("").parts).removesuffix(".__init__"): read_file(path.read_text())
        for path in sorted((HOST / "phaselead").rglob("*.py"))
    }


def test_every_room_has_its_floor(files):
    assert {room(module) for module in files} - FACE == set(ROOMS)


def test_every_room_has_a_door(files):
    rooms = {module for module in files if module.count(".") == 1 and (HOST / module.replace(".", "/")).is_dir()}
    assert [module for module in rooms if files[module].offered is None and module != "phaselead.cli"] == []


def test_arrows_run_down(files):
    assert climbs(files) == []


def test_nobody_climbs_through_a_window(files):
    assert windows(files) == []


def test_no_file_is_called_like_what_its_door_offers(files):
    assert namesakes(files) == []


def test_folders_inside_a_room_are_entered_by_their_doors(files):
    assert inner_windows(files) == []


def test_no_files_import_each_other_in_a_circle(files):
    assert circle(files) == []


@pytest.mark.parametrize(
    ("path", "line", "breach"),
    [
        ("phaselead.record.text", "from phaselead.model import Stage", climbs),
        ("phaselead.record.text", "def late():\n    from phaselead.model import Stage", climbs),
        ("phaselead.gap.noise", "from phaselead.model.operator import plays", windows),
        ("phaselead.gap.noise", "import phaselead.model.operator", windows),
        ("phaselead.gap.noise", "from phaselead.model import _private", windows),
        ("phaselead.gap.run", "from phaselead.gap.design.excitation import Excitation", inner_windows),
        ("phaselead.gap.run", "from phaselead.gap.design import excitation", inner_windows),
        ("phaselead.record.recording", "from phaselead.record.text import read_text", circle),
        ("phaselead.record", "from phaselead.record.export import export", namesakes),
    ],
)
def test_a_breach_is_seen(files, path, line, breach):
    """Each rule fails when it is broken, also by an import inside a function."""
    broken = {**files, path: File(files[path].imports + read_file(line).imports, files[path].offered)}
    assert breach(broken) != []
