"""A command, a waveform, a message and a board, added as their pages in docs/ say, and nothing else touched."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import pytest
from worked_example import ROOT, copy_tree, follow

from phaselead.device import wire
from phaselead.errors import BadInput
from phaselead.sim.emulated import check_qemu


@pytest.fixture(scope="module")
def with_command(tmp_path_factory):
    tree = copy_tree(tmp_path_factory.mktemp("command"), "host/phaselead")
    before = tree.run("-m", "phaselead", "--help").stdout
    assert follow("adding-a-command.md", tree) == ["host/phaselead/cli/where.py"]
    return tree, before


def test_an_added_command_is_the_last_of_the_list(with_command):
    tree, before = with_command
    line = "  where       Print position and output of every axis.\n"
    following = "\nRecords:\n"
    assert tree.run("-m", "phaselead", "--help").stdout == before.replace(following, line + following)


def test_an_added_command_runs(with_command):
    tree, _ = with_command
    assert "Nothing moves." in tree.run("-m", "phaselead", "where", "--help").stdout
    said = json.loads(tree.run("-m", "phaselead", "where", "--json", "-").stdout)
    assert list(said) == ["x", "y", "z"]
    assert all(" um at 0.000 V" in place for place in said.values())
    refused = tree.run("-m", "phaselead", "where", "--port", "sim://nowhere.toml", check=False)
    assert (refused.returncode, refused.stderr.count("\n")) == (2, 1)


@pytest.fixture(scope="module")
def with_waveform(tmp_path_factory):
    tree = copy_tree(tmp_path_factory.mktemp("waveform"), "host/phaselead", "docs/commands.md")
    assert follow("adding-a-waveform.md", tree) == ["host/phaselead/waveforms/trapezoid.py"]
    return tree


def test_an_added_waveform_is_in_the_help_and_the_manual(with_waveform):
    said = with_waveform.run("-m", "phaselead", "track", "--help").stdout
    assert "goto:120um, trapezoid:60um@5Hz," in " ".join(said.split())
    with_waveform.run("-m", "phaselead.report.waveform_table", "docs")
    row = "| `trapezoid:60um@5Hz` | up to 60 um, held, down to 0 and held, a quarter of the period each |\n"
    assert row in with_waveform.text("docs/commands.md")
    said = with_waveform.run("-m", "phaselead", "track", "wiggle:1um", check=False).stderr
    assert said.endswith("goto:120um, trapezoid:60um@5Hz\n")


def test_an_added_waveform_is_tracked(with_waveform, tmp_path):
    run = tmp_path / "run.h5"
    track = ("-m", "phaselead", "track", "trapezoid:60um@2Hz", "--mode", "pid", "--duration", "2", "-o", str(run))
    figures = json.loads(with_waveform.run(*track, "--json", "-").stdout)
    assert figures["range_um"] == pytest.approx(60, abs=1e-3)
    assert figures["max_pct"] < 10
    with h5py.File(run) as file:
        reference_um = file["r_um"][:2500]
    corners = [0, 625, 1250, 1875]
    assert reference_um[corners] == pytest.approx([0, 60, 60, 0], abs=0.2)
    assert reference_um[312] == pytest.approx(30, abs=0.2)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["trapezoid:60um"], "has no frequency; write it as in trapezoid:60um@5Hz"),
        (["trapezoid:300um@1Hz", "--mode", "pid"], "outside what the sensor sees"),
        (["trapezoid:5V@100Hz", "--mode", "open"], "it needs 2000 V/s, the slew limit is 1000 V/s; stay below 50 Hz"),
        (["trapezoid:60um@1Hz", "--mode", "open"], "mode open takes volts"),
    ],
)
def test_an_added_waveform_is_checked_before_anything_moves(with_waveform, words, told):
    stage = ("--model", str(with_waveform.root / "host/phaselead/sim/xyz250.toml"))
    refused = with_waveform.run("-m", "phaselead", "track", *words, *stage, check=False)
    assert refused.returncode == 2
    assert told in refused.stderr


GENERATED = (
    "firmware/app/wire.h",
    "firmware/app/wire.c",
    "host/phaselead/device/wire.py",
    "docs/wire.md",
    "protocol/golden.json",
)
CC = ("cc", "-std=c11", "-O1", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off", "-fno-strict-aliasing")


def compile_firmware(tree):
    """The firmware of this tree in place of the one that was copied with it."""
    (library,) = tree.root.glob("host/phaselead/sim/_firmware*.so")
    folders = ("firmware/core", "firmware/app", "firmware/port/host", "host/phaselead/sim/kernel")
    sources = [str(path) for folder in folders for path in sorted((tree.root / folder).glob("*.c"))]
    include = [f"-I{tree.root}/firmware", f"-I{tree.root}/host/phaselead/sim/kernel"]
    build_id = f'-DPHASELEAD_BUILD_ID="{"0" * 40}"'
    command = [*CC, "-shared", "-fPIC", "-fvisibility=hidden", build_id, *include, *sources, "-o", str(library), "-lm"]
    library.unlink()
    subprocess.run(command, check=True, timeout=300)


@pytest.fixture(scope="module")
def with_message(tmp_path_factory):
    tree = copy_tree(tmp_path_factory.mktemp("message"), "host/phaselead", "firmware", "protocol", "docs/wire.md")
    steps = follow("adding-a-message.md", tree)
    assert steps == ["protocol/schema.toml", "firmware/app/commands_echo.c"]
    wrote = tree.run("protocol/generate.py").stdout
    assert wrote == "".join(f"wrote {name}\n" for name in GENERATED)
    return tree


def test_an_added_message_is_generated_everywhere(with_message):
    assert "struct wire_echo_request {\n    uint32_t word;\n};" in with_message.text("firmware/app/wire.h")
    assert "### echo\n\nSends a word back; while parked.\n" in with_message.text("docs/wire.md")
    frames = json.loads(with_message.text("protocol/golden.json"))["frames"]
    assert {frame["message"] for frame in frames} >= {"echo_request", "echo_reply"}
    assert with_message.run("protocol/generate.py", "--check").stdout == ""


def test_an_added_message_leaves_the_fingerprint_and_raises_the_revision(with_message):
    said = with_message.run("-c", "from phaselead.device import wire; print(wire.FINGERPRINT, wire.REVISION)").stdout
    assert said.split() == [str(wire.FINGERPRINT), str(wire.REVISION + 1)]


def test_a_device_without_an_added_message_does_all_else_for_its_host(with_message):
    assert "wire  " in with_message.run("-m", "phaselead", "info").stdout
    code = (
        "from phaselead.device import wire, Device\nDevice.open('sim://xyz250').session.request(wire.EchoRequest(7))\n"
    )
    refused = with_message.run("-c", code, check=False)
    assert "echo refused (unknown_command): its firmware is older than this command; flash" in refused.stderr


def test_a_host_without_an_added_message_does_not_take_it():
    assert 0x16 not in wire.MESSAGES
    assert 0x96 not in wire.MESSAGES


def test_an_added_message_is_answered(with_message):
    compile_firmware(with_message)
    said = with_message.run(str(ROOT / "tests/docs/use_echo.py")).stdout.splitlines()
    assert said == [
        "echo refused (bad_value): 0 is what an empty reply holds; send another word",
        "echo refused (wrong_state): not in this state; `phaselead status` shows it, `phaselead park` ends it",
    ]


@pytest.fixture(scope="module")
def with_board(tmp_path_factory):
    """The board, built as `make firmware` does."""
    if shutil.which("arm-none-eabi-gcc") is None:
        pytest.skip("no gcc-arm-none-eabi")
    pio = Path(sys.executable).with_name("pio")
    if not pio.exists():
        pytest.skip("no PlatformIO here; run `make firmware`")
    tree = copy_tree(tmp_path_factory.mktemp("board"), "host/phaselead", "firmware", "platformio.ini")
    steps = follow("adding-a-board.md", tree)
    assert steps == ["firmware/port/stm32f4/boards/crystal_f446.h", "platformio.ini"]
    core = tree.root / ".pio-core"
    tree.run("firmware/port/stm32f4/offline/prepare.py", str(core))
    subprocess.run(
        [pio, "run", "-s", "-d", tree.root, "-e", "crystal_f446"],
        env=os.environ | {"PLATFORMIO_CORE_DIR": str(core)},
        check=True,
        timeout=600,
    )
    return tree


def test_an_added_board_compiles(with_board):
    elf = (with_board.root / ".pio/build/crystal_f446/firmware.elf").read_bytes()
    assert b"crystal_f446\0" in elf
    assert b"chip=F446,usart=1\0" in elf
    binary = (with_board.root / ".pio/build/crystal_f446/firmware.bin").read_bytes()
    assert b"chip=" not in binary
    assert "[nucleo_f446re|generic_f405|crystal_f446]" in with_board.run("-m", "phaselead", "flash", "--help").stdout


def test_an_added_board_runs_in_the_emulator(with_board):
    try:
        check_qemu()
    except BadInput as error:
        pytest.skip(str(error))
    said = with_board.run("-m", "phaselead", "info", "--port", "qemu://crystal_f446", "--json", "-").stdout
    assert json.loads(said)["target"] == "crystal_f446"
