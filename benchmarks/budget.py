"""What the firmware needs of a board: cycles a tick, stack, RAM, flash. Run with `make budget`.

Cycles are modelled, instruction by instruction, in the emulated board, over the worst tick of all runs: the processor's
cycles, the waits of flash and buses, and the words to the converters. docs/emulation.md states the model and where it
errs. Exit status 1 above a ceiling; more than 10 % above the last figures in docs/emulation.md is a warning. The runs
look for the worst that can be: see there what they make come together.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from zlib import crc32

import numpy as np

from phaselead.control import PAPER_GAINS
from phaselead.device import FrameReader, device_model, encode_frame, wire
from phaselead.model import TableView
from phaselead.sim import Counts, EmulatedDevice, built_in, find_firmware, plant_parameters, worst_stack
from phaselead.sim.emulated import Injection

ROOT = Path(__file__).parents[1]
BOARD = "nucleo_f446re"
PAGE = ROOT / "docs" / "emulation.md"
SESSION = 1
UM, V = 1 << 16, 1 << 24
XU_LI_TABLE_I = TableView(
    swing_V=(0.5, 10),
    f_Hz=(1, 20),
    a_um_per_V=(15.2536, 1.9619, -0.1013),
    b_deg=(1.9238, 0.7477, 0.0456, 0.0047, -0.0466, 0.0003),
    c_um=(-1.7893, 1.1365, 0.3635, -0.0463, -0.0140, -0.0150),
)
CLOCK_Hz = 168_000_000
TICK_CYCLES = CLOCK_Hz // 5000
SAMPLE_TO_LATCH = round((30e-6 - 1.7e-6 - 0.9e-6) * CLOCK_Hz)
"""LDAC comes 30 us after the sample, codes are there 1.7 us before it, and a tick begins 0.9 us after its sample."""
LOCK = round(20e-6 * CLOCK_Hz)
RAM, FLASH = 125 * 1024, 100 * 1024
"""Bytes, below the linker's 128 KiB of each, which fail the build. 127,436 and 101,076 were measured on 24 November
2026: 0.4 and 1.3 % are left."""
CEILINGS = {
    "cycles a tick, one axis, ff+pid, tables, streamed": None,
    "the same with the built-in stage's time view beside the tables": None,
    "cycles a tick, three axes, every place of the model in use": TICK_CYCLES // 2,
    "the same with the built-in stage's model": TICK_CYCLES // 2,
    "cycles from the tick's beginning to the DAC, three axes": SAMPLE_TO_LATCH,
    "cycles with interrupts locked": LOCK,
    "instructions a tick, one axis, ff+pid, tables, streamed": None,
    "instructions a tick, three axes, every place of the model in use": None,
    "stack, bytes": 2048,
    "RAM, bytes": RAM,
    "flash, bytes": FLASH,
}
WARN = 1.10
TOO_MUCH, MUCH_MORE = "ABOVE ITS CEILING", "more than 10 % above the last"
STARTS = 120
"""More than the 39 ticks of a batch and the 7 between questions have phases that matter two by two."""
UNFILTERED = 0x7FFF_FFFF
ONE = 1 << 26
NEAR_ONE = wire.Biquad(ONE + 4, -ONE // 4 - 4, 2, -ONE // 4, 2)
"""A section that does next to nothing and has all that one can have."""
NO_FILTERS, FILTERS = (wire.Biquad(0, 0, 0, 0, 0),) * 2, (NEAR_ONE,) * 2
ANSWER_TICKS = 20_000
"""An erase takes a second."""


def function(elf: Path, name: str) -> tuple[str, list[str]]:
    """Address of a function's first instruction, and those of its returns."""
    text = subprocess.run(["arm-none-eabi-objdump", "-d", elf], capture_output=True, text=True, check=True).stdout
    match = re.search(rf"^([0-9a-f]+) <{name}>:\n((?:.+\n)+)", text, re.M)
    if match is None:
        sys.exit(f"budget: {elf} has no function {name}")
    lines = match[2].splitlines()
    returns = [line.split(":")[0].strip() for line in lines if re.search(r"\t(pop\S*|ldmia\S*)\t.*pc|\tbx\tlr", line)]
    return match[1], returns


