"""Run by test_adding.py in a tree that has the command `echo`: packs, unpacks, asks the device, and is refused."""

from __future__ import annotations

import sys

from phaselead.device import Device, wire
from phaselead.device.session import Refused

request = wire.EchoRequest(word=0x01020304)
assert request.pack() == bytes([4, 3, 2, 1])
assert wire.MESSAGES[0x16].unpack(request.pack()) == request
assert wire.MESSAGES[0x96] is wire.EchoReply

with Device.open("sim://xyz250") as device:
    assert device.session.request(request).word == request.word
    try:
        device.session.request(wire.EchoRequest(word=0))
    except Refused as refusal:
        print(refusal)
    device.arm()
    try:
        device.session.request(request)
    except Refused as refusal:
        print(refusal)
sys.exit(0)
