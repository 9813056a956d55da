"""A path on the model before it is driven: the same firmware, in this process, before a stage that obeys the model."""

from __future__ import annotations

import math
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from phaselead.control.modes import INVERTS
from phaselead.control.motion_limits import first_mode_Hz, rests_unseen
from phaselead.control.path_speed import beyond_slew, hardest, refuse_voltage_too_fast
from phaselead.control.run import Run
from phaselead.control.tracking import check_paths, default_duration_s, track
from phaselead.device import TICK_HZ, Capture, Converters, Device, DeviceFault, converters, device_model
from phaselead.errors import BadInput, DeviceRefused
from phaselead.model import Gains, Stage
from phaselead.sim import plant_parameters, virtual_stage
from phaselead.waveforms import Goto, Streamed, Waveform

LONGEST_S = 2.0
"""Of a rehearsal. What is too fast, or runs away, shows within a few periods of a mode; faults take 0.1 s."""
HALVINGS = 7
"""Of the way from 1/64 of a swing or frequency to the whole, in equal ratios: the one that works is found to 3 %."""
LEAST_SHARE = 1 / 64
CUT_V = 0.005
"""Beyond what codes and recorded voltages are rounded by, 0.3 mV and 0.5 mV each."""
FORWARD_STEP_V = 2**-11
"""Of recorded feed-forward and feedback."""
CUT = "is cut by the output's limits"
FAR_OFF = 10.0
"""Times the error that the model said, and what it left of its own records, from which a run is remarked on. Chosen:
creep, noise and a path unlike those records add a few times as much."""
LIMITED_SHARE = 0.1
"""Of the ticks at the slew limit or a clamp: so long the loop is open, and what the limit cuts off rings the stage. The
corners of a triangle that a stage can follow take a few per cent."""


@dataclass(frozen=True)
class Predicted:
    """The error of one axis along its path on the model, over the same rows as the figures of a run."""

    max_um: float
    max_pct: float
    rms_um: float
    first_s: float | None
    """It is of so much of the path; None: of all of it."""
    from_s: float = 0.0
    """Where that begins."""

    def sentence(self, axis: str) -> str:
        """What will happen, in words; of a stage that is all that its model says."""
        part = ""
        if self.first_s is not None:
            later = f" from {self.from_s:.4g} s on" if self.from_s > 0 else ""
            part = f", in {'its first' if not later else 'the'} {self.first_s:g} s{later}"
        return f"{axis}: on the model off by at most {self.max_um:.3g} um ({self.max_pct:.2g} %){part}"


OnRehearsed = Callable[[Mapping[str, Predicted]], None]
"""Is given what the rehearsal says of each axis, nothing of paths without one, before anything moves."""


class OnModel(NamedTuple):
    """A run on the model: what goes wrong there, in words, and the errors of one that goes well."""

    trouble: str | None
    errors: dict[str, Predicted]


def rehearse(
    waveforms: Mapping[str, Waveform],
    mode: str,
    stage: Stage | None,
    gains: Mapping[str, Gains],
    duration_s: float | None = None,
) -> dict[str, Predicted]:
    """Runs the paths on the model for up to 2 s, and gives the error of each axis there: their begin, or of paths that
    are sent once what asks most of the output. Nothing is done in mode open, without a model of every axis, and, with a
    warning, for models that the simulator cannot play.

    Raises BadInput when the device would end in a fault, or its output be cut in a tenth of the ticks: the reason, and
    the nearest swing and frequency that work. So it does for a path that goes beyond the slew limit anywhere.
    """
    if mode == "open" or stage is None or any(_silent(stage, axis) for axis in waveforms):
        return {}
    check_paths(waveforms, mode, stage)
    once, again = ({axis: one for axis, one in waveforms.items() if one.periodic is kind} for kind in (False, True))
    _refuse_too_fast(once, stage, mode)  # it says where
    if (unplayed := _unplayed(stage)) is not None:
        _refuse_too_fast(again, stage, mode)
        warnings.warn(f"not tried on the model first: {unplayed}", stacklevel=2)
        return {}
    with _simulated(stage) as url:
        try:
            said, errors = _run_on(url, waveforms, mode, stage, gains, duration_s)
        except (BadInput, DeviceRefused):  # the device itself will say so, of where the stage really stands
            return {}
        if said is None:
            _refuse_too_fast(again, stage, mode)
            return errors
        axis = next((name for name in waveforms if f"axis {name}" in said), next(iter(waveforms)))
        if "adc_rail" in said and (unseen := rests_unseen(stage.axes[axis])) is not None:
            raise BadInput(f"{axis}: on the model this {said}: {unseen}; or --force")

        def works(changed: Waveform) -> bool | None:
            if beyond_slew(changed.as_asked, stage.axes[axis], mode) is not None:
                return False
            try:
                return _run_on(url, {**waveforms, axis: changed}, mode, stage, gains, duration_s).trouble is None
            except (BadInput, DeviceRefused):
                return None

        found = _nearest(waveforms[axis], works)
    raise BadInput(f"{axis}: on the model this {said}; {found}; or --force")