class Counted:
    """A board whose ticks are counted, spoken to without a session's patience."""

    def __init__(self, elf: Path) -> None:
        entry, exits = function(elf, "tick_interrupt")
        _, marks = function(elf, "tick_drive")
        count = f"{entry}:{'+'.join(exits)}:{'+'.join(marks)}"
        self.device = EmulatedDevice(BOARD, plant_parameters(built_in("xyz250")), elf=elf, count=count)
        self.reader, self.id, self.session = FrameReader(), 0, SESSION

    def ask(self, *commands: wire.Command) -> None:
        for command in commands:
            status = self.try_to(command)
            if status != wire.Status.OK:
                sys.exit(f"budget: {command.NAME} refused ({status.name})")

    def ask_status(self) -> wire.StatusReply:
        self.id += 1
        request = wire.StatusRequest()
        self.device.write(encode_frame(wire.HEADER.pack(request.NUMBER, self.id, self.session) + request.pack()))
        return wire.StatusReply.unpack(self._answer()[wire.HEADER.size :])

    def try_to(self, command: wire.Command) -> wire.Status:
        self.id += 1
        self.device.write(encode_frame(wire.HEADER.pack(command.NUMBER, self.id, self.session) + command.pack()))
        return wire.Status(self._answer()[wire.HEADER.size])

    def park(self, ticks: int) -> None:
        """Out of a fault too: an unstable loop may have met a rail."""
        self.ask(wire.ParkRequest())
        self.device.run(ticks)
        self.try_to(wire.ClearFaultRequest())

    def _answer(self) -> bytes:
        for _ in range(ANSWER_TICKS):
            self.device.run(1)
            for body in self.reader.feed(self.device.read(self.device.readable)):
                if wire.HEADER.unpack(body[: wire.HEADER.size])[1] == self.id and body[0] & wire.REPLY_BIT:
                    return body
        sys.exit("budget: the board does not answer")

    def most(self, ticks: int) -> Counts:
        """Of the worst tick so far and in the ticks to come."""
        self.device.run(ticks)
        self.device.read(self.device.readable)
        return self.device.counts()


def worst(counts: Iterable[Counts]) -> Counts:
    """The most of each figure."""
    return Counts(*(max(figures) for figures in zip(*counts, strict=True)))


def model() -> bytes:
    """The built-in stage and the paper's tables."""
    stage = built_in("xyz250")
    axes = {name: axis.model_copy(update={"table": XU_LI_TABLE_I}) for name, axis in stage.axes.items()}
    return device_model(stage.model_copy(update={"axes": axes}))


def tables_alone() -> bytes:
    """The paper's configuration: tables, and nothing that is undone."""
    stage = built_in("xyz250")
    axes = {
        name: axis.model_copy(update={"table": XU_LI_TABLE_I, "time": None, "effects": ()})
        for name, axis in stage.axes.items()
    }
    return device_model(stage.model_copy(update={"axes": axes, "cross_coupling": None}))


