"""A device on a serial port: framing, the wire, sessions, streams, and a model as the device holds it."""

from __future__ import annotations

from phaselead.device import motion, wire
from phaselead.device.capture import DeviceFault, NoEdge, QueuedPaths, RanDry, Spool, no_edge
from phaselead.device.device import Device
from phaselead.device.encode_model import device_model, from_device_model, inverse_refusal
from phaselead.device.explained_faults import FaultPage, explain_fault, fault_names
from phaselead.device.fault_log import FaultLog, read_fault_log
from phaselead.device.flash import flash_board, flash_by_wire
from phaselead.device.framing import FrameReader, encode_frame
from phaselead.device.left_running import IDS_RESERVED, LeftRunning, recall, remember
from phaselead.device.limits import AxisLimits, Limits, held_back, looser_than, read_limits, set_limits
from phaselead.device.live import Live, LiveAxis, LiveSamples
from phaselead.device.loop_test import SelfTest, selftest
from phaselead.device.motion import AxisWhere, MotionLimits, Where
from phaselead.device.parking import after_interrupt, park_quietly
from phaselead.device.points import PointFeeder
from phaselead.device.quantities import STOP_S, TICK_HZ, Converters, converters, path_request
from phaselead.device.run_file import channels_of, read_capture, recording_of, replay_facts, write_run
from phaselead.device.session import Refused, Session
from phaselead.device.standing import (
    LARGEST_STEP_V,
    Standing,
    StatusInUnits,
    says_when_interrupted,
    standings,
    status_in_units,
)
from phaselead.device.status import DeviceStatus
from phaselead.device.stream import ALL_CHANNELS, AXES, Capture, Gap, Stream, axes_of, decode_samples
from phaselead.device.transient import Trigger, pull, set_trigger
from phaselead.device.triggers import OUTPUTS, Pulses, pulses_of, set_outputs
from phaselead.device.wire import Channel, Mode
from phaselead.serial_ports import BAUD

__all__ = [
    "ALL_CHANNELS",
    "AXES",
    "BAUD",
    "IDS_RESERVED",
    "LARGEST_STEP_V",
    "OUTPUTS",
    "STOP_S",
    "TICK_HZ",
    "AxisLimits",
    "AxisWhere",
    "Capture",
    "Channel",
    "Converters",
    "Device",
    "DeviceFault",
    "DeviceStatus",
    "FaultLog",
    "FaultPage",
    "FrameReader",
    "Gap",
    "LeftRunning",
    "Limits",
    "Live",
    "LiveAxis",
    "LiveSamples",
    "Mode",
    "MotionLimits",
    "NoEdge",
    "PointFeeder",
    "Pulses",
    "QueuedPaths",
    "RanDry",
    "Refused",
    "SelfTest",
    "Session",
    "Spool",
    "Standing",
    "StatusInUnits",
    "Stream",
    "Trigger",
    "Where",
    "after_interrupt",
    "axes_of",
    "channels_of",
    "converters",
    "decode_samples",
    "device_model",
    "encode_frame",
    "explain_fault",
    "fault_names",
    "flash_board",
    "flash_by_wire",
    "from_device_model",
    "held_back",
    "inverse_refusal",
    "looser_than",
    "motion",
    "no_edge",
    "park_quietly",
    "path_request",
    "pull",
    "pulses_of",
    "read_capture",
    "read_fault_log",
    "read_limits",
    "recall",
    "recording_of",
    "remember",
    "replay_facts",
    "says_when_interrupted",
    "selftest",
    "set_limits",
    "set_outputs",
    "set_trigger",
    "standings",
    "status_in_units",
    "wire",
    "write_run",
]
