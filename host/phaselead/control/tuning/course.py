"""Measure, shape, and measure again: what ``phaselead tune`` does."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from phaselead.control.feedback_loop import goes_round_0, local_gains, pid_response, plant_response
from phaselead.control.gains import MODE_SHIFT, PEAK_SENSITIVITY, WARN_ABOVE
from phaselead.control.held import held_stage
from phaselead.control.kept_runs import KeptRuns
from phaselead.control.motion_limits import PATH_ROOM, rests_unseen
from phaselead.control.tuning.closed_check import refuse_closed
from phaselead.control.tuning.excitation import Grid, multisine
from phaselead.control.tuning.measured_model import with_modes
from phaselead.control.tuning.plant import FittedPlant, fit_plant, rings_elsewhere
from phaselead.control.tuning.rehearsed import refuse_rehearsed
from phaselead.control.tuning.response import REALISATIONS, Measured, Plan, measure
from phaselead.control.tuning.result import ClosedLoop, Tuned
from phaselead.control.tuning.shaping import GAIN_SHARE, Range, predicted, shape
from phaselead.device import Device, inverse_refusal
from phaselead.errors import BadInput
from phaselead.model import (
    TICK_S,
    AxisModel,
    Gains,
    SmallSignal,
    Stage,
    compensation,
    provenance_of,
    small_signal,
)
from phaselead.sim import data_sheet

FINE = Plan(Grid.odd_random(8192, 290.0), settle_periods=1, periods=4)
"""Lines 1.2 Hz apart: three across a mode of 100 Hz with a damping of 0.02."""
FAST = Plan(Grid.odd_random(1024, 2250.0), settle_periods=8, periods=32)
CLOSED = Plan(Grid.odd_random(2048, 1000.0), settle_periods=4, periods=12)
LEVEL_SHARE = 1 / 60
"""Of the voltages allowed, peak-to-peak: 0.2 V of 12. A mode with a Q of 25 then moves some micrometres."""
WITHOUT_TIME_VIEW = (0.7, 1.7)
"""Local gain against that of small motions, where no time view tells: loops a fifth as wide as high, as piezo stacks
have them, are half as steep after a turn as on the way (Xu and Li 2010, figure 2)."""
ROOM = 0.5
"""Of the slew limit, for the path of the closed measurement."""
NOISE_ROOM, CREST = 1 - PATH_ROOM, 4.0
"""Of the slew limit, for noise, and noise by its rms: beyond it in one tick of 16,000."""
RATCHET = 0.16
"""Of the way that noise in the output would make if all of the hysteresis followed it: what the built-in stage went
along 60 um at 5 Hz, rms. There the plays follow the peaks of the noise, which no mode keeps from the position then."""
SHARES = (0.3, 0.45, 0.8, 1.0)
"""Progress after each part."""

Progress = Callable[[float], None]


def tune(
    device: Device,
    axis: str = "x",
    *,
    stage: Stage | None = None,
    level_V: float | None = None,
    middle_V: float | None = None,
    peak: float = PEAK_SENSITIVITY,
    mode_shift: float = MODE_SHIFT,
    gain_share: float = GAIN_SHARE,
    kept: KeptRuns | None = None,
    on_progress: Progress | None = None,
) -> Tuned:
    """Measures the response of one axis in open loop, shapes PID and filters on it, and measures the closed loop.

    ``level_V`` is the peak-to-peak of the multisine, ``middle_V`` what it is about: the middle of the limits. The loop
    is shaped for a peak sensitivity of ``peak`` with modes ``mode_shift`` and gains ``gain_share`` up and down, and
    over the local gains of the stage's time view. ``kept`` takes the runs.

    Raises:
        BadInput: nothing has moved: a level outside limits. No loop was closed: no coherence, a response that is none
            of modes, no loop with the margin. Or the loop that was closed has a peak sensitivity above 3, or could not
            be measured. Or the stage stands, at ``middle_V``, where its model never does.
        DeviceFault: the device latched one on the way.
    """
    told = on_progress or (lambda share: None)
    _refuse(peak, mode_shift, gain_share)
    parent = stage if stage is not None else _known(device, axis)
    limits = parent.axis(axis).limits
    usual_V = LEVEL_SHARE * (limits.u_max_V - limits.u_min_V)
    level_V = usual_V if level_V is None else level_V
    if not level_V > 0:
        raise BadInput(f"a level of {level_V:g} V: give one above 0; {usual_V:g} V is usual")
    _refuse_too_steep(axis, level_V, limits.slew_V_per_s)
    middle_V = (limits.u_min_V + limits.u_max_V) / 2 if middle_V is None else middle_V
    measured = _open_response(device, axis, parent, level_V, middle_V, kept, told)
    _refuse_elsewhere(axis, measured.middle_um, middle_V, parent.axis(axis))
    fitted = _fitted(axis, measured, parent)
    local = local_range(parent.axis(axis), fitted.gain_um_per_V, gain_share)
    over = Range(local, mode_shift, peak, most_rate_V_per_um(parent.axis(axis)), most_V_per_um(local))
    first, last = SHARES[1], SHARES[2]
    gains = shape(fitted.plant, over, lambda done: told(first + (last - first) * done))
    _refuse_measured(measured, fitted, gains, over)
    middle = middle_V, measured.middle_um
    swing_um = min(level_V * fitted.gain_um_per_V / 2, widest_swing_um(fitted.plant, gains, over, limits.slew_V_per_s))
    swing_um = round(swing_um * 2**16) / 2**16
    path = multisine(CLOSED.grid, swing_um, measured.middle_um, "um", 0)
    refuse_rehearsed(axis, parent.axis(axis), fitted, over.gain_um_per_V[1], middle, gains, {axis: path})
    closed = measure(
        device,
        axis,
        CLOSED,
        swing=swing_um,
        middle=measured.middle_um,
        stage=parent,
        gains=gains,
        name="closed",
        kept=kept,
        on_progress=lambda done: told(last + (1 - last) * done),
    )
    loop = ClosedLoop(closed)
    refuse_closed(axis, loop, fitted, gains, level_V=level_V, usual_V=usual_V)
    measured_only = replace(over, gain_um_per_V=fitted.plant.gain_um_per_V, mode_shift=0.0)
    return Tuned(
        axis=axis,
        model=_with(parent, axis, fitted, gains),
        measured=measured,
        plant=fitted,
        over=over,
        predicted=predicted(fitted.plant, gains, over),
        expected=predicted(fitted.plant, gains, measured_only),
        closed=loop,
    )


def most_rate_V_per_um(model: AxisModel) -> float:
    """So that the sensor's noise, or its code, takes no more than an eighth of the slew limit."""
    sensor = model.sensor
    code_um = (sensor.x_max_um - sensor.x_min_um) / 2**sensor.bits
    noise_um = max(sensor.noise_um_rms, code_um / math.sqrt(12))
    return float(NOISE_ROOM * model.limits.slew_V_per_s * TICK_S / (CREST * noise_um))


