"""Commands of every kind over a line that goes wrong, counted where they are carried out: in the device.

python tests/sim/link_trial.py --each 10000          prints a table; exit status 1 when a promise is broken
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from random import Random
from typing import Any, cast
from zlib import crc32

from phaselead.device import device_model, wire
from phaselead.device.device import Device
from phaselead.device.session import Refused, Session
from phaselead.errors import LinkError
from phaselead.model import AxisModel, Stage
from phaselead.serial_ports import open_port
from phaselead.sim.device import VirtualDevice
from phaselead.sim.faulty import FaultyLine, LineFaults

ISSUE = LineFaults(lose=0.01, flip=1e-4)
"""1 % of the bytes are lost, one bit in 10,000 is wrong, each way."""
WORSE = LineFaults(
    lose=0.01, flip=1e-4, duplicate=0.05, reorder=0.02, delay=0.02, truncate=0.01, unplug=1e-4, reset=1e-4
)
"""And frames that come twice, late or cut, a cable that is pulled and a device that restarts."""
UPLOAD_EVERY = 25
V = 1 << 24
AGAIN = {wire.StopRequest, wire.FaultLogRequest}
"""Are carried out once more for each copy that comes: STOP, and a read whose reply of 318 bytes is too long to be kept.
Of such replies this line lets one in 25 through, so that hosts read the log in pieces, by SNAPSHOT_READ."""
OFTEN_FAIL = {wire.FaultLogRequest, wire.UpdateRestartRequest}
"""Are reported failed more often than others: a reply that is too long, and one that is lost with the session, which a
restart ends."""
FREE = wire.AxisLimits(0, 0xFFFF, 0xFFFFFFFF, 0, 0xFFFF)
KINDS = [cast(type[wire.Command[Any]], kind) for kind in wire.MESSAGES.values() if issubclass(kind, wire.Command)]


@dataclass
class Tally:
    """What became of the commands of one kind."""

    asked: int = 0
    answered: int = 0
    refused: int = 0
    failed: int = 0
    """Reported as not answered, or as lost with the session."""
    done_though_failed: int = 0
    wrong: list[str] = field(default_factory=list)


@dataclass
class Ledger:
    """What one command was told to the caller, by its session and id."""

    kind: type[wire.Command[Any]]
    outcome: str
    restarts: int
    """Of the device before it was asked: after each a copy of a hello may be carried out once more."""


class Trial:
    """A session over a line that goes wrong, with the device's own account of what it carried out."""

    def __init__(self, faults: LineFaults) -> None:
        self.line = FaultyLine(open_port(f"sim://xyz250?seed={faults.seed}"), faults)
        self.firmware = cast(VirtualDevice, self.line.port.device)  # type: ignore[attr-defined]
        self.session = Session(self.line, "trial")
        self.random = Random(f"{faults.seed}/trial")
        self.tally = {kind: Tally() for kind in KINDS}
        self.uploads = Counter[str]()
        self.ledger: dict[tuple[int, int], Ledger] = {}
        self.done = Counter[tuple[int, int]]()
        self.restarts = self._tick = 0

    def ask(self, command: wire.Command[Any]) -> Any:
        """The reply, or None when there was none or it was a refusal."""
        outcome, reply, restarts = "failed", None, self.restarts
        try:
            reply = self.session.renew() if isinstance(command, wire.HelloRequest) else self.session.request(command)
            outcome = "answered"
        except Refused:
            outcome = "refused"
        except LinkError:
            self.line.plug_in()
        self._note(type(command), outcome, restarts)
        return reply

    def _note(self, kind: type[wire.Command[Any]], outcome: str, restarts: int) -> None:
        tally = self.tally[kind]
        tally.asked += 1
        setattr(tally, outcome, getattr(tally, outcome) + 1)
        self.ledger[self.session.nonce, self.session.last_id] = Ledger(kind, outcome, restarts)
        self.count()

    def count(self) -> None:
        """Takes over what the device has carried out since, and whether it has restarted: ticks begin at 0."""
        self.restarts += self.firmware.tick < self._tick
        self._tick = self.firmware.tick
        self.done.update((one.session, one.id) for one in self.firmware.take_obeyed())

    def settle(self) -> None:
        """Lets everything that is still on the way arrive, and compares both accounts."""
        self.session.pump(1000)
        self.count()
        for place, entry in self.ledger.items():
            times, tally = self.done[place], self.tally[entry.kind]
            copies = self.restarts - entry.restarts if entry.kind is wire.HelloRequest else 0
            least, most = (entry.outcome == "answered"), 1 + copies
            if times < least or (times > most and entry.kind not in AGAIN):
                tally.wrong.append(f"{entry.kind.NAME} {place}: {entry.outcome}, carried out {times} times")
            tally.done_though_failed += entry.outcome == "failed" and times > 0
        self.ledger.clear()
        self.done.clear()

    def upload(self, name: str) -> None:
        """A whole model, read back by ``Device.upload`` and named by STATUS."""
        blob = device_model(Stage(name=name, axes={"x": AxisModel(), "y": AxisModel()}))
        device = Device.__new__(Device)
        device.session, device._modes, device._waves = self.session, {}, set()
        try:
            device.upload(blob)
        except (Refused, LinkError):
            self.line.plug_in()
            self.uploads["reported failed"] += 1
            return
        self.uploads["right"] += 1
        active = self.active_model()
        if active != blob:
            self.uploads["WRONG"] += 1

    def active_model(self) -> bytes:
        """What the device holds, over a line of its own that does nothing wrong."""
        session = Session(self.line.port, "clean", nonce=self.session.nonce)
        session.last_id = self.session.last_id = self.session.last_id + 10
        blob = b""
        while len(blob) < wire.Model.SIZE:
            blob += session.request(wire.ModelReadRequest(len(blob), 1024)).data
        self.session.last_id = session.last_id
        self.firmware.take_obeyed()
        return blob


