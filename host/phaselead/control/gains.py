"""PID gains: designed for a model, the paper's, or three numbers; and what a model says of them beforehand."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np

from phaselead.control.feedback_loop import (
    Loop,
    frequencies,
    local_gains,
    loop_of,
    peak_sensitivity,
    pid_response,
    plant_response,
)
from phaselead.control.modes import HAS_FEEDBACK
from phaselead.errors import BadInput
from phaselead.model import AxisModel, Gains, SmallSignal, Stage, small_signal

# Xu & Li 2010, section V. Unfiltered derivative: the stability of the loop hangs on it.
PAPER_GAINS = Gains(kp_V_per_um=0.017, ki_V_per_um_s=8.62, kd_V_s_per_um=2.33e-5, derivative_filter_Hz=None)

PEAK_SENSITIVITY = 2.0
"""Of a design: Astrom and Hagglund 2006, Advanced PID Control, section 4.6, recommend 1.4 to 2.0."""
MODE_SHIFT = 0.1
"""Of a mode's frequency, up and down: a sample of a fifth of the moving mass moves it so far."""
WARN_ABOVE, REFUSE_ABOVE = 3.0, 6.0
"""Peak sensitivity of the model's loop: the modulus margin is then 1/3 and 1/6."""
DESIGNED = "designed for"
"""How the origin of designed gains begins, in a stage file as well."""
UNSEEN_MODE = (1.0, 100.0, 0.02)
"""Share, Hz, damping: where a model shows no mode the loop is made for one anywhere above. Flexure stages that move
100 um and more have their first between 100 and 1000 Hz, damped 0.01-0.05 (Devasia, Eleftheriou and Moheimani 2007)."""
DERIVATIVES = 96
"""Values of Kd that are tried, in equal ratios over three and a half decades."""

GainsLike = str | Gains | tuple[float, float, float]
"""``"paper"``, ``"KP,KI,KD"`` or three numbers in V/um, V/(um s), V s/um, or ``Gains``."""


def gains_of(given: GainsLike | Mapping[str, GainsLike] | None, stage: Stage | None, axis: str) -> Gains:
    """The gains of one axis as they may be given from Python. Raises BadInput."""
    if isinstance(given, Mapping) and (strangers := sorted(set(given) - set("xyz"))):
        raise BadInput(f"gains for axis {strangers[0]}: there are x, y and z")
    own = given.get(axis) if isinstance(given, Mapping) else given
    if isinstance(own, Gains):
        return own
    if isinstance(own, tuple | list):
        own = ",".join(repr(float(number)) for number in own)
    return parse_gains(own, stage, axis)


def gains_in_mode(
    mode: str, given: GainsLike | Mapping[str, GainsLike] | None, stage: Stage | None, axis: str
) -> Gains:
    """``gains_of``; of a mode without feedback, which uses none, zeros where none can be designed."""
    try:
        return gains_of(given, stage, axis)
    except BadInput:
        if given is not None or mode in HAS_FEEDBACK:
            raise
    return Gains(kp_V_per_um=0.0, ki_V_per_um_s=0.0, kd_V_s_per_um=0.0)


def parse_gains(text: str | None, stage: Stage | None, axis: str) -> Gains:
    """Gains for one axis: "paper"; "KP,KI,KD" in V/um, V/(um s), V s/um; None: the stage file's, else those designed
    for its model. The paper's where nothing is known of the axis: no stage file, or one without a time view of it.

    Raises BadInput on anything else.
    """
    if text is None:
        model = stage.axes.get(axis) if stage is not None else None
        if model is None or (model.gains is None and model.time is None):
            return PAPER_GAINS
        return model.gains or design_gains(axis, model)
    if text == "paper":
        return PAPER_GAINS
    try:
        kp, ki, kd = (float(part) for part in text.split(","))
    except ValueError:
        raise BadInput(
            f"gains {text!r}: write paper, or KP,KI,KD in V/um, V/(um s), V s/um, e.g. 0.017,8.62,2.33e-5"
        ) from None
    if not all(math.isfinite(gain) and gain >= 0 for gain in (kp, ki, kd)):
        raise BadInput(
            f"gains {text!r}: they must be finite and not negative; the loop's sign is fixed in the firmware"
        )
    return Gains(kp_V_per_um=kp, ki_V_per_um_s=ki, kd_V_s_per_um=kd, derivative_filter_Hz=None)