def most_V_per_um(local_um_per_V: tuple[float, float]) -> float:
    """So that the sensor's noise moves the stage through its hysteresis by no more than itself."""
    low, high = local_um_per_V
    return 1 / (RATCHET * (high - low))


def widest_swing_um(plant: SmallSignal, gains: Gains, over: Range, slew_V_per_s: float) -> float:
    """Of the multisine in the reference: the output is to change by no more than half of the slew limit for it."""
    period = multisine(CLOSED.grid, 1.0, 0.0, "um", 0).period
    turns = np.arange(CLOSED.grid.ticks) / CLOSED.grid.ticks
    played = np.interp(turns, np.arange(len(period) + 1) / len(period), [*period, period[0]])
    f_Hz = CLOSED.grid.frequencies(np.arange(1, CLOSED.grid.ticks // 2 + 1))
    loop = over.gains()[:, None] * plant_response(plant, f_Hz) * pid_response(gains, f_Hz)
    rate = pid_response(gains, f_Hz) * (1 - np.exp(-2j * np.pi * f_Hz * TICK_S)) / (1 + loop)
    spectrum = np.concatenate([np.zeros((len(loop), 1)), np.fft.rfft(played)[1:] * rate], axis=1)
    change_V = float(np.abs(np.fft.irfft(spectrum)).max())
    return ROOM * slew_V_per_s * TICK_S / change_V


def _refuse(peak: float, mode_shift: float, gain_share: float) -> None:
    if not 1.2 <= peak <= WARN_ABOVE:
        raise BadInput(f"a peak sensitivity of {peak:g}: choose 1.2 to {WARN_ABOVE:g}; 1.4 to 2 is usual")
    for name, share in (("modes", mode_shift), ("gains", gain_share)):
        if not 0 <= share <= 0.5:
            raise BadInput(f"{name} {100 * share:g} % up and down: choose 0 to 50 %")


def _refuse_too_steep(axis: str, level_V: float, slew_V_per_s: float) -> None:
    waves = (multisine(plan.grid, 1.0, 0.0, "V", seed) for plan in (FINE, FAST) for seed in range(REALISATIONS))
    steepest_per_s = max(wave.steepest() for wave in waves)
    if level_V * steepest_per_s > slew_V_per_s:
        raise BadInput(
            f"{axis}: a level of {level_V:g} V needs {level_V * steepest_per_s:.4g} V/s, the slew limit is "
            f"{slew_V_per_s:g} V/s; choose a --level of up to {math.floor(1e3 * slew_V_per_s / steepest_per_s):g} mV"
        )


def _refuse_elsewhere(axis: str, at_um: float, middle_V: float, model: AxisModel) -> None:
    """Where the stage stands nowhere that the model has it stand, whatever was before."""
    if inverse_refusal(model, axis) is not None or rests_unseen(model) is not None:
        return
    low_um, high_um = compensation(model).reach_um
    if not low_um <= at_um <= high_um:
        raise BadInput(
            f"{axis}: at {middle_V:g} V the stage stands at {at_um:.4g} um, where the model says {low_um:.4g} to "
            f"{high_um:.4g} um over its whole range: it is the model of another stage, or the zero has moved; "
            "`phaselead identify` makes one of this stage"
        )


def _known(device: Device, axis: str) -> Stage:
    """What is known of the stage without a stage file: the model that the device holds, or a data sheet."""
    held = held_stage(device)
    found = held if held is not None and axis in held.axes else data_sheet(device.session.name)
    if found is None:
        raise BadInput("tuning needs limits and calibration: --model STAGE.toml (`phaselead identify` makes one)")
    return found.model_copy(update={"name": "tuned"})


def _open_response(
    device: Device, axis: str, stage: Stage, level_V: float, middle_V: float, kept: KeptRuns | None, told: Progress
) -> Measured:
    first, second = SHARES[0], SHARES[1]
    fine = measure(
        device,
        axis,
        FINE,
        swing=level_V,
        middle=middle_V,
        stage=stage,
        name="open-fine",
        kept=kept,
        on_progress=lambda done: told(first * done),
    )
    fast = measure(
        device,
        axis,
        FAST,
        swing=level_V,
        middle=middle_V,
        stage=stage,
        name="open-fast",
        kept=kept,
        on_progress=lambda done: told(first + (second - first) * done),
    )
    return fine.joined(fast)


def _fitted(axis: str, measured: Measured, stage: Stage) -> FittedPlant:
    """The plant behind the lines. Warns where they are not those of the stage file's axis; raises BadInput as
    ``fit_plant``, and names that first."""
    sure = measured.reliable()
    f_Hz, gain = measured.f_Hz[sure], measured.gain[sure]
    known = _known_plant(stage, axis)
    elsewhere = None if known is None else rings_elsewhere(f_Hz, gain, known)
    try:
        fitted = fit_plant(f_Hz, gain, measured.deviation[sure])
    except BadInput as error:
        raise BadInput(f"{axis}: {elsewhere}" if elsewhere else str(error)) from None
    if elsewhere:
        warnings.warn(f"{axis}: {elsewhere}", stacklevel=4)
    return fitted


def _known_plant(stage: Stage, axis: str) -> SmallSignal | None:
    """What the stage file says of the axis; None where it does not tell."""
    try:
        return small_signal(stage.axis(axis))
    except BadInput:
        return None


def local_range(model: AxisModel, gain_um_per_V: float, share: float) -> tuple[float, float]:
    """Local gains in um/V that a loop meets: those of the time view, and the measured one ``share`` up and down."""
    low, high = (1 - share) * gain_um_per_V, (1 + share) * gain_um_per_V
    if model.time is None:
        return min(low, WITHOUT_TIME_VIEW[0] * gain_um_per_V), max(high, WITHOUT_TIME_VIEW[1] * gain_um_per_V)
    lowest, _, highest = map(float, local_gains(small_signal(model)))
    return min(low, lowest), max(high, highest)


def _refuse_measured(measured: Measured, fitted: FittedPlant, gains: Gains, over: Range) -> None:
    """Where the loop on the measured lines themselves is nearer to -1 than the plant behind them says, or around it."""
    sure = measured.reliable()
    f_Hz, gain = measured.f_Hz[sure], measured.gain[sure] / fitted.gain_um_per_V
    rows = over.gains()[:, None] * gain * pid_response(gains, f_Hz)
    planned = over.gains()[:, None] * plant_response(fitted.plant, f_Hz) * pid_response(gains, f_Hz)
    beside = (1 + rows) / (1 + planned)
    if any(goes_round_0(row) for row in beside):
        off_Hz = float(f_Hz[np.argmax(np.abs(beside - 1).max(axis=0))])
        raise BadInput(
            f"the loop is not stable on the response that was measured, which at {off_Hz:.4g} Hz is not that of its "
            "modes; measure with a higher --level"
        )
    peaks = [float((1 / np.abs(1 + each)).max()) for each in (rows, planned)]
    if peaks[0] > max(WARN_ABOVE, 1.25 * peaks[1]):
        worst = float(f_Hz[np.argmax((1 / np.abs(1 + rows)).max(axis=0))])
        raise BadInput(
            f"the loop has no margin at {worst:.4g} Hz, where the measured response is not that of its modes (peak "
            f"sensitivity {peaks[0]:.2g} there); measure with a higher --level"
        )


def _with(stage: Stage, axis: str, fitted: FittedPlant, gains: Gains) -> Stage:
    """The stage with these gains, made from the one before."""
    known = with_modes(stage.axes.get(axis, AxisModel()), fitted.plant)
    axes = {**stage.axes, axis: known.model_copy(update={"gains": gains})}
    origin = provenance_of(stage, []).model_copy(update={"data": stage.provenance.data})
    return stage.model_copy(update={"axes": axes, "provenance": origin})
