"""A device on a serial port: framing, the wire, sessions, streams, and a model as the device holds it."""

from __future__ import annotations

from phaselead.device import wire
from phaselead.device.capture import DeviceFault
from phaselead.device.device import Device
from phaselead.device.encode_model import device_model, from_device_model, inverse_refusal
from phaselead.device.framing import FrameReader, encode_frame
from phaselead.device.quantities import TICK_HZ
from phaselead.device.run_file import read_capture, recording_of, write_run
from phaselead.device.selftest import selftest
from phaselead.device.standing import LARGEST_STEP, Standing, standings
from phaselead.device.stream import AXES, Capture, axes_of, decode_samples
from phaselead.device.wire import Channel, Mode
from phaselead.serial_ports import list_ports

__all__ = [
    "AXES",
    "LARGEST_STEP",
    "TICK_HZ",
    "Capture",
    "Channel",
    "Device",
    "DeviceFault",
    "FrameReader",
    "Mode",
    "Standing",
    "axes_of",
    "decode_samples",
    "device_model",
    "encode_frame",
    "from_device_model",
    "inverse_refusal",
    "list_ports",
    "read_capture",
    "recording_of",
    "selftest",
    "standings",
    "wire",
    "write_run",
]
