"""The firmware's files build on each other only downwards: port -> app -> core, and no circle among files."""

import re
import subprocess
from pathlib import Path

import pytest
from core_bindings import FIRMWARE

LAYERS = {"core": {"core"}, "app": {"core", "app"}, "port/host": {"core", "app", "port/host"}}
LAYERS["port/stm32f4"] = {"core", "app", "port/stm32f4"}
LAYERS["port/stm32f4/bootloader"] = {"app", "port/stm32f4", "port/stm32f4/bootloader"}
BACK_ARROWS = {("port/stm32f4/start", "port/stm32f4/main", "main")}
"""The start out of reset ends in main(), whose name the C language gives."""
BOARD = ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=soft", '-DBOARD_NAME="nucleo_f446re"']
BOARD += ['-DBOARD_FILE="port/stm32f4/boards/nucleo_f446re.h"', "-DPHASELEAD_VERSION=0u"]
BOARD += [f'-DBOOTLOADER_BINARY="{__file__}"']  # any file


def unit(path):
    """A .c file and its header are one."""
    return path.relative_to(FIRMWARE).with_suffix("").as_posix()


def files(folder):
    return sorted((FIRMWARE / folder).glob("*.[ch]"))


def includes(folder):
    """(unit, unit it includes) of every file in a folder."""
    found = set()
    for path in files(folder):
        for name in re.findall(r'^#include "([^"]+)\.h"', path.read_text(), re.M):
            if name.startswith(("app/", "core/", "port/")) and name != unit(path):
                found.add((unit(path), name))
    return found


def symbols(compiler, nm, flags, folder, to):
    """Of every unit of a folder the symbols that it defines, and those that it uses."""
    defined, used = {}, {}
    for path in sorted((FIRMWARE / folder).glob("*.c")):
        made = to / f"{path.stem}.o"
        command = [compiler, "-std=gnu11", "-w", *flags, '-DPHASELEAD_BUILD_ID="0"', f"-I{FIRMWARE}", "-c", str(path)]
        subprocess.run([*command, "-o", str(made)], check=True)
        listing = subprocess.run([nm, str(made)], check=True, capture_output=True, text=True).stdout
        for kind, name in re.findall(r"^.{8,16} (\w) (\w+)$", listing, re.M):
            if kind == "U":
                used.setdefault(unit(path), set()).add(name)
            elif kind.isupper():
                defined[name] = unit(path)
    return defined, used


def uses(compiler, nm, flags, folder, to):
    """(unit, unit whose function or variable it uses) within a folder."""
    defined, used = symbols(compiler, nm, flags, folder, to)
    arrows = {(user, defined[name], name) for user, names in used.items() for name in names if name in defined}
    assert arrows
    return {(user, definer) for user, definer, _ in arrows - BACK_ARROWS}


def circle(arrows):
    """Names along a circle; empty when there is none."""
    follows = {}
    for start, end in arrows:
        follows.setdefault(start, set()).add(end)
    done = set()

    def visit(name, path):
        if name in path:
            return [*path[path.index(name) :], name]
        if name in done:
            return []
        for following in sorted(follows.get(name, ())):
            if found := visit(following, [*path, name]):
                return found
        done.add(name)
        return []

    return next((found for name in sorted(follows) if (found := visit(name, []))), [])


@pytest.mark.parametrize("folder", LAYERS)
def test_a_layer_includes_only_itself_and_those_below(folder):
    allowed = LAYERS[folder]
    assert not [(user, used) for user, used in includes(folder) if Path(used).parent.as_posix() not in allowed]


@pytest.mark.parametrize("folder", ["core", "app", "port/host"])
def test_no_file_comes_back_to_itself(folder, compiler, tmp_path):
    flags = ["-I" + str(FIRMWARE.parent / "host" / "phaselead" / "sim" / "kernel")]
    assert not circle(includes(folder) | uses(compiler("cc"), compiler("nm"), flags, folder, tmp_path))


@pytest.mark.parametrize("folder", ["port/stm32f4", "port/stm32f4/bootloader"])
def test_no_file_of_the_board_comes_back_to_itself(folder, compiler, tmp_path):
    arm, nm = compiler("arm-none-eabi-gcc"), compiler("arm-none-eabi-nm")
    assert not circle(includes(folder) | uses(arm, nm, BOARD, folder, tmp_path))


def test_every_folder_is_in_a_layer():
    assert {path.parent.relative_to(FIRMWARE).as_posix() for path in FIRMWARE.rglob("*.c")} == set(LAYERS)


def test_the_one_back_arrow_is_there(compiler, tmp_path):
    """An exception that is no longer needed goes."""
    arm, nm = compiler("arm-none-eabi-gcc"), compiler("arm-none-eabi-nm")
    defined, used = symbols(arm, nm, BOARD, "port/stm32f4", tmp_path)
    assert [name in used[user] and defined[name] == definer for user, definer, name in BACK_ARROWS] == [True]


def test_a_circle_would_be_seen():
    assert circle({("a", "b"), ("b", "c"), ("d", "a")}) == []
    assert circle({("a", "b"), ("b", "c"), ("c", "b")}) == ["b", "c", "b"]