def unlike_predicted(run: Run, predicted: Mapping[str, Predicted], stage: Stage | None) -> list[str]:
    """One line for each axis that was left by far more than the model said, and than the model left of the records it
    was fitted to. A zero that has moved is no such error; nothing is said of models that were fitted to nothing."""
    found = []
    for axis, figures in run.of_axes():
        view = stage.axes[axis].time if stage is not None and axis in predicted else None
        if view is None or not view.residual_um_rms:
            continue
        said_um, off_um = predicted[axis].max_um, figures["max_um_mean_removed"]
        if off_um > FAR_OFF * (said_um + view.residual_um_rms):
            found.append(
                f"{axis}: off by up to {off_um:.3g} um about its mean, where the model said {said_um:.3g} at most: the "
                "stage has changed, or the model is of another; `phaselead verify` of a run that is kept (-o RUN.h5) "
                "says how they differ"
            )
    return found


def trouble_on_model(
    waveforms: Mapping[str, Waveform],
    mode: str,
    stage: Stage,
    gains: Mapping[str, Gains],
    duration_s: float | None = None,
) -> str | None:
    """What goes wrong when the paths are run on the model for up to 2 s, in words; None where nothing does.

    Raises BadInput or DeviceRefused where they cannot be played there.
    """
    with _simulated(stage) as url:
        return _run_on(url, waveforms, mode, stage, gains, duration_s).trouble


