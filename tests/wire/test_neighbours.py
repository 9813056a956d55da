"""Hosts and devices of neighbouring revisions: two schemas, generated and compiled, put before each other both ways."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from phaselead.device import wire
from phaselead.device.device import Device
from phaselead.sim import protocol_sim
from phaselead.sim.device import VirtualDevice, load_library
from phaselead.sim.plant import load_any, plant_parameters

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "protocol"), str(ROOT / "tests/docs")]

from worked_example import Tree, copy_tree  # noqa: E402

from layout import Schema, SchemaError, load  # noqa: E402

ADDED = {
    # A field of a request, of a reply and of an event; a value of an enumeration; and a command.
    'request = [{ name = "ticks", type = "u32" }]': 'request = [{ name = "ticks", type = "u32" }, '
    '{ name = "grace", type = "u16", since = 1 }]',
    'wait for one" },\n]\n\n[[commands]]\nname = "arm"': 'wait for one" },\n'
    '  { name = "uptime_s", type = "u32", since = 6 },\n]\n\n[[commands]]\nname = "arm"',
    'mask of the axes whose paths it begins" },\n]': 'mask of the axes whose paths it begins" },\n'
    '  { name = "severity", type = "u8", since = 6 },\n]',
    "path_done = 3, trigger = 4 }\nsince = { trigger = 4 }": "path_done = 3, trigger = 4, warmed_up = 5 }\n"
    "since = { trigger = 4, warmed_up = 6 }",
}
COMMAND = """
[[commands]]
name = "echo"
number = 0x60
since = 6
doc = "Sends a word back"
request = [{ name = "word", type = "u32" }]
reply = [{ name = "word", type = "u32" }]
"""
AHEAD = 6
HANDLER = """
#include "app/command.h"
enum wire_status command_echo(struct device *device, const struct request *request, struct answer *answer)
{
    struct wire_echo_request asked;
    (void)device;
    wire_unpack_echo_request(&asked, request->payload, request->size);
    struct wire_echo_reply reply = {.word = asked.word};
    wire_pack_echo_reply(&reply, answer->payload, answer->size);
    return WIRE_STATUS_OK;
}
"""


def newer_text() -> str:
    text = (ROOT / "protocol/schema.toml").read_text()
    for old, new in ADDED.items():
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text + COMMAND


@pytest.fixture(scope="module")
def newer(tmp_path_factory: pytest.TempPathFactory) -> Tree:
    """A source tree revisions ahead, its firmware compiled beside that of today."""
    tree = copy_tree(tmp_path_factory.mktemp("newer"), "host/phaselead", "firmware", "protocol", "docs/wire.md")
    (tree.root / "protocol/schema.toml").write_text(newer_text())
    tree.run("protocol/generate.py")
    (tree.root / "firmware/app/commands_echo.c").write_text(HANDLER)
    state = tree.root / "firmware/app/commands_state.c"
    told = ".rx_errors = device->line.rx_errors,"
    assert state.read_text().count(told) == 1
    state.write_text(state.read_text().replace(told, f"{told} .uptime_s = 77,"))
    folders = ("firmware/core", "firmware/app", "firmware/port/host", "host/phaselead/sim/kernel")
    sources = [str(path) for folder in folders for path in sorted((tree.root / folder).glob("*.c"))]
    include = [f"-I{tree.root}/firmware", f"-I{tree.root}/host/phaselead/sim/kernel"]
    flags = ["-std=c11", "-O1", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off", "-fno-strict-aliasing"]
    build_id = f'-DPHASELEAD_BUILD_ID="{"1" * 40}"'
    out = ["-o", str(tree.root / "newer.so"), "-lm"]
    command = ["cc", *flags, "-shared", "-fPIC", "-fvisibility=hidden", build_id, *include, *sources, *out]
    subprocess.run(command, check=True, timeout=300)
    return tree


@pytest.fixture
def newer_device(newer: Tree, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every sim:// port of this process leads to a device revisions ahead."""
    library = load_library(str(newer.root / "newer.so"))
    parameters = plant_parameters(load_any("xyz250"), 0)
    monkeypatch.setattr(protocol_sim, "open_device", lambda parsed: VirtualDevice(parameters, library=library))


