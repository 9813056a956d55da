"""A device on the bench: its firmware in this process, converters under the test's thumb, and a line that is
infinitely fast. Says what the wire says, and nothing of the host package's own session logic."""

from __future__ import annotations

from dataclasses import replace
from zlib import crc32

import numpy as np

from phaselead.device import wire
from phaselead.device.framing import FrameReader, encode_frame
from phaselead.sim.device import Firmware

MID_CODE = 20_000
"""An ADC code well inside its range."""
ZERO_V_CODE = 32768
SLEW_CODES = 640
"""0.2 V a tick, the default slew limit, in DAC codes of 0.3125 mV."""
RAMP_CODES = 32
"""0.01 V a tick, the default ramp."""
SESSION = 0x1234_5678_9ABC_DEF0
MODEL_CHUNK = 1000
UM = 1 << 16
V = 1 << 24


def step_of(f_Hz):
    """Turns per tick."""
    return round(f_Hz / 5000 * 2**64)


class Bench:
    def __init__(self, *, flash=None, baud=2_000_000, session=SESSION, library=None, hello=True):
        self.firmware = Firmware(baud, flash, library)
        self.session = session
        self.reader = FrameReader()
        self.samples, self.events, self.replies = [], [], []
        self.next_id = 0
        self.dac = np.empty((0, 3), np.uint16)
        """DAC codes of every tick since power-on."""
        if hello:
            self.ok(wire.HelloRequest())

    def frame(self, command, *, id=None, session=None):
        self.next_id += id is None
        number = self.next_id % 0xFFFF + 1 if id is None else id
        nonce = self.session if session is None else session
        return encode_frame(wire.HEADER.pack(command.NUMBER, number, nonce) + command.pack())

    def run(self, ticks=1, adc=None):
        """Runs ticks against one ADC code, or one per axis, or one row per tick; gives their DAC codes. By default
        sensors at rest: a code of noise."""
        codes = np.empty((ticks, 3), np.uint16)
        codes[:] = MID_CODE + (np.arange(ticks)[:, None] + len(self.dac)) % 2 if adc is None else adc
        out = self.firmware.run_codes(codes)
        self.dac = np.concatenate([self.dac, out])
        self._sort()
        return out

    def _sort(self):
        for body in self.reader.feed(self.firmware.read(self.firmware.readable)):
            payload = body[wire.HEADER.size :]
            if body[0] == wire.Samples.NUMBER:
                self.samples.append(wire.Samples.unpack(payload))
            elif body[0] == wire.Event.NUMBER:
                self.events.append(wire.Event.unpack(payload))
            else:
                self.replies.append(body)

    def raw(self, frame):
        """Sends bytes, lets one tick pass, gives the bodies of the replies that came."""
        self.replies.clear()
        self.firmware.write(frame)
        self.run(1)
        return list(self.replies)

    def ask(self, command, **header):
        """The reply of a command, whatever its status. One tick passes."""
        (body,) = self.raw(self.frame(command, **header))
        assert body[0] == command.NUMBER | wire.REPLY_BIT
        payload = body[wire.HEADER.size :]
        return command.REPLY.unpack(payload) if len(payload) > wire.REPLY_HEAD.size else Head(payload)

    def status_of(self, command, **header):
        return wire.Status(self.ask(command, **header).status)

    def ok(self, command, **header):
        reply = self.ask(command, **header)
        assert reply.status == wire.Status.OK, wire.Status(reply.status).name
        return reply

    # -------------------------------------------------------- the usual ways to get somewhere

    def status(self):
        return self.ok(wire.StatusRequest())

    @property
    def state(self):
        return wire.State(self.status().state)

    def set_axis(self, axis=0, mode=wire.Mode.OPEN, kp=0, ki=0, kd=0, alpha=0x7FFFFFFF):
        return self.status_of(wire.SetAxisRequest(axis, mode, kp, ki, kd, alpha))

    def set_path(self, axis=0, path=wire.PathKind.SINE, swing=4 * V, offset=0, step=None, ticks=0):
        return self.status_of(
            wire.SetPathRequest(axis, path, swing, offset, step_of(5) if step is None else step, ticks)
        )

    def drive(self, axis=0, mode=wire.Mode.OPEN, **path):
        """Arms and starts one axis."""
        gains = {"kp": V // 50, "ki": 1 << 20} if "PID" in mode.name else {}
        assert self.set_axis(axis, mode, **gains) == wire.Status.OK
        if mode != wire.Mode.OPEN:
            path = {"swing": 60 * UM} | path
        assert self.set_path(axis, **path) == wire.Status.OK
        self.ok(wire.ArmRequest(0))
        self.ok(wire.StartRequest(1 << axis))

    def upload(self, model):
        blob = model if isinstance(model, bytes) else model.pack()
        self.ok(wire.ModelBeginRequest(len(blob), crc32(blob)))
        for at in range(0, len(blob), MODEL_CHUNK):
            self.ok(wire.ModelChunkRequest(at, blob[at : at + MODEL_CHUNK]))
        return self.ask(wire.ModelCommitRequest())

    def model(self):
        """The active model blob, read back."""
        pieces = [self.ok(wire.ModelReadRequest(at, MODEL_CHUNK)) for at in range(0, wire.Model.SIZE, MODEL_CHUNK)]
        return b"".join(piece.data for piece in pieces)

    def park(self):
        self.ok(wire.ParkRequest())
        self.run(2000)
        assert self.state == wire.State.PARKED


class Head:
    """A reply of status and tick alone."""

    def __init__(self, payload):
        self.status, self.tick = wire.REPLY_HEAD.unpack(payload)


UNUSED = 2**31 - 1
PLAYS = ((0.1, 2.0), (0.5, 1.5), (1.2, 2.2), (3.0, 0.6))
KNOTS = ((1.0, 1.6), (3.0, 1.5), (6.0, -2.4))
PASS = wire.Biquad(1 << 26, 0, 0, 0, 0)


def padded(values, bits, count, unused=0):
    """Fixed point, the places not in use filled."""
    return (*(round(v * 2**bits) for v in values), *[unused] * (count - len(values)))


AXIS_MODEL = wire.AxisModel(
    flags=3,
    u_min_q24=-2 * V,
    u_max_q24=10 * V,
    u_park_q24=0,
    slew_q24=V // 5,
    ramp_q24=V // 100,
    dac_zero_code=32768,
    dac_codes_per_V_q16=3200 << 16,
    adc_zero_code=2341,
    adc_um_per_code_q32=18350080,
    swing_min_q24=V // 2,
    swing_max_q24=10 * V,
    f_min_q16=1 << 16,
    f_max_q16=20 << 16,
    # Xu & Li 2010, Table I; theta in turns.
    a_q32=tuple(round(a * 2**32) for a in (15.2536, 1.9619, -0.1013)),
    b_q40=tuple(round(b / 360 * 2**40) for b in (1.9238, 0.7477, 0.0456, 0.0047, -0.0466, 0.0003)),
    c_q32=tuple(round(c * 2**32) for c in (-1.7893, 1.1365, 0.3635, -0.0463, -0.0140, -0.0150)),
    # A stage of 14 um/V with loops, bends, creep, a lead of one tick and one more in the amplifier.
    preview_ticks_q16=3 << 15,
    shape=(wire.Biquad(2 << 26, -(1 << 26), 0, 0, 0), *[PASS] * 5),
    drive=(wire.Biquad(3 << 25, -(1 << 25), 0, 0, 0),),
    creep_k_q30=padded((0.004, 0.006), 30, 8),
    creep_alpha_q48=padded((0.002, 0.0002), 48, 8),
    gain_q20=14 << 20,
    offset_q16=-2 * UM,
    rest_fraction_q30=1 << 29,
    play_r_q24=padded([r for r, _ in PLAYS], 24, 32, UNUSED),
    play_w_q20=padded([w for _, w in PLAYS], 20, 32),
    knot_d_q24=padded([d for d, _ in KNOTS], 24, 24, UNUSED),
    knot_s_q20=padded([s for _, s in KNOTS], 20, 24),
    coupling_q28=(1 << 28, 0, 0),
    error_limit_q16=70 * UM,
    error_ticks=500,
    oscillation_limit_q16=0,
)
COUPLING = ((1.0, 0.02, -0.013), (0.04, 1.0, 0.017), (-0.024, 0.031, 1.0))


def model(hash_byte=0, **first_axis):
    """The paper's stage on three axes, coupled, with some fields of the first one changed."""
    x, y, z = (replace(AXIS_MODEL, coupling_q28=padded(row, 28, 3)) for row in COUPLING)
    return wire.Model(magic=0x314C4850, stage_hash=bytes([hash_byte]) * 32, axes=(replace(x, **first_axis), y, z))