@contextmanager
def _simulated(stage: Stage) -> Iterator[str]:
    """The port of a simulated stage that obeys the model."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.toml"
        virtual_stage(stage).save(path)
        yield f"sim://{path}"


def _refuse_too_fast(waveforms: Mapping[str, Waveform], stage: Stage, mode: str) -> None:
    for axis, waveform in waveforms.items():
        refuse_voltage_too_fast(axis, waveform, stage.axes[axis], mode)


def _unplayed(stage: Stage) -> str | None:
    """Why the simulator cannot play a model; None where it can."""
    try:
        plant_parameters(virtual_stage(stage), 0)
    except BadInput as error:
        return str(error)
    return None


def _silent(stage: Stage, axis: str) -> bool:
    return axis not in stage.axes or stage.axes[axis].time is None


def _run_on(
    url: str,
    waveforms: Mapping[str, Waveform],
    mode: str,
    stage: Stage,
    gains: Mapping[str, Gains],
    duration_s: float | None,
) -> OnModel:
    """Raises BadInput or DeviceRefused where it cannot be played."""
    asked_s = duration_s or default_duration_s(waveforms)
    seconds = min(asked_s, LONGEST_S)
    begin_s = hardest_s(waveforms, stage, mode, asked_s)
    waveforms = (
        {
            axis: one.part(begin_s, seconds) if isinstance(one, Streamed) and not one.periodic else one
            for axis, one in waveforms.items()
        }
        if begin_s > 0
        else waveforms
    )
    try:
        with Device.open(url) as device:
            run = track(device, waveforms, mode, stage=stage, gains=gains, duration_s=seconds, force=True)
    except DeviceFault as fault:
        return OnModel(f"ends in {str(fault).partition(' at tick')[0]}", {})
    for axis in waveforms:
        share = _cut_share(
            run.capture, axis, mode, converters(device_model(stage))[axis], stage.axes[axis].limits.slew_V_per_s
        )
        shows_a_mode = first_mode_Hz(stage.axes[axis]) is not None  # else its dead time stands for all that is fast
        if share > LIMITED_SHARE and shows_a_mode:
            return OnModel(f"{CUT} in {share:.0%} of the ticks of axis {axis}", {})
    first_s = LONGEST_S if seconds < asked_s else None
    errors = {}
    for axis, one in run.of_axes():
        share = one["max_pct"]
        wave = waveforms[axis]
        if isinstance(wave, Streamed) or (wave.periodic and first_s is not None):  # of the whole path, not of its part
            share = 100 * one["max_um"] / wave.as_asked.swing
        errors[axis] = Predicted(one["max_um"], share, one["rms_um"], first_s, begin_s)
    return OnModel(None, errors)


def hardest_s(waveforms: Mapping[str, Waveform], stage: Stage, mode: str, asked_s: float) -> float:
    """Where the 2 s begin that ask most of the output; 0 for paths that are not all sent once, and for shorter ones."""
    longest_s = min(asked_s, *(one.duration_s for one in waveforms.values()))
    if longest_s <= LONGEST_S or any(one.periodic or not isinstance(one, Streamed) for one in waveforms.values()):
        return 0.0
    asked = (hardest(one, stage.axes[axis], mode) for axis, one in waveforms.items())
    at_s = max(asked)[1]
    return float(np.clip(at_s - LONGEST_S / 2, 0.0, longest_s - LONGEST_S)) if at_s > LONGEST_S else 0.0


def _cut_share(capture: Capture, axis: str, mode: str, calibration: Converters, slew_V_per_s: float) -> float:
    """The share of the path's ticks in which the output was not what feed-forward and feedback asked for, or in which
    an inverse changed as fast as the output may, which it keeps to itself."""
    stream = capture.axes[axis]
    assert stream.dac is not None
    assert stream.feedforward is not None
    assert stream.feedback is not None
    rows = slice(*np.searchsorted(capture.ticks, [capture.start_tick, capture.end_tick]))
    asked_V = (stream.feedforward[rows].astype(np.float64) + stream.feedback[rows]) * FORWARD_STEP_V
    cut = np.abs(asked_V - calibration.u_V(stream.dac[rows])) > CUT_V
    if mode in INVERTS:
        step_V = slew_V_per_s / TICK_HZ
        ticks = math.ceil(4 * FORWARD_STEP_V / step_V)  # in which the limit is well above what is rounded off
        forward_V = stream.feedforward[rows] * FORWARD_STEP_V
        cut[ticks:] |= np.abs(forward_V[ticks:] - forward_V[:-ticks]) > ticks * step_V - FORWARD_STEP_V
    return float(np.mean(cut))


def _nearest(wave: Waveform, works: Callable[[Waveform], bool | None]) -> str:
    """The largest swing and the highest frequency that work, in words. ``works``: None where it cannot be played."""
    kept = replace(wave, asked=True) if isinstance(wave, Goto) else wave  # else all are at the usual speed
    swing = _largest_share(lambda share: works(wave.scaled(swing=share)))
    speed = _largest_share(lambda share: works(kept.scaled(time=1 / share)))
    ways = [f"a swing of up to {wave.as_asked.swing * swing:.3g} {wave.unit}"] if swing else []
    if speed:
        slower = wave.f_Hz * speed
        what = "a length" if isinstance(wave, Streamed) else "a move"
        ways.append(f"up to {slower:.3g} Hz" if wave.periodic else f"{what} of {1 / slower:.3g} s or longer")
    return f"{' or '.join(ways)} works there" if ways else "no smaller and no slower path works; choose other gains"


def _largest_share(works: Callable[[float], bool | None]) -> float:
    """Between 1/64 and 1, where 1 does not work; 0 when none does. What cannot be played is too small or too slow."""
    first = works(LEAST_SHARE)
    if first is False:
        return 0.0
    low, high, found = LEAST_SHARE, 1.0, LEAST_SHARE if first else 0.0
    for _ in range(HALVINGS):
        middle = (low * high) ** 0.5
        outcome = works(middle)
        if outcome is False:
            high = middle
        else:
            low, found = middle, middle if outcome else found
    return found
