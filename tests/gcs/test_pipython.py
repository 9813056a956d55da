"""PI's own Python package as the client, over a socket and over a serial port."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from pipython import GCSDevice, GCSError, datarectools, gcserror, pitools
from pipython.pidevice.interfaces.pigateway import PIGateway
from pipython.pidevice.interfaces.piserial import PISerial
from pipython.pidevice.interfaces.pisocket import PISocket

from phaselead.gcs.commands import COMMANDS

pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
"""PIPython closes a socket a second time when its device is collected."""
NEAR_UM = 0.3


@pytest.fixture(params=["socket", "serial"])
def pi(request, server) -> Iterator[GCSDevice]:
    gateway = (
        PISocket("127.0.0.1", server.tcp_port) if request.param == "socket" else PISerial(server.where.terminal, 115200)
    )
    with GCSDevice(gateway=gateway) as device:
        yield device
        device.SVO(device.axes, [False] * 3)
    PIGateway._connection_status_changed_callbacks.clear()  # those of recorders stay, and talk to closed sockets


def near(found, wanted) -> bool:
    return all(abs(found[axis] - um) < NEAR_UM for axis, um in wanted.items())


def test_what_it_asks_first(pi):
    assert pi.devname == "PHASELEAD"
    assert pi.axes == pi.allaxes == ["x", "y", "z"]
    assert pi.qCSV() == 2.0
    assert "phaselead" in pi.qVER()
    assert pi.HasMOV()
    assert pi.HasqPOS()
    assert pi.HasWGO()
    assert not pi.HasFRF()
    assert pi.IsControllerReady()
    assert len(pi.qHLP().splitlines()) == len(COMMANDS) + 2


def test_startup_moves_and_waits(pi):
    assert not any(pi.qSVO().values())
    pitools.startup(pi)
    assert all(pi.qSVO().values())
    pi.MOV({"x": 40, "y": 20})
    pitools.waitontarget(pi, polldelay=0)
    assert near(pi.qPOS(), {"x": 40, "y": 20})
    assert pi.qMOV(["x", "y"]) == {"x": 40, "y": 20}
    assert all(pi.qONT().values())
    pi.MVR("y", -5.5)
    pitools.waitontarget(pi, polldelay=0)
    assert near(pi.qPOS(), {"x": 40, "y": 14.5})
    pitools.moveandwait(pi, {"x": 60, "y": 60, "z": 60})
    assert near(pi.qPOS(), {"x": 60, "y": 60, "z": 60})


def test_a_move_under_way_is_left_for_another(pi):
    pitools.startup(pi)
    pi.VEL("x", 200)
    assert pi.qVEL("x") == {"x": 200}
    pi.MOV("x", 150)
    assert pi.IsMoving()["x"]
    pi.MOV("x", 30)
    pi.MOV("y", 10)
    pitools.waitontarget(pi, polldelay=0)
    assert near(pi.qPOS(), {"x": 30, "y": 10})


def test_errors_have_pis_numbers(pi):
    with pytest.raises(GCSError) as unarmed:
        pi.MOV("x", 10)
    assert unarmed.value == gcserror.E5_PI_CNTR_MOVE_WITHOUT_REF_OR_NO_SERVO
    pi.SVO("x", True)
    low, high = pi.qTMN("x")["x"], pi.qTMX("x")["x"]
    for um, command in ((low - 1, pi.MOV), (high + 1, pi.MOV), (high + 1, pi.MVR)):
        before = pi.qMOV("x")
        with pytest.raises(GCSError) as outside:
            command("x", um)
        assert outside.value == gcserror.E7_PI_CNTR_POS_OUT_OF_LIMITS
        assert pi.qMOV("x") == before
        assert not pi.IsMoving()["x"]
    for call, error in (
        (lambda: pi.MOV("q", 1), gcserror.E15_PI_CNTR_INVALID_AXIS_IDENTIFIER),
        (lambda: pi.VEL("x", 1e9), gcserror.E8_PI_CNTR_VEL_OUT_OF_LIMITS),
        (lambda: pi.send("FRF x"), gcserror.E2_PI_CNTR_UNKNOWN_COMMAND),
        (lambda: pi.SPA("1", 0x0E000200, 1), gcserror.E64_PI_CNTR_READ_ONLY_PARAMETER),
        (lambda: pi.WGO(1, 1), gcserror.E75_PI_CNTR_NO_WAVE_SELECTED),
    ):
        with pytest.raises(GCSError) as refused:
            call()
        assert refused.value == error


@pytest.mark.parametrize("how", ["STP", "HLT", "StopAll"])
def test_stop_holds_where_it_is_and_sets_error_10(pi, how):
    pitools.startup(pi)
    pi.VEL("x", 200)
    pi.MOV("x", 200)
    with pytest.raises(GCSError) as stopped:
        getattr(pi, how)()
    assert stopped.value == gcserror.E10_PI_CNTR_STOP
    assert pi.qSVO("x")["x"]
    target = pi.qMOV("x")["x"]
    assert target < 150
    pitools.waitontarget(pi, polldelay=0)
    assert near(pi.qPOS(), {"x": target})


def test_a_wave_is_played_recorded_and_ends_on_its_last_point(pi):
    pitools.startup(pi)
    pi.WAV_SIN_P(1, firstpoint=0, numpoints=500, append="X", center=250, amplitude=20, offset=10, seglength=500)
    pi.WSL(1, 1)
    pi.WGC(1, 3)
    recorder = datarectools.Datarecorder(pi)
    recorder.numvalues, recorder.options, recorder.sources = 2000, [1, 2], ["x", "x"]
    recorder.trigsources = datarectools.TriggerSources.POSITION_CHANGING_COMMAND_1
    recorder.arm()
    assert recorder.servotime == recorder.sampletime == 0.0002
    pi.WGO(1, 1)
    header, (target, position) = recorder.getdata()
    assert (header["DIM"], header["NDATA"], header["SAMPLE_TIME"]) == (2, 2000, 0.0002)
    assert abs(max(target) - 30) < 0.01
    assert np.ptp(position) > 15
    pitools.waitonwavegen(pi, polldelay=0)
    pitools.waitontarget(pi, "x", polldelay=0)
    assert near(pi.qPOS(), {"x": 10})


def test_a_wave_without_cycles_goes_on_until_it_is_stopped(pi):
    pitools.startup(pi)
    pi.WAV_RAMP(
        2, firstpoint=0, numpoints=400, append="X", center=200, speedupdown=20, amplitude=5, offset=20, seglength=400
    )
    pi.WSL(2, 2)
    pi.WGC(2, 0)
    pi.WGO(2, 1)
    assert pi.qWGO() == {1: 0, 2: 1, 3: 0}
    assert pi.IsGeneratorRunning(2) == {2: True}
    for refused in (lambda: pi.MOV("x", 1), lambda: pi.WGO(1, 1), lambda: pi.WAV_PNT(2, 1, 1, "X", 3)):
        with pytest.raises(GCSError) as busy:
            refused()
        assert busy.value in (gcserror.E73_PI_CNTR_WAVE_GENERATOR_ACTIVE, gcserror.E75_PI_CNTR_NO_WAVE_SELECTED)
    pi.WGO(2, 0)
    assert not any(pi.qWGO().values())
    assert 19 < pi.qMOV("y")["y"] < 26
    pi.MOV("y", 12)
    pitools.waitontarget(pi, "y", polldelay=0)
    assert near(pi.qPOS(), {"y": 12})


def test_a_wave_parks_nobody(pi):
    """The stage was parked first: all axes went to 0 V and back."""
    pitools.startup(pi)
    pi.MOV({"x": 40, "y": 30})
    pitools.waitontarget(pi, polldelay=0)
    pi.WAV_SIN_P(1, firstpoint=0, numpoints=500, append="X", center=250, amplitude=20, offset=30, seglength=500)
    pi.WSL(1, 1)
    pi.WGC(1, 0)
    for _ in range(2):  # and again from where it was stopped
        pi.WGO(1, 1)
        assert near(pi.qPOS("y"), {"y": 30})
        assert pi.qMOV("y")["y"] == 30
        pi.WGO(1, 0)
        assert near(pi.qPOS("y"), {"y": 30})


def test_points_are_sent_in_bunches_and_read_back(pi):
    points = [10 + 5 * np.sin(0.1 * k) for k in range(63)]
    pitools.writewavepoints(pi, 3, points, bunchsize=10)
    assert pi.qWAV(3, 1)[3][1] == 63
    header = pi.qGWD(3, 1, 63)
    while pi.bufstate is not True:
        pass
    assert header["NDATA"] == 63
    assert np.allclose(pi.bufdata[0], points, atol=1e-4)


def test_a_move_is_recorded_from_its_command_on(pi):
    pitools.startup(pi)
    recorder = datarectools.Datarecorder(pi)
    recorder.numvalues, recorder.samplefreq = 200, 1000
    recorder.options, recorder.sources = [2, 3, 7], ["y", "y", "y"]
    recorder.trigsources = datarectools.TriggerSources.NEXT_COMMAND_WITH_RESET_2
    recorder.arm()
    pi.MOV("y", 30)
    header, (position, error, volts) = recorder.getdata()
    assert header["SAMPLE_TIME"] == 0.001
    assert abs(position[0]) < 5  # where the parked stage rests, with what hysteresis leaves
    assert abs(position[-1] - 30) < NEAR_UM
    assert max(map(abs, error)) < 10
    assert volts[-1] > volts[0] + 0.5