def design_gains(axis: str, model: AxisModel) -> Gains:
    """The largest integral gain, with the derivative that allows it, whose peak sensitivity is at most 2 at every local
    gain of the model and with its modes 10 % up and down (Astrom, Panagopoulos and Hagglund 1998, Automatica 34, 585).

    A model that shows no mode gets an integrator alone, for a mode anywhere above 100 Hz. Raises BadInput for a model
    without a time view, or whose position falls with the voltage.
    """
    try:
        plant = small_signal(model)
    except BadInput as error:
        raise BadInput(f"{axis}: no gains can be designed: {error}") from None
    return _designed(plant)


def are_designed(gains: Gains) -> bool:
    """Whether they come from ``design_gains``: neither chosen nor tuned."""
    return (gains.origin or "").startswith(DESIGNED)


@lru_cache(maxsize=64)
def _designed(plant: SmallSignal) -> Gains:
    known = bool(plant.modes)
    peak = _peak(plant if known else replace(plant, modes=(UNSEEN_MODE,)))
    # Scales: an integrator of a turn a second, a derivative that reaches unity at the first mode.
    highest = local_gains(plant)[-1]
    slowest_Hz = min((f for _, f, _ in plant.modes), default=UNSEEN_MODE[1])
    unity_kd = 1 / (highest * 2 * math.pi * slowest_Hz)
    most_ki = 2 * math.pi * slowest_Hz / highest
    derivatives = [0.0, *(unity_kd * np.geomspace(1e-3, 3.0, DERIVATIVES))] if known else [0.0]
    best = max((_largest_ki(peak, kd, most_ki), kd) for kd in derivatives)
    ki, kd = (float(f"{value:.4g}") for value in best)
    low, high = plant.gain_um_per_V
    ranges = f"local gains of {low:.3g} to {high:.3g} um/V, "
    ranges += "modes +-10 %" if known else f"no mode is known: one anywhere above {UNSEEN_MODE[1]:g} Hz"
    origin = f"{DESIGNED} peak sensitivity {PEAK_SENSITIVITY:.1f} ({ranges})"
    return Gains(kp_V_per_um=0.0, ki_V_per_um_s=ki, kd_V_s_per_um=kd, derivative_filter_Hz=None, origin=origin)


def _peak(plant: SmallSignal) -> Callable[[float, float], float]:
    """Peak sensitivity as a function of Ki and Kd, over all that the design is for."""
    cases = []
    for factor in (1 - MODE_SHIFT, 1.0, 1 + MODE_SHIFT):
        moved = plant.with_modes_at(factor)
        f_Hz = frequencies(moved)
        response = local_gains(moved)[:, None] * plant_response(moved, f_Hz)
        unit = [Gains(kp_V_per_um=0.0, ki_V_per_um_s=i, kd_V_s_per_um=d) for i, d in ((1.0, 0.0), (0.0, 1.0))]
        cases.append([response * pid_response(one, f_Hz) for one in unit])
    return lambda ki, kd: max(peak_sensitivity(ki * integral + kd * derivative) for integral, derivative in cases)


def _largest_ki(peak: Callable[[float, float], float], kd: float, most: float) -> float:
    """The largest Ki up to ``most`` with an allowed peak, to 1/1000 of ``most``; 0 when there is none."""
    low, high = 0.0, most
    if peak(most / 1000, kd) > PEAK_SENSITIVITY:
        return 0.0
    while high - low > most / 1000:
        middle = (low + high) / 2
        low, high = (middle, high) if peak(middle, kd) <= PEAK_SENSITIVITY else (low, middle)
    return low


