"""The boards: each is a section of platformio.ini and a file of constants, and a firmware says which it is for."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from phaselead import source_tree
from phaselead.errors import BadInput
from phaselead.sim.emulated import hardware_of

ROOT = Path(__file__).parents[2]
CONSTANTS = {"BOARD_CHIP": {"F405", "F446"}, "BOARD_HSE_BYPASS": {"0", "1"}, "BOARD_USART": {"1", "2"}}


def test_every_board_has_its_section_and_its_file():
    files = {path.stem: path.read_text("utf-8") for path in (ROOT / "firmware/port/stm32f4/boards").glob("*.h")}
    assert set(source_tree.boards()) == set(files)
    for text in files.values():
        found = dict(re.findall(r"^#define (\w+) (\w+)", text, re.MULTILINE))
        assert set(found) == set(CONSTANTS)
        assert all(value in CONSTANTS[name] for name, value in found.items())


def test_without_a_source_tree_there_is_no_board(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(source_tree, "OWN", tmp_path)
    assert source_tree.source_tree() is None
    assert source_tree.boards() == ()


def test_the_tree_of_the_current_folder_comes_first(tmp_path, monkeypatch):
    (tmp_path / "firmware").mkdir()
    (tmp_path / "firmware/build_id.py").touch()
    (tmp_path / "platformio.ini").write_text(
        "[env]\nplatform = p\n\n[env:second]\nboard = b\n\n[env:first]\nboard = b\n"
    )
    monkeypatch.chdir(tmp_path)
    assert source_tree.source_tree() == tmp_path
    assert source_tree.boards() == ("second", "first")


@pytest.mark.parametrize("content", [b"", b"chip=F446,usart=2", b"nucleo_f446re", b"nucleo_f446re chip=F103,usart=2"])
def test_a_firmware_for_another_board_is_refused(tmp_path, content):
    elf = tmp_path / "firmware.elf"
    elf.write_bytes(content)
    with pytest.raises(BadInput, match="is no firmware for nucleo_f446re; build it with `make firmware`"):
        hardware_of(elf, "nucleo_f446re")


def test_a_firmware_says_its_hardware(tmp_path):
    elf = tmp_path / "firmware.elf"
    elf.write_bytes(b"nucleo_f446re\0chip=F446,usart=2\0")
    assert hardware_of(elf, "nucleo_f446re") == "chip=F446,usart=2"
