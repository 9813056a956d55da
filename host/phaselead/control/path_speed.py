"""Paths that the output is too slow for: refused before anything moves, with how much slower they are accepted.

One rule for every kind of path. In modes that invert what the inverse asks of the output counts, once corners are
rounded; in others, and without a model, the speed of the path itself: feedback asks for what it needs to catch up.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from phaselead.control.motion_limits import PATH_ROOM, motion_limits, tells_small_signal
from phaselead.control.rounding import asked_rate, rounding_within
from phaselead.control.voltage_rate import Spans
from phaselead.errors import BadInput
from phaselead.model import TICK_S, AxisModel
from phaselead.waveforms import Curve, Sampled, Waveform

SLOWER = 1.05
"""From one try to the next, until a path is accepted; then halved down to a hundredth."""
MOST_TRIES = 200
"""To some 17,000 times as slow."""
ABOUT_s = 0.1
"""To either side of the hardest places of a path, where slower ones are tried before the whole is."""

RefusedAt = Callable[[Waveform, Spans | None], float | None]
"""Where a path is refused, s from its start, looked for within these parts alone (None: all of it); None: it is not."""


def refuse_path_too_fast(axis: str, path: Waveform, model: AxisModel, mode: str = "pid") -> None:
    """Raises BadInput for a path in micrometres that goes faster over a tick than the whole slew limit of the output
    moves the stage; without a model that is taken to go through all that its sensor sees in all that its output does.

    What an inverse follows all the same, as near a mode, is not refused in modes with one; nor, on a stage that is
    known, is what a sine of the same swing and frequency would be too fast for as well: a rehearsal tells more of it.
    Moves have limits of their own, and a square is there for what comes of its edges.
    """
    found = beyond_speed(path, model, mode)
    if found is None:
        return
    rate, at_s, able = found

    def refused_at(tried: Waveform, spans_s: Spans | None) -> float | None:
        fastest, tried_at_s = tried.fastest(TICK_S)
        return tried_at_s if fastest > PATH_ROOM * able else _slew_refused_at(tried, model, mode, spans_s)

    where = "" if path.periodic else f" at {at_s:.4g} s"
    guess = "" if tells_small_signal(model) else ", as far as is known without --model STAGE.toml"
    raise BadInput(
        f"{axis}: it goes at {rate:.0f} um/s{where}; with the output's {model.limits.slew_V_per_s:g} V/s the stage "
        f"does {able:.0f} um/s{guess}; {_slower(path, refused_at)}"
    )


def refuse_voltage_too_fast(axis: str, path: Waveform, model: AxisModel, mode: str) -> None:
    """Raises BadInput for a path whose corners, rounded as far as they are, still ask more of the output than its slew
    limit: it would be cut, and ring the stage."""
    asked = path.as_asked
    found = beyond_slew(asked, model, mode)
    if found is None:
        return
    rate, at_s = found
    where = "" if asked.periodic else f" at {at_s:.4g} s"
    slower = _slower(asked, lambda tried, spans_s: _slew_refused_at(tried, model, mode, spans_s))
    raise BadInput(
        f"{axis}: on the model its corners ask for {rate:.0f} V/s{where}, the output does "
        f"{model.limits.slew_V_per_s:g} V/s, and rounding them does not help; {slower}; or --force"
    )


def beyond_speed(path: Waveform, model: AxisModel, mode: str) -> tuple[float, float, float] | None:
    """The largest speed over a tick, um/s, where that is, s from the start, and what the stage does, where that is
    less."""
    if path.unit == "V" or path.jumps or path.played_as == "move":
        return None
    known = tells_small_signal(model)
    able = motion_limits(model).velocity_um_per_s if known else _nominal_um_per_s(model)
    rate, at_s = path.fastest(TICK_S)
    if rate <= able or (known and _too_fast_as_a_sine(path, able)) or _followed_sharp(path, model, mode):
        return None
    return rate, at_s, able


def _too_fast_as_a_sine(path: Waveform, able_um_per_s: float) -> bool:
    """Whether a sine of the same swing and frequency is too fast as well: who asks for that on a stage that is known
    asks for what a rehearsal tells more of."""
    return path.periodic and math.pi * abs(path.swing) * path.f_Hz > able_um_per_s


def beyond_slew(
    path: Waveform, model: AxisModel, mode: str, share: float = 1.0, spans_s: Spans | None = None
) -> tuple[float, float] | None:
    """The largest rate of the voltage, V/s, that the inverse asks for along the path as it is played, and where, s
    from its start, if that is beyond a share of the slew limit. Of a path of rows within ``spans_s`` alone."""
    rate = asked_rate(model, path, mode, spans_s)
    if rate is None:
        return None
    return rate.beyond(share * model.limits.slew_V_per_s, rounding_within(rate, model, path))


def _slew_refused_at(path: Waveform, model: AxisModel, mode: str, spans_s: Spans | None) -> float | None:
    found = beyond_slew(path, model, mode, PATH_ROOM, spans_s)
    return None if found is None else found[1]


def hardest(path: Waveform, model: AxisModel, mode: str) -> tuple[float, float]:
    """Of a path that is sent once: the largest share of the slew limit that it asks for, in modes that invert as it is
    played, in others of what its speed asks for, and where, s from its start."""
    rate = asked_rate(model, path.as_asked, mode)
    if rate is None:
        fastest, at_s = path.fastest(TICK_S)
        return fastest / motion_limits(model).velocity_um_per_s, at_s
    rounded_s = rounding_within(rate, model, path.as_asked)
    found, at_s = max(rate.within(block, rounded_s) for block in rate.blocks)
    return found / model.limits.slew_V_per_s, at_s


def _followed_sharp(path: Waveform, model: AxisModel, mode: str) -> bool:
    """Whether the inverse follows it as it was written."""
    rate = asked_rate(model, path, mode)
    return rate is not None and rate.beyond(model.limits.slew_V_per_s, 0.0) is None


def _nominal_um_per_s(model: AxisModel) -> float:
    sensor, limits = model.sensor, model.limits
    return limits.slew_V_per_s * (sensor.x_max_um - sensor.x_min_um) / (limits.u_max_V - limits.u_min_V)


def _slower(path: Waveform, refused_at: RefusedAt) -> str:
    """How much slower it is accepted, in words."""
    times = times_slower(path, refused_at)
    if times is None:
        return "lower its swing" if path.periodic else "let it take longer there"
    if not path.periodic:
        return f"let it take longer there, or {times:g} times as long as a whole ({times * path.duration_s:.4g} s)"
    at = "" if isinstance(path, Curve) else f" (at {path.f_Hz / times:.3g} Hz)"
    longer = "let its steepest part take longer, or " if isinstance(path, Sampled) else ""
    return f"{longer}lower swing or frequency: {times:g} times as slow{at} it works"


def times_slower(path: Waveform, refused_at: RefusedAt) -> float | None:
    """The least of those tried that is accepted, to three digits; None where none is.

    Tried is what lies about the hardest places, which may be little of a long path; then the whole, once, and if that
    is refused elsewhere that place counts too from there on.
    """
    spans_s: list[tuple[float, float]] = []
    times, at_s = 1.0, refused_at(path, None)
    while at_s is not None:
        spans_s.append((max(at_s / times - ABOUT_s, 0.0), at_s / times + ABOUT_s))
        more = _more_times(path, times, refused_at, spans_s)
        if more is None:
            return None
        times, at_s = more, refused_at(path.scaled(time=more), None)
    return times


def _more_times(path: Waveform, refused: float, refused_at: RefusedAt, spans_s: Spans) -> float | None:
    """The least above ``refused`` with which these parts of the path are accepted."""

    def accepted(times: float) -> bool:
        scaled = [(begin_s * times, end_s * times) for begin_s, end_s in spans_s]
        return refused_at(path.scaled(time=times), scaled) is None

    found = refused
    for _ in range(MOST_TRIES):
        found = _three_digits(found * SLOWER)
        if accepted(found):
            break
        refused = found
    else:
        return None
    while (middle := _three_digits(math.sqrt(refused * found))) < found and found > 1.01 * refused:
        refused, found = (refused, middle) if accepted(middle) else (middle, found)
    return found


def _three_digits(value: float) -> float:
    """Rounded up."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 2)
    return float(f"{math.ceil(value / unit - 1e-9) * unit:.3g}")
