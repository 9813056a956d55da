"""The command line on the emulated board: every command that talks to a device takes qemu:// as it takes sim://."""

import json
import signal

import pytest
from click.testing import CliRunner

from phaselead import interrupt
from phaselead.cli import main
from phaselead.device.loop_test import loop_result
from phaselead.errors import BadInput, PhaseleadError
from phaselead.model.stage_file import save_stage
from phaselead.sim import emulated
from phaselead.sim.plant import built_in
from phaselead.sim.protocol_qemu import parse_url

URL = "qemu://nucleo_f446re"


def run(*words):
    result = CliRunner().invoke(main, [str(word) for word in words])
    return result.exit_code, result.output


@pytest.fixture
def model(tmp_path):
    path = tmp_path / "stage.toml"
    save_stage(path, built_in("xyz250"))
    return path


@pytest.fixture
def wire_stage(tmp_path):
    """A wire from each DAC output to its ADC input, +-10 V over the ADC's codes."""
    stage = built_in("xyz250")
    axes = {}
    for name, axis in stage.axes.items():
        time = axis.time.model_copy(
            update={
                "gain_um_per_V": 14.0,
                "offset_um": 0.0,
                "play_r_V": (),
                "play_w_um_per_V": (),
                "deadzone_d_V": (),
                "deadzone_s_um_per_V": (),
            }
        )
        sensor = axis.sensor.model_copy(update={"x_min_um": -140.0, "x_max_um": 140.0})
        axes[name] = axis.model_copy(update={"time": time, "sensor": sensor, "effects": []})
    path = tmp_path / "wire.toml"
    save_stage(path, stage.model_copy(update={"axes": axes, "cross_coupling": None}))
    return path


def test_a_run_tracked_on_the_board_replays_in_this_process(model, tmp_path):
    run_file = tmp_path / "run.h5"
    code, output = run(
        *("track", "sine:40um@10Hz", "--port", URL, "--model", model, "--mode", "pid"),
        *("--duration", "0.6", "-o", run_file, "--json", "-"),
    )
    assert code == 0, output
    code, output = run("replay", run_file, "--json", "-")
    assert code == 0, output
    assert run("log", "info", run_file)[0] == 0


def test_flash_is_kept_and_the_board_says_what_it_is(model, tmp_path):
    url = f"{URL}?state={tmp_path / 'flash.bin'}"
    code, output = run("upload", model, "--port", url, "--persist")
    assert code == 0, output
    code, output = run("info", "--port", url, "--json", "-")
    figures = json.loads(output)
    assert figures["target"] == "nucleo_f446re"
    assert figures["model_persisted"]
    assert figures["cycles_max"] > 0


def test_the_board_is_known_to_run_this_source():
    code, output = run("flash", "--check-only", "--env", "nucleo_f446re", "--port", URL)
    assert code == 0, output
    code, output = run("flash", "--check-only", "--env", "generic_f405", "--port", URL)
    assert (code, "is a nucleo_f446re" in output) == (1, True)


def test_a_looped_board_passes_its_self_test_and_a_stage_does_not(wire_stage):
    code, output = run("selftest", "--port", f"{URL}?stage={wire_stage}", "--axis", "x", "--yes", "--json", "-")
    assert code == 0, output
    assert json.loads(output)["axes"]["x"]["passed"]
    code, output = run("selftest", "--port", URL, "--axis", "x", "--yes")
    assert code == 1


def test_a_loop_is_judged_by_gain_offset_and_misfit():
    dac = [32768, 40000, 50000, 60000]
    volts = [(code - 32768) * 20.48 / 65536 for code in dac]

    def seen(gain=1.0, offset_V=0.0, bend=0.0):
        return [32768 + (gain * v + offset_V + bend * v * v) * 65536 / 20 for v in volts]

    assert loop_result("x", dac, seen(), 1).passed
    assert not loop_result("x", dac, seen(gain=1.02), 1).passed
    assert not loop_result("x", dac, seen(offset_V=0.05), 1).passed
    assert not loop_result("x", dac, seen(bend=0.002), 1).passed
    assert not loop_result("x", dac, seen(), 9).passed


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("qemu://", "names no emulated board"),
        ("qemu://nucleo_f103", "names no emulated board"),
        ("qemu://generic_f405?seed=x", "seed must be a whole number"),
        ("qemu://generic_f405?colour=red", "is no option"),
    ],
)
def test_what_is_wrong_with_a_url_is_said(url, words):
    with pytest.raises(BadInput, match=words):
        parse_url(url)


def test_another_emulator_is_refused_in_words(tmp_path, monkeypatch):
    fake = tmp_path / emulated.QEMU
    fake.write_text("#!/bin/sh\necho QEMU emulator version 9.1.0\n")
    fake.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(BadInput, match=r"9\.1; the emulated board is made for 7\.2"):
        emulated.check_qemu()
    monkeypatch.setenv("PATH", "")
    with pytest.raises(BadInput, match="not installed"):
        emulated.check_qemu()


def test_an_exchange_that_was_cut_short_ends_the_board(start, monkeypatch):
    board = start()
    monkeypatch.setattr(board, "_read", lambda size: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        board.run(1)
    with pytest.raises(PhaseleadError, match="switched off"):
        board.run(1)


@pytest.fixture
def plain_interrupts():
    """Whatever a command of an earlier test has installed, and no mark left behind."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
    interrupt.clear()


@pytest.mark.usefixtures("plain_interrupts")
def test_an_interrupt_waits_for_the_exchange_and_the_board_goes_on(start, monkeypatch):
    board = start()
    read = board._read
    monkeypatch.setattr(board, "_read", lambda size: (signal.raise_signal(signal.SIGINT), read(size))[1])
    with pytest.raises(KeyboardInterrupt):
        board.time()  # two reads: a second interrupt is not held
    monkeypatch.undo()
    with pytest.raises(PhaseleadError, match="switched off"):
        board.run(1)
    board = start()
    exchange = board._exchange
    monkeypatch.setattr(board, "_exchange", lambda *ask: (signal.raise_signal(signal.SIGINT), exchange(*ask))[1])
    with pytest.raises(KeyboardInterrupt):
        board.run(1)
    monkeypatch.undo()
    before = board.time()[1]
    assert board.run(3) == 3
    assert board.time()[1] == before + 3


def test_firmware_that_is_missing_is_asked_for(tmp_path):
    code, output = run("info", "--port", f"{URL}?elf={tmp_path / 'none.elf'}")
    assert (code, "there is no such firmware" in output) == (2, True)