def with_gains(stage: Stage) -> Stage:
    """The stage with gains designed for every axis that shows a mode; an axis whose gains were chosen, or measured by
    ``tune``, keeps them."""
    axes = {name: _with_gains(name, model) for name, model in stage.axes.items()}
    return stage if axes == stage.axes else stage.model_copy(update={"axes": axes})


def _with_gains(axis: str, model: AxisModel) -> AxisModel:
    if model.gains is not None and not are_designed(model.gains):
        return model
    try:
        known = bool(small_signal(model).modes)
    except BadInput:
        known = False
    return model.model_copy(update={"gains": design_gains(axis, model) if known else None})


def describe_gains(stage: Stage) -> list[str]:
    """One line for each axis with gains of its own: what they are, what for, and what the loop on the model is."""
    found = []
    for name, model in stage.axes.items():
        if model.gains is not None:
            g = model.gains
            low, _, high = loop_of(name, model, g).bandwidth_Hz
            said = f"axis {name}: gains {g.kp_V_per_um:g},{g.ki_V_per_um_s:g},{g.kd_V_s_per_um:g}"
            found.append(f"{said} {g.origin or 'as given'}; bandwidth {low:.3g} to {high:.3g} Hz")
    return found


def describe_unseen(stage: Stage, highest_Hz: float) -> list[str]:
    """What the designed gains do not know: modes above ``highest_Hz``, the fastest sine of the experiment."""
    axes = [name for name, model in stage.axes.items() if model.gains is not None and model.gains.origin is not None]
    if not axes:
        return []
    return [
        f"axis {', '.join(axes)}: driven up to {highest_Hz:g} Hz, where faster modes hardly show, and the gains have "
        "no margin for one that does not; `phaselead tune` measures them"
    ]


def lacking_gains(stage: Stage) -> list[str]:
    """One line for each axis without gains of its own, and what makes some."""
    return [f"axis {name}: no gains, since {_why_none(m)}" for name, m in stage.axes.items() if m.gains is None]


def _why_none(model: AxisModel) -> str:
    try:
        small_signal(model)
    except BadInput as error:
        return str(error)
    return "the records show no mode to design them for: `phaselead tune` measures some"


def check_loop(axis: str, model: AxisModel, gains: Gains, *, force: bool = False) -> str | None:
    """What the model says against the gains: a warning above a peak sensitivity of 3, or None.

    Raises BadInput above 6 unless ``force``. A model without a time view, or one that shows no mode, says nothing: its
    dead time alone stands for all that is fast.
    """
    try:
        found = loop_of(axis, model, gains)
    except BadInput:
        return None
    if not found.plant.modes or found.peak_sensitivity <= WARN_ABOVE:
        return None
    if found.peak_sensitivity > REFUSE_ABOVE and not force:
        what = "is not stable" if not found.stable else f"has a peak sensitivity of {found.peak_sensitivity:.2g}"
        other = (
            f"take gains out of the stage file ([axes.{axis}.gains])" if gains == model.gains else "leave out --gains"
        )
        raise BadInput(
            f"{axis}: the loop on the model {what} ({found.reason()}); {other} for those designed for the model "
            f"({_written(design_gains(axis, model))}), or --force"
        )
    return _warning(found)


def own_loop_warnings(stage: Stage, *, force: bool = False) -> list[str]:
    """What the stage says against the gains of its own. Raises BadInput as ``check_loop`` does."""
    own = ((name, model, model.gains) for name, model in stage.axes.items() if model.gains is not None)
    found = (check_loop(name, model, gains, force=force) for name, model, gains in own)
    return [line for line in found if line is not None]


def _warning(found: Loop) -> str:
    what = f"has a peak sensitivity of {found.peak_sensitivity:.2g}" if found.stable else "is not stable"
    return f"{found.axis}: the loop on the model {what} ({found.reason()})"


def _written(gains: Gains) -> str:
    return f"{gains.kp_V_per_um:g},{gains.ki_V_per_um_s:g},{gains.kd_V_s_per_um:g}"