def test_a_revision_has_the_fingerprint_of_its_version(tmp_path: Path) -> None:
    (tmp_path / "schema.toml").write_text(newer_text())
    ahead, today = load(tmp_path / "schema.toml"), load(ROOT / "protocol/schema.toml")
    assert (ahead.fingerprint, ahead.version, ahead.revision) == (today.fingerprint, today.version, AHEAD)


USE = """
import json
from phaselead.device import Device, wire
from phaselead.device.session import Refused
told = {"ours": wire.REVISION}
with Device.open("sim://xyz250") as device:
    told["theirs"] = device.hello.wire_revision
    reply = device.session.request(wire.StatusRequest())
    told["uptime_s"] = reply.uptime_s
    device.session.request(wire.SetTimeoutRequest(5000, 0))
    for name, request in (("grace", wire.SetTimeoutRequest(5000, 9)), ("echo", wire.EchoRequest(5))):
        try:
            told[name] = type(device.session.request(request)).__name__
        except Refused as refusal:
            told[name] = str(refusal)
    device.set_axis("x", "open")
    device.set_path("x", "sine", swing=2.0, f_Hz=10.0)
    capture = device.capture(500)
    told["ticks"] = len(capture.ticks)
    told["severities"] = sorted({event.severity for event in capture.events})
    told["state"] = device.status().state
print(json.dumps(told))
"""


def told_by(tree: Tree) -> dict[str, Any]:
    said: dict[str, Any] = json.loads(tree.run("-c", USE).stdout)
    return said


def test_a_newer_host_and_a_device_of_today(newer: Tree) -> None:
    """What the device does not know is zero, and what it cannot do is refused with what to update."""
    told = told_by(newer)
    assert (told["ours"], told["theirs"]) == (AHEAD, wire.REVISION)
    assert (told["uptime_s"], told["severities"]) == (0, [0])
    assert told["grace"].startswith("set_timeout refused (bad_length): its firmware is older than a part of this")
    assert told["echo"].startswith("echo refused (unknown_command): its firmware is older than this command; flash")
    assert told["ticks"] >= 500
    assert told["state"] == "parked"


@pytest.mark.usefixtures("newer_device")
def test_a_host_of_today_and_a_newer_device() -> None:
    """What the host does not know it leaves out."""
    with Device.open("sim://xyz250") as device:
        assert device.hello.build_id == b"\x11" * 20
        assert (device.hello.wire_version, device.hello.wire_revision) == (wire.VERSION, AHEAD)
        assert device.status().state == "parked"
        device.set_timeout(5000)
        device.set_axis("x", "open")
        device.set_path("x", "sine", swing=2.0, f_Hz=10.0)
        capture = device.capture(500)
        assert len(capture.ticks) >= 500
        assert {event.kind for event in capture.events} >= {wire.EventKind.STATE_CHANGE}
        assert device.info()["wire"] == f"{wire.VERSION}.{AHEAD}"


def test_a_newer_host_and_a_newer_device(newer: Tree) -> None:
    (library,) = newer.root.glob("host/phaselead/sim/_firmware*.so")
    today = library.read_bytes()
    try:
        library.unlink()
        library.write_bytes((newer.root / "newer.so").read_bytes())
        told = told_by(newer)
    finally:
        library.write_bytes(today)
    assert (told["theirs"], told["uptime_s"], told["grace"], told["echo"]) == (
        AHEAD,
        77,
        "SetTimeoutReply",
        "EchoReply",
    )


@pytest.mark.parametrize(
    ("old", "words"),
    [
        (
            '{ name = "offset", type = "i32", doc = "lowest value of the path; for a hold or a move: where it starts"',
            "end",
        ),
        ('{ name = "error_ticks", type = "u32"', "cannot be added"),
        ('{ name = "region", type = "u8", enum = "region"', "stand at the end"),
        ('{ name = "data", type = "bytes", doc = "i32 points"', "cannot be added"),
    ],
)
def test_an_addition_in_a_wrong_place_is_refused(tmp_path: Path, old: str, words: str) -> None:
    text = (ROOT / "protocol/schema.toml").read_text()
    assert text.count(old) == 1
    (tmp_path / "schema.toml").write_text(text.replace(old, f"{old}, since = 1"))
    with pytest.raises(SchemaError, match=words):
        load(tmp_path / "schema.toml")


def test_the_schema_of_today_is_whole() -> None:
    schema: Schema = load(ROOT / "protocol/schema.toml")
    assert (schema.version, schema.revision) == (wire.VERSION, wire.REVISION)
