"""Firmware over the wire, as the board does it: bootloader, both images, and the power cut at a sample of the steps.

tests/app/test_update_cut.py cuts at all of them, in the same code built for this process.
"""

import json
import struct
from pathlib import Path
from zlib import crc32

import pytest
from click.testing import CliRunner
from talker import Talker, stage_model, upload

from phaselead.cli import main
from phaselead.device import wire
from phaselead.device.update import HEADER, parse_images, read_images
from phaselead.sim.emulated import Injection, find_firmware

BOARD, PORT = "nucleo_f446re", "qemu://nucleo_f446re"
OLD_SLOT, NEW_SLOT = 0x0802_0000, 0x0804_0000
ZERO_V = 32768
ERASED, ENTRY, CHUNK = 128 * 1024, 16, 1024
STARTED = 72
"""What the journal takes for a start."""
ERASE_TICKS, TRIAL_TICKS = 20_000, 50_000
UNDEFINED = struct.pack("<H", 0xDEFF)


def built():
    return read_images(find_firmware(BOARD).with_name("update.bin"))


def with_crc(content):
    return content[:4] + struct.pack("<I", crc32(content[8:])) + content[8:]


def renamed(image, digit):
    """The same firmware under another build id."""
    other = f"{digit:x}" * 40
    content = image.content.replace(image.build_id.encode(), other.encode())
    assert content != image.content
    return with_crc(content[:44] + bytes.fromhex(other) + content[64:])


def new_image(digit=5, address=NEW_SLOT):
    return next(renamed(image, digit) for image in built() if image.address == address)


def image_that_faults():
    """An undefined instruction where the tick begins; its CRC holds."""
    content = bytearray(new_image())
    (tick,) = struct.unpack_from("<I", content, 0x200 + 4 * (16 + 28))
    at = (tick & ~1) - NEW_SLOT
    content[at : at + 2] = UNDEFINED
    return with_crc(bytes(content))


def receive(talker, new):
    talker.ok(wire.HelloRequest())
    assert talker.ask(wire.UpdateBeginRequest(new[: HEADER.size]), ERASE_TICKS) == wire.Status.OK
    for at in range(HEADER.size, len(new), CHUNK):
        assert talker.ask(wire.UpdateChunkRequest(at, new[at : at + CHUNK])) == wire.Status.OK
    assert talker.ask(wire.UpdateCommitRequest(), ERASE_TICKS) == wire.Status.OK


def restart(talker, ticks=400):
    assert talker.ask(wire.UpdateRestartRequest()) == wire.Status.OK
    talker.run(ticks)


def build(talker):
    return talker.ok(wire.HelloRequest()).build_id.hex()


@pytest.fixture(scope="module")
def old():
    return built()[0].build_id


def test_an_update_over_the_line_is_tried_confirmed_and_kept(tmp_path, old):
    port, update = f"{PORT}?state={tmp_path / 'flash.bin'}", tmp_path / "update.bin"
    update.write_bytes(b"".join(renamed(image, 5) for image in built()))
    done = CliRunner().invoke(main, ["flash", "--wire", "--image", str(update), "--port", port, "--json", "-"])
    assert done.exit_code == 0, done.output
    said = json.loads(done.stdout)
    assert (said["build_id"], said["replaced"], said["slot"], said["runs_it"]) == ("5" * 40, old, "B", True)
    done = CliRunner().invoke(main, ["info", "--port", port, "--json", "-"])
    assert json.loads(done.stdout)["build_id"] == "5" * 40
    done = CliRunner().invoke(main, ["flash", "--wire", "--image", str(update), "--port", port, "--json", "-"])
    assert json.loads(done.stdout)["replaced"] == "5" * 40


def test_the_outputs_are_at_zero_and_the_model_is_kept(start, old):
    board = start(delays=False)
    talker = Talker(board)
    talker.ok(wire.HelloRequest(), *upload(stage_model()))
    assert talker.ask(wire.ModelPersistRequest(), ERASE_TICKS).status == wire.Status.OK
    crc = talker.ok(wire.HelloRequest()).model_crc
    receive(talker, new_image())
    assert build(talker) == old
    restart(talker)
    hello = talker.ok(wire.HelloRequest())
    assert (hello.build_id.hex(), hello.reset_cause) == ("5" * 40, wire.ResetCause.SOFTWARE)
    assert (hello.model_crc, hello.state) == (crc, wire.State.PARKED)
    info = talker.ok(wire.UpdateInfoRequest())
    assert (info.slot, info.standing, info.free_address) == (1, wire.UpdateStanding.TRIAL, OLD_SLOT)
    assert talker.ask(wire.ArmRequest(0)) == wire.Status.BUSY
    talker.ok(wire.UpdateConfirmRequest(hello.build_id))
    assert (board.codes()[1] == ZERO_V).all()
    talker.drive()
    assert talker.state == wire.State.RUNNING
    for command in (wire.UpdateBeginRequest(new_image(6, OLD_SLOT)[: HEADER.size]), wire.UpdateRestartRequest()):
        assert talker.ask(command) == wire.Status.WRONG_STATE


