"""Speaks the wire with a simulated device, emulated or in this process, and keeps what it says."""

from zlib import crc32

from phaselead.device import wire
from phaselead.device.encode_model import device_model
from phaselead.device.framing import FrameReader, encode_frame
from phaselead.model.table import TableView
from phaselead.sim.plant import built_in

SESSION = 0x0123_4567_89AB_CDEF
ANSWER_TICKS = 2000
UM, V = 1 << 16, 1 << 24


XU_LI_TABLE_I = TableView(
    swing_V=(0.5, 10),
    f_Hz=(1, 20),
    a_um_per_V=(15.2536, 1.9619, -0.1013),
    b_deg=(1.9238, 0.7477, 0.0456, 0.0047, -0.0466, 0.0003),
    c_um=(-1.7893, 1.1365, 0.3635, -0.0463, -0.0140, -0.0150),
)


def stage_model():
    """The built-in stage with the paper's tables on every axis."""
    stage = built_in("xyz250")
    axes = {name: axis.model_copy(update={"table": XU_LI_TABLE_I}) for name, axis in stage.axes.items()}
    return device_model(stage.model_copy(update={"axes": axes}))


def upload(model):
    """The commands of an upload."""
    chunks = [wire.ModelChunkRequest(at, model[at : at + 512]) for at in range(0, len(model), 512)]
    return [wire.ModelBeginRequest(len(model), crc32(model)), *chunks, wire.ModelCommitRequest()]


class Talker:
    """``pause``: ticks between a reply and the next command; long enough, and no command waits for the line."""

    def __init__(self, device, pause=0):
        self.device, self.pause = device, pause
        self.reader = FrameReader()
        self.frames, self.ticks = [], []
        """Every frame sent, and the tick before which it took effect."""
        self.samples, self.events, self.replies = [], [], {}
        self._id = 0

    def frame(self, command):
        self._id += 1
        return encode_frame(wire.HEADER.pack(command.NUMBER, self._id, SESSION) + command.pack())

    @property
    def last_id(self):
        return self._id

    def listen(self):
        for body in self.reader.feed(self.device.read(self.device.readable)):
            payload = body[wire.HEADER.size :]
            if body[0] == wire.Samples.NUMBER:
                self.samples.append(wire.Samples.unpack(payload))
            elif body[0] == wire.Event.NUMBER:
                self.events.append(wire.Event.unpack(payload))
            else:
                self.replies[wire.HEADER.unpack(body[: wire.HEADER.size])[1]] = body

    def run(self, ticks):
        """In pieces: the line holds no more than 1 MB for a reader who is late."""
        while ticks > 0:
            self.device.run(min(ticks, 5000))
            self.listen()
            ticks -= 5000

    def ask(self, command, ticks=ANSWER_TICKS):
        """The reply, whatever its status."""
        frame = self.frame(command)
        self.device.write(frame)
        for _ in range(ticks):
            self.run(1)
            if self._id in self.replies:
                break
        payload = self.replies[self._id][wire.HEADER.size :]
        status, tick = wire.REPLY_HEAD.unpack(payload[: wire.REPLY_HEAD.size])
        self.frames.append(frame)
        self.ticks.append(tick)
        self.run(self.pause)
        if len(payload) == wire.REPLY_HEAD.size:
            return wire.Status(status)
        return command.REPLY.unpack(payload)

    def ok(self, *commands):
        """The last one's reply."""
        for command in commands:
            reply = self.ask(command)
            status = reply if isinstance(reply, wire.Status) else reply.status
            assert status == wire.Status.OK, (command.NAME, wire.Status(status).name)
        return reply

    @property
    def state(self):
        return wire.State(self.ok(wire.StatusRequest()).state)

    def drive(self, swing=4 * V, f_Hz=5, axis=0):
        """Arms and runs a sine in volts."""
        step = round(f_Hz / 5000 * 2**64)
        self.ok(
            wire.SetTimeoutRequest(0),
            wire.SetAxisRequest(axis, wire.Mode.OPEN, 0, 0, 0, 0x7FFFFFFF),
            wire.SetPathRequest(axis, wire.PathKind.SINE, swing, 0, step, 0),
            wire.ArmRequest(0),
            wire.StartRequest(1 << axis),
        )