def commands(random: Random) -> Iterator[wire.Command[Any]]:
    """One of every kind, in an order in which most of them can be carried out."""
    data = b"".join(random.randint(0, 1 << 30).to_bytes(4, "little") for _ in range(random.randint(1, 8)))
    yield wire.HelloRequest()
    yield wire.SetTimeoutRequest(random.randint(5000, 6000))
    yield wire.LimitsSetRequest((FREE,) * 3)
    yield wire.LimitsReadRequest()
    yield wire.ModelBeginRequest(wire.Model.SIZE, 0)
    yield wire.ModelChunkRequest(4 * random.randint(0, 600), data)
    yield wire.ModelCommitRequest()
    yield wire.ModelReadRequest(0, random.randint(1, 48))
    yield wire.ModelPersistRequest()
    yield wire.WaveChunkRequest(0, random.randint(0, 900), data)
    yield wire.WaveCommitRequest(0, crc32(data))
    yield wire.PointsBeginRequest(0b010, 0, 0, (1 << 30,) * 3)
    yield wire.PointsRequest(0b010, 0, 0, data)
    yield wire.SetAxisRequest(0, wire.Mode.OPEN, 0, 0, 0, 0x7FFFFFFF)
    yield wire.SetPathRequest(0, wire.PathKind.SINE, V, 0, 2**54, 0)
    yield wire.SetJoinsRequest(0, 0, 100, 100)
    yield wire.TriggerSetRequest(random.randint(0, 2), wire.Mark.TIME, 0, 0, random.randint(10, 100), 0)
    yield wire.MotionRequest(0, 0, 0, 0, 1 << 16, 10)
    yield wire.StreamStartRequest(wire.Channel.DAC, 1, 100)
    region = random.choice((wire.Region.STATE, wire.Region.FAULTS))
    yield wire.SnapshotReadRequest(region, 0, random.randint(1, 48))
    yield wire.TransientArmRequest(wire.Trigger.FAULT, 0, wire.Channel.ADC, 0, 0, 1, random.randint(0, 400))
    yield wire.ArmRequest(0)
    yield wire.StartRequest(1)
    hold = wire.Segment(wire.PathKind.HOLD, wire.PathFlag.FROM_HERE, 0, 0, 0, random.randint(1, 100), 100, 0)
    yield wire.QueueRequest(1, 0, 0, (hold,) * 3)
    yield wire.SetGainsRequest(0, random.randint(0, V), 0, 0, 0x7FFFFFFF)
    yield wire.WhereRequest()
    yield wire.StatusRequest()
    yield wire.InfoRequest()
    yield wire.TransientReadRequest(0, 0)
    yield wire.StreamStopRequest()
    yield wire.ParkRequest()
    yield wire.StopRequest()
    yield wire.ClearFaultRequest()
    yield wire.FaultLogRequest()
    yield wire.UpdateInfoRequest()
    yield wire.UpdateBeginRequest(bytes(64))
    yield wire.UpdateChunkRequest(64, data)
    yield wire.UpdateCommitRequest()
    yield wire.UpdateConfirmRequest(bytes(20))
    yield wire.UpdateRestartRequest()


def run(faults: LineFaults, each: int) -> Trial:
    """``each`` commands of every kind; some models among them."""
    trial = Trial(faults)
    for number in range(each):
        for command in commands(trial.random):
            trial.ask(command)
        trial.settle()
        if number % UPLOAD_EVERY == 0:
            while not trial.ask(wire.HelloRequest()) or trial.ask(wire.StatusRequest()) is None:
                pass
            trial.upload(f"model {number}")
            trial.ledger.clear()
            trial.done.clear()
    return trial


def table(trial: Trial) -> str:
    """As docs/link.md prints it."""
    rows = ["command         asked  answered   refused    failed  failed, yet done   counted wrong"]
    for kind, tally in trial.tally.items():
        figures = tally.asked, tally.answered, tally.refused, tally.failed, tally.done_though_failed
        counts = "{:>9}{:>10}{:>10}{:>10}{:>18}".format(*figures)
        rows.append(f"{kind.NAME:12}{counts}{len(tally.wrong):>16}")
    rows.append(f"uploads: {dict(trial.uploads)}; frames sent again: {trial.session.retries}")
    return "\n".join(rows)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--each", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    broken = 0
    for name, faults in (("1 % of bytes lost, 1e-4 of bits wrong", ISSUE), ("and all else", WORSE)):
        trial = run(LineFaults(**(vars(faults) | {"seed": options.seed})), options.each)
        wrong = [line for tally in trial.tally.values() for line in tally.wrong]
        print(f"\n{name}\n{table(trial)}", flush=True)
        print("\n".join(wrong[:20]))
        broken += len(wrong) + trial.uploads["WRONG"]
    return broken > 0


if __name__ == "__main__":
    sys.exit(main())