def full() -> bytes:
    """Every place in use: 32 plays, 24 dead zones, 8 creep terms, 7 sections an axis, coupling, tables."""
    sent = wire.Model.unpack(model())
    lead = wire.Biquad(2 * ONE, -ONE - ONE // 4 - 3, 4, -ONE // 4, 1)  # (2 - 1.25/z) / (1 - 0.25/z), all but
    axes = tuple(
        replace(
            axis,
            shape=(lead, lead, *[NEAR_ONE] * 4),
            drive=(NEAR_ONE,),
            creep_k_q30=(2 << 20,) * 8,
            creep_alpha_q48=tuple((1 << 38) >> i for i in range(8)),
            play_r_q24=tuple(round((0.01 + 0.004 * i * i) * V) for i in range(32)),
            play_w_q20=(1 << 18,) * 32,
            knot_d_q24=tuple(round((-1.5 + 0.45 * j) * V) for j in range(24)),
            knot_s_q20=tuple((1 << 18) * (1 if j % 2 else -1) for j in range(24)),
        )
        for axis in sent.axes
    )
    return replace(sent, axes=axes).pack()


def upload(blob: bytes) -> list[wire.Command]:
    chunks = [wire.ModelChunkRequest(at, blob[at : at + 512]) for at in range(0, len(blob), 512)]
    return [wire.ModelBeginRequest(len(blob), crc32(blob)), *chunks, wire.ModelCommitRequest()]


def axis(index: int, mode: wire.Mode, swing: int, f_Hz: float) -> list[wire.Command]:
    gains = PAPER_GAINS
    kp, ki_ts = round(gains.kp_V_per_um * V), round(gains.ki_V_per_um_s / 5000 * 2**32)
    kd_over_ts, step = round(gains.kd_V_s_per_um * 5000 * V), round(f_Hz / 5000 * 2**64)
    return [
        wire.SetAxisRequest(index, mode, kp, ki_ts, kd_over_ts, 1 << 30, FILTERS),
        wire.SetPathRequest(index, wire.PathKind.SINE, swing, 0, step, 0),
    ]


def slow(blob: bytes) -> bytes:
    """The same with a slew limit of 0.01 V a tick, which the paper's path exceeds."""
    sent = wire.Model.unpack(blob)
    return replace(sent, axes=tuple(replace(axis, slew_q24=V // 100) for axis in sent.axes)).pack()


def one_axis(elf: Path, blob: bytes) -> Counts:
    """The worst tick of one axis under the paper's gains, its derivative unfiltered, on the paper's path: followed for
    long; begun and ended over and over, in every phase of the stream and of the questions to the DAC; slew limited."""
    board = Counted(elf)
    board.ask(wire.HelloRequest(), wire.SetTimeoutRequest(0))
    set_axis, set_path = axis(0, wire.Mode.FF_PID, 60 * UM, 5)
    found = []
    for model_blob, ticks, runs in ((blob, 3000, 1), (slow(blob), 3000, 1), (blob, 12, STARTS), (slow(blob), 250, 45)):
        board.ask(
            *upload(model_blob),
            replace(set_axis, d_alpha_q31=UNFILTERED, filters=NO_FILTERS),
            replace(set_path, ticks=ticks),
        )
        board.ask(wire.StreamStartRequest(31, 1, 1))
        board.most(0)
        for run in range(runs):
            board.ask(wire.ArmRequest(0), wire.StartRequest(1))
            found.append(board.most(ticks + 8 + run % 7))
            board.park(1500 if ticks > 100 else 60)
            board.most(0)
    board.device.close()
    return worst(found)


def triggers() -> list[wire.Command]:
    """Every output on an axis of its own; a new model ends them."""
    return [wire.TriggerSetRequest(axis, wire.Mark.TURN, axis, 0, 256, 0) for axis in range(3)]


def nested() -> bytes:
    """A waveform of loops within loops, and then one way that closes them all: each bend is a turn to come back to."""
    corners = [(1 - 0.94**k) / 2 if k % 2 else (1 + 0.94**k) / 2 for k in range(40)]
    at = np.r_[np.arange(40) * 20, 790, 800, 1023]
    points = np.interp(np.arange(1024), at, [*corners, 0.5, 1.0, corners[0]])
    return np.round(points * 2**30).astype("<i4").tobytes()


def waveform(index: int, points: bytes) -> list[wire.Command]:
    chunks = [wire.WaveChunkRequest(index, at // 4, points[at : at + 1024]) for at in range(0, len(points), 1024)]
    return [*chunks, wire.WaveCommitRequest(index, crc32(points))]


GENTLE = wire.SetGainsRequest(0, 1 << 14, 1 << 20, 1 << 14, 1 << 30, FILTERS)
"""A loop that follows nothing and is stable with any model, so that what is counted is no tick after a fault."""
JOIN_TICKS, PART_TICKS = 37, 200
FIVE_HZ = round(5 / 5000 * 2**64)


def segments(kind: wire.PathKind) -> wire.Command:
    """A path for all axes, entered by a join."""
    if kind == wire.PathKind.MOVE:
        one = wire.Segment(kind, wire.PathFlag.FROM_HERE, 40 * UM, 0, 2**64 // PART_TICKS, 0, JOIN_TICKS, 0)
    else:
        one = wire.Segment(kind, 0, 20 * UM, 40 * UM, FIVE_HZ, PART_TICKS, JOIN_TICKS, JOIN_TICKS)
    return wire.QueueRequest(7, 0, 0, (one,) * 3)


def joins(board: Counted, mode: wire.Mode, kind: wire.PathKind) -> Counts:
    """Three axes that pass together from rest into a path, into another one, and back to rest; then a fault."""
    board.park(2500)
    board.ask(*triggers())
    for index in range(3):
        set_axis, set_path = axis(index, mode, 60 * UM, 5)
        gains = {name: getattr(GENTLE, name) for name in ("kp_q24", "ki_ts_q32", "kd_over_ts_q24")}
        board.ask(*waveform(index, nested()), replace(set_axis, **gains))
        board.ask(replace(set_path, path=wire.PathKind.HOLD, swing=0))
        board.ask(wire.SetJoinsRequest(index, wire.PathFlag.FROM_HERE, JOIN_TICKS, 0))
        board.ask(wire.MotionRequest(index, 1 << 62, 1 << 62, 1 << 62, 1, 1))
    board.ask(wire.StreamStartRequest(31, 7, 1), wire.ArmRequest(0), wire.StartRequest(7))
    board.device.run(300)
    board.ask(segments(kind), segments(kind), wire.WhereRequest(), *(replace(GENTLE, axis=i) for i in range(3)))
    found = [board.most(3 * (PART_TICKS + JOIN_TICKS) + 200)]
    if board.ask_status().state != wire.State.RUNNING:
        sys.exit(f"budget: {mode.name} along {kind.name} ended in a fault before all was counted")
    board.device.inject(Injection.INTERLOCK, 1)
    found.append(board.most(20))
    board.device.inject(Injection.INTERLOCK, 0)
    return worst(found)


def three_axes(elf: Path, blob: bytes) -> Counts:
    """The worst tick: every mode, saturations, changes of mode, a model that is swapped in, turns
    within turns, and paths that end together."""
    board = Counted(elf)
    board.ask(wire.HelloRequest(), wire.SetTimeoutRequest(0))
    found = []
    for mode, kind, swing, f_Hz, ticks in (
        (wire.Mode.FF_PID, wire.PathKind.SINE, 60, 5, 0),
        (wire.Mode.INVERSE_PID, wire.PathKind.SINE, 100, 5, 0),
        (wire.Mode.INVERSE_PID, wire.PathKind.SINE, 180, 90, 0),  # slew limit and clamps
        (wire.Mode.INVERSE_PID, wire.PathKind.WAVE, 100, 10, 0),
        (wire.Mode.INVERSE_PID, wire.PathKind.WAVE, 60, 40, 3500),
        (wire.Mode.PID, wire.PathKind.SINE, 230, 400, 0),
    ):
        board.park(2500)
        board.ask(*upload(blob), *triggers())  # its swap at a tick's edge is in the count
        board.ask(wire.StreamStartRequest(31, 7, 1))
        for index in range(3):
            set_axis, set_path = axis(index, mode, swing * UM, f_Hz)
            board.ask(*(waveform(index, nested()) if kind == wire.PathKind.WAVE else []))
            board.ask(set_axis, replace(set_path, path=kind, ticks=ticks))
        board.ask(wire.ArmRequest(0), wire.StartRequest(7))
        found.append(board.most(4000))
    kinds = wire.PathKind.SINE, wire.PathKind.MOVE, wire.PathKind.WAVE
    found += [joins(board, mode, kind) for mode in (wire.Mode.FF_PID, wire.Mode.INVERSE_PID) for kind in kinds]
    board.park(2500)
    found.append(three_faults(board, blob))
    board.device.close()
    return worst(found)


def three_faults(board: Counted, blob: bytes) -> Counts:
    """All axes are too far from their paths in the same tick."""
    sent = wire.Model.unpack(blob)
    strict = tuple(replace(axis, error_limit_q16=1, error_ticks=200) for axis in sent.axes)
    board.ask(*upload(replace(sent, axes=strict).pack()), wire.StreamStartRequest(31, 7, 1))
    for index in range(3):
        board.ask(*axis(index, wire.Mode.INVERSE_PID, 60 * UM, 5))
    board.ask(wire.ArmRequest(0), wire.StartRequest(7))
    found = board.most(250)
    if board.ask_status().state != wire.State.FAULT:
        sys.exit("budget: no axis was too far from its path")
    return found


def points(board: Counted) -> None:
    """Three axes that play points that come meanwhile; the path is waited for until it runs dry."""
    first, count, data = -110, 90, bytes(3 * 90 * 4)
    board.ask(wire.PointsBeginRequest(7, 0, first, (1 << 30,) * 3))
    for at in range(first, first + 7 * count, count):
        board.ask(wire.PointsRequest(7, at, 0, data))
    for index in range(3):
        set_axis, set_path = axis(index, wire.Mode.INVERSE_PID, 60 * UM, 5)
        board.ask(set_axis, replace(set_path, path=wire.PathKind.WAVE, step_turn64=1 << 54))
        board.ask(wire.SetJoinsRequest(index, 0, 100, 100))
    board.ask(wire.ArmRequest(0), wire.StartRequest(7), wire.PointsRequest(7, first + 7 * count, 0, data))
    board.device.run(1000)
    board.ask(wire.WhereRequest())


def settings(elf: Path) -> Counts:
    """The longest lock of any command: sessions, uploads, paths of every kind and their starts, reads and a save."""
    board = Counted(elf)
    board.ask(wire.HelloRequest(), wire.SetTimeoutRequest(0), *upload(full()))
    for mode, kind in (
        (wire.Mode.FF_PID, wire.PathKind.SINE),
        (wire.Mode.FF_PID, wire.PathKind.MOVE),
        (wire.Mode.INVERSE_PID, wire.PathKind.WAVE),
    ):
        board.ask(wire.StreamStartRequest(31, 7, 1))
        for index in range(3):
            set_axis, set_path = axis(index, mode, 60 * UM, 5)
            board.ask(*waveform(index, nested()), set_axis, replace(set_path, path=kind))
        board.ask(wire.ArmRequest(0), wire.StartRequest(7))
        board.device.run(500)
        board.ask(wire.StatusRequest(), wire.InfoRequest(), wire.StopRequest(), wire.StreamStopRequest())
        board.ask(wire.SnapshotReadRequest(wire.Region.STATE, 0, 1024), wire.ModelReadRequest(0, 1024))
        board.park(3000)
    points(board)
    board.park(3000)
    for silent in (1, 0):  # a DAC that comes back is read
        board.device.inject(Injection.DAC_SILENT, silent)
        board.device.run(100)
    board.park(3000)
    board.session += 1
    board.ask(wire.HelloRequest(), wire.ModelPersistRequest())
    return board.most(0)


def ticks(elf: Path) -> tuple[int, ...]:
    """The first rows of the table."""
    tables, time_view = one_axis(elf, tables_alone()), one_axis(elf, model())
    everything, built = three_axes(elf, full()), three_axes(elf, model())
    everything = worst((everything, settings(elf)))
    every = worst((tables, time_view, everything, built))
    cycles = tables.cycles, time_view.cycles, everything.cycles, built.cycles, every.cycles_to_mark, every.locked_cycles
    return *cycles, tables.instructions, everything.instructions


def memory(elf: Path) -> tuple[int, int]:
    """Bytes of RAM, stack included, and of the image in flash."""
    text = subprocess.run(["arm-none-eabi-nm", elf], capture_output=True, text=True, check=True).stdout
    at = {name: int(address, 16) for address, name in re.findall(r"^([0-9a-f]{8}) \w (\w+)$", text, re.M)}
    return at["zeroed_end"] - 0x2000_0000, at["image_length"]


def committed() -> dict[str, int]:
    """The figures that the manual states."""
    rows = re.findall(r"^\| ([^|]+?) \| ([\d,]+) \|", PAGE.read_text("utf-8") if PAGE.exists() else "", re.M)
    return {name: int(figure.replace(",", "")) for name, figure in rows}


def verdict(figure: int, ceiling: int | None, last: int | None) -> str:
    if ceiling is not None and figure > ceiling:
        return TOO_MUCH
    return MUCH_MORE if last is not None and figure > WARN * last else "ok"


def judge(figures: dict[str, int], last: dict[str, int]) -> int:
    """Prints the table and, below it, a line for each figure that has grown much; the exit status."""
    verdicts = {name: verdict(figure, CEILINGS[name], last.get(name)) for name, figure in figures.items()}
    print("| what | worst | ceiling | |\n|---|---|---|---|")
    for name, figure in figures.items():
        ceiling = CEILINGS[name]
        print(f"| {name} | {figure:,} | {'' if ceiling is None else f'{ceiling:,}'} | {verdicts[name]} |")
    for name, said in verdicts.items():
        if said == MUCH_MORE:
            print(f"warning: {name}: {figures[name]:,} is {MUCH_MORE} ({last[name]:,} in {PAGE.name})")
    return int(TOO_MUCH in verdicts.values())


def main() -> int:
    elf = find_firmware(BOARD)
    stack, chains = worst_stack(elf.parent)
    figures = dict(zip(CEILINGS, [*ticks(elf), stack, *memory(elf)], strict=True))
    status = judge(figures, committed())
    print(f"\nA tick has {TICK_CYCLES:,} cycles of {CLOCK_Hz / 1e6:.0f} MHz.")
    for size, chain in chains:
        print(f"stack {size:5d}: {' -> '.join(chain)}")
    return status


if __name__ == "__main__":
    sys.exit(main())