def test_an_image_that_faults_is_given_up(start, old):
    board = start(delays=False)
    talker = Talker(board)
    receive(talker, image_that_faults())
    restart(talker, 1000)
    hello = talker.ok(wire.HelloRequest())
    assert hello.build_id.hex() == old
    assert talker.ok(wire.UpdateInfoRequest()).standing == wire.UpdateStanding.ROLLED_BACK
    assert (board.codes()[1] == ZERO_V).all()
    flash, _ = board.flash()
    assert flash[: 8 * ENTRY].count(b"BL") == 6  # two of a debugger's, the trial and its three starts


def test_an_image_to_which_nobody_speaks_starts_again_and_is_given_up(start, old):
    board = start(delays=False)
    talker = Talker(board)
    receive(talker, new_image())
    flash, _ = board.flash()
    once_more = start(flash=flash, delays=False)
    talker = Talker(once_more)
    assert build(talker) == "5" * 40
    talker.run(TRIAL_TICKS)
    flash, _ = once_more.flash()
    assert flash[: 8 * ENTRY].count(b"BL") == 5  # its second start: the third is the last
    last = Talker(start(flash=flash, delays=False))
    assert build(last) == "5" * 40
    assert build(Talker(start(flash=last.device.flash()[0], delays=False))) == old


def steps(size):
    """Bytes of flash after which the power goes, and what it goes in."""
    commit = ERASED + size - HEADER.size
    trial = commit + HEADER.size
    return {
        "erase": ERASED // 2,
        "body": ERASED + size // 2,
        "header": commit + 5,
        "trial": trial + 9,
        "start": trial + ENTRY + 7,
        "confirmation": trial + 2 * ENTRY + STARTED + 4,
        "confirmed": trial + 3 * ENTRY + STARTED + 1,
    }


@pytest.mark.parametrize("where", steps(0))
def test_the_power_cut_leaves_the_old_or_the_new_image(start, old, where):
    new = new_image()
    board = start(delays=False)
    talker = Talker(board)
    talker.ok(wire.HelloRequest())
    board.inject(Injection.FLASH_CUT, steps(len(new))[where])
    commands = [wire.UpdateBeginRequest(new[: HEADER.size])]
    commands += [wire.UpdateChunkRequest(at, new[at : at + CHUNK]) for at in range(HEADER.size, len(new), CHUNK)]
    commands += [wire.UpdateCommitRequest(), wire.UpdateRestartRequest()]
    for command in commands:
        if not acknowledged(talker, command):
            break
    else:
        talker.run(400)
        talker.ask(wire.HelloRequest())
        acknowledged(talker, wire.UpdateConfirmRequest(bytes.fromhex("5" * 40)))
    talker.run(400)
    assert (board.codes()[1] == ZERO_V).all()
    # Flash that lost its power takes no more bytes here: another board goes on with what is in it.
    again = Talker(start(flash=board.flash()[0], delays=False))
    runs = build(again)
    assert runs in (old, "5" * 40)
    if where in ("erase", "body", "header", "trial"):
        assert runs == old
    else:
        assert runs == "5" * 40
    confirmed = again.ok(wire.UpdateInfoRequest()).standing == wire.UpdateStanding.CONFIRMED
    assert confirmed == (where not in ("start", "confirmation"))
    if where in ("body", "confirmed"):
        receive(again, new_image(6, NEW_SLOT if runs == old else OLD_SLOT))
        restart(again)
        assert build(again) == "6" * 40


def acknowledged(talker, command):
    """False when the power went meanwhile."""
    try:
        return talker.ask(command, ERASE_TICKS // 2) == wire.Status.OK
    except KeyError:
        return False


def test_the_file_for_an_update_holds_an_image_for_each_slot():
    images = built()
    assert [image.address for image in images] == [OLD_SLOT, NEW_SLOT]
    assert {image.target for image in images} == {BOARD}
    assert len({image.build_id for image in images}) == 1
    content = Path(find_firmware(BOARD)).read_bytes()
    assert images[0].content[:64] in content  # what a debugger writes has its CRC too
    assert parse_images(images[1].content, "one") == images[1:]
