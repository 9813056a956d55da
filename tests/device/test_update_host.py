"""The host's side of an update: the file, the choice of the image, and what is said when it cannot be."""

import json
import struct
from dataclasses import replace
from zlib import crc32

import pytest
from click.testing import CliRunner

from phaselead.cli import main
from phaselead.device import update as update_module
from phaselead.device.session import Greeting
from phaselead.device.update import HEADER, Image, fitting, parse_images, update
from phaselead.errors import BadInput, LinkError, PhaseleadError

SLOTS = (0x0802_0000, 0x0804_0000)
SIZE, SLOT_SIZE, OWN, RECORD = 700, 2048, 4 * 4096, 16384
OLD, NEW = "11" * 20, "22" * 20


def image(build_id, slot, target=b"host", magic=0x3149_4C50):
    body = bytes(i * 31 & 0xFF for i in range(SIZE - HEADER.size))
    head = HEADER.pack(magic, 0, SIZE, SLOTS[slot], 1 << 16 | 2 << 8 | 3, target, bytes.fromhex(build_id))
    return head[:4] + struct.pack("<I", crc32(head[8:] + body)) + head[8:] + body


def both(build_id, **how):
    return image(build_id, 0, **how) + image(build_id, 1, **how)


@pytest.fixture
def port(tmp_path):
    """A simulated device with an image in slot A."""
    cells = b"\xff" * OWN + image(OLD, 0).ljust(SLOT_SIZE, b"\xff") + b"\xff" * (SLOT_SIZE + RECORD)
    (tmp_path / "cells").write_bytes(cells + bytes(len(cells)) + struct.pack("<I", 1))
    return f"sim://xyz250?state={tmp_path / 'cells'}"


def run(*arguments):
    done = CliRunner().invoke(main, ["flash", *map(str, arguments)])
    return done.exit_code, done.output


def test_an_update_file_holds_images_one_after_the_other():
    one, other = parse_images(both(NEW), "file")
    assert (one.address, other.address) == SLOTS
    assert (one.version, one.target, one.build_id, len(one.content)) == ((1, 2, 3), "host", NEW, SIZE)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is empty"),
        (b"x" * 63, "middle of a header"),
        (b"x" * 64, "no firmware image"),
        (both(NEW)[:-1], "damaged"),
        (both(NEW)[:-SIZE] + b"\0" + both(NEW)[1 - SIZE :], "no firmware image"),
        (both(NEW)[: SIZE - 1] + b"\0" + both(NEW)[SIZE:], "damaged"),
        (HEADER.pack(0x3149_4C50, 0, 0, 0, 0, b"", b""), "damaged"),
    ],
)
def test_a_file_that_is_no_update_is_refused_before_the_port_is_opened(tmp_path, content, said):
    file = tmp_path / "update.bin"
    file.write_bytes(content)
    code, output = run("--wire", "--image", file, "--port", "/dev/no-such-port")
    assert (code, said in output, output.count("\n")) == (2, True, 1)


def test_the_image_for_the_free_slot_is_taken():
    images = parse_images(both(NEW), "file")
    assert fitting(images, "host", SLOTS[1]) is images[1]
    with pytest.raises(BadInput, match="for a host, the device is a nucleo_f446re"):
        fitting(images, "nucleo_f446re", SLOTS[1])
    with pytest.raises(BadInput, match=r"give the whole update\.bin"):
        fitting(images[:1], "host", SLOTS[1])


def test_the_command_sends_tries_and_confirms(port, tmp_path):
    file = tmp_path / "update.bin"
    file.write_bytes(both(NEW))
    code, output = run("--wire", "--image", file, "--port", port, "--json", "-")
    assert code == 0, output
    said = json.loads(output)
    assert said == {"board": "host", "build_id": NEW, "replaced": OLD, "version": "1.2.3", "slot": "B", "runs_it": True}


def test_a_build_that_runs_already_is_not_sent_again(port, monkeypatch):
    monkeypatch.setattr(update_module, "send", None)
    facts = update(port, parse_images(both(OLD), "file"))
    assert (facts["replaced"], facts["slot"]) == (OLD, "A")


def test_the_share_that_was_sent_is_told(port):
    shares = []
    update(port, parse_images(both(NEW), "file"), shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1


def test_an_image_that_did_not_start_is_said(port, monkeypatch):
    back = update_module._back
    monkeypatch.setattr(update_module, "_back", lambda old: (back(old)[0], Greeting(0, OLD, "host")))
    with pytest.raises(PhaseleadError, match="is back at build 111111111111, nothing is lost"):
        update(port, parse_images(both(NEW), "file"))


def test_a_device_of_another_version_is_updated(port, monkeypatch):
    monkeypatch.setattr("phaselead.device.wire.FINGERPRINT", 1)
    assert update(port, parse_images(both(NEW), "file"))["build_id"] == NEW


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--wire", "--check-only"), "leave --wire out"),
        (("--image", "update.bin"), "add --wire"),
        (("--wire", "--image", "none.bin"), "none.bin: cannot be read"),
        (("--wire", "--port", "sim://xyz250"), "there is no board host"),
    ],
)
def test_what_does_not_go_together_is_one_line(arguments, said):
    code, output = run(*arguments)
    assert (code, said in output, output.count("\n")) == (2, True, 1)


def test_a_device_that_does_not_come_back_is_a_link_error(port, monkeypatch):
    class Gone(update_module.Session):
        greeted = 0

        def greet(self):
            Gone.greeted += 1
            if Gone.greeted > 1:
                raise LinkError("nothing answers")
            return super().greet()

    monkeypatch.setattr(update_module, "Session", Gone)
    with pytest.raises(LinkError):
        update(port, parse_images(both(NEW), "file"))
    assert Gone.greeted == 1 + update_module.BACK_TRIES


def test_an_image_with_a_wrong_crc_is_refused_by_the_device_too(port):
    images = [replace(one, content=one.content[:-1] + b"\0") for one in parse_images(both(NEW), "file")]
    with pytest.raises(PhaseleadError, match="arrived damaged"):
        update(port, images)
    assert isinstance(images[0], Image)
