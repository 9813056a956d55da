"""A firmware built for a slower line, as for adapters that cannot do 2 Mbaud."""

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from talker import Talker, V

from phaselead.device import wire
from trials import in_trials

ROOT = Path(__file__).parents[2]
PIO, CORE = ROOT / ".venv" / "bin" / "pio", ROOT / ".pio-core"


@pytest.fixture(scope="module", params=[115_200, *in_trials(921_600)])
def built(request, tmp_path_factory):
    """The speed, and the ELF for it."""
    if not PIO.exists() or not CORE.exists():
        pytest.skip("no PlatformIO here; run `make firmware`")
    build = tmp_path_factory.mktemp("slow")
    env = {
        **os.environ,
        "PLATFORMIO_CORE_DIR": str(CORE),
        "PLATFORMIO_BUILD_DIR": str(build),
        "PLATFORMIO_BUILD_FLAGS": f"-DPHASELEAD_BAUD={request.param}u",
    }
    subprocess.run([PIO, "run", "-s", "-e", "nucleo_f446re", "-d", ROOT], env=env, check=True, capture_output=True)
    return request.param, build / "nucleo_f446re" / "firmware.elf"


def test_it_streams_what_its_line_carries_and_refuses_more(built, start):
    baud, elf = built
    talker = Talker(start(elf=elf, baud=baud), pause=100)
    talker.ok(wire.HelloRequest())
    everything = talker.ask(wire.StreamStartRequest(31, 7, 1))
    assert everything.status == wire.Status.BAUD_BUDGET
    talker.ok(wire.StreamStartRequest(31, 7, 20))
    talker.drive(4 * V, 20)
    talker.run(20_000)
    stopped = talker.ok(wire.StreamStopRequest())
    assert stopped.dropped_ticks == 0
    rows = np.frombuffer(b"".join(batch.data for batch in talker.samples), "<i4").reshape(-1, 9)
    assert len(rows) >= 1000
    assert np.ptp(rows[:, 0]) > 3.9 * V
    assert talker.reader.errors == 0


def test_a_host_at_another_speed_is_not_understood(built, start):
    _, elf = built
    talker = Talker(start(elf=elf, baud=2_000_000))
    with pytest.raises(KeyError):
        talker.ask(wire.HelloRequest(), ticks=300)  # no reply
