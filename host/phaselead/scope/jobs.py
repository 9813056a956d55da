"""What takes minutes and is started from the page: each an entry of ``JOBS``, which the page lists."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import PurePath
from typing import Any

from phaselead.errors import BadInput, DeviceRefused
from phaselead.record import gather, write_text
from phaselead.scope.hub import Hub, Order

Arguments = Mapping[str, Any]


@dataclass(frozen=True)
class Field:
    """What the page asks for before a job."""

    name: str
    label: str
    default: str
    hint: str = ""


@dataclass(frozen=True)
class Job:
    """A job as the page lists it."""

    run: Order
    title: str
    what: str
    fields: tuple[Field, ...]


def _given(job: Job, given: Arguments) -> dict[str, str]:
    values = {field.name: given.get(field.name, field.default) for field in job.fields}
    for name, value in values.items():
        if not isinstance(value, str):
            raise BadInput(f"{name}: {value!r} is no text")
    return {name: value.strip() for name, value in values.items()}


def _number(name: str, value: str) -> float | None:
    try:
        found = float(value) if value else None
    except ValueError:
        found = math.nan
    if found is not None and not math.isfinite(found):
        raise BadInput(f"{name}: {value!r} is no number")
    return found


def _stamp() -> str:
    return f"{datetime.now():%Y%m%d-%H%M%S}"


def _page(hub: Hub, name: str, result: Any, *words: str) -> str:
    """Writes the page of a result, which says by which command it is made again; gives where it is."""
    from phaselead.report import made_by, result_page  # slow to load, needed here only

    path = hub.folder / name
    with made_by(shlex.join(["phaselead", *filter(None, words), "--port", hub.port, "--report", name])):
        write_text(str(path), result_page(result))
    hub.new_file(name)
    return f"page {path}"


def _at_rest(hub: Hub) -> None:
    if hub.dev.where().state != "parked":
        hub.dev.park()


def identify(hub: Hub, given: Arguments) -> str:
    """Drives in volts, fits, uploads the model; keeps the stage file."""
    values, stamp = _given(JOBS["identify"], given), _stamp()
    axes, name = values["axes"] or "x", f"stage-{stamp}.toml"
    u_max, duration = _number("largest voltage", values["u_max"]), _number("duration", values["duration"])
    _at_rest(hub)
    with hub.working("identify"):
        found = hub.dev.identify(axes, model=hub.stage, u_max=u_max, duration=duration, on_progress=hub.progress)
        found.model.save(hub.new_file(name))
        hub.dev.upload(found.model)
        hub.stage = found.model
        asked = [f"--u-max={u_max:g}V" if u_max else "", f"--duration={duration:g}s" if duration else ""]
        page = _page(hub, f"identify-{stamp}.html", found, "identify", "--axis", axes, *asked, "-o", name)
    return f"identified {axes} and uploaded; the model is in {hub.folder / name}, {page}"


def learn(hub: Hub, given: Arguments) -> str:
    """Trials along a periodic path, each corrected by the error that repeats."""
    values, stamp = _given(JOBS["learn"], given), _stamp()
    trials, wave, name = int(_number("trials", values["trials"]) or 0), values["wave"], f"learned-{stamp}.h5"
    _at_rest(hub)
    with hub.working("learn"):
        found = hub.dev.learn(wave, model=hub.stage, trials=trials, on_progress=hub.progress)
        found.save(hub.new_file(name))
        page = _page(hub, f"learned-{stamp}.html", found, "learn", wave, f"--trials={trials}", "-o", name)
        if found.in_fault:
            raise DeviceRefused(f"{found.reason}; what was learned before is in {hub.folder / name}, {page}")
    before, after = found.trials[0].rms_um, found.best.rms_um
    said = (f"{axis} from {before[axis]:.3g} to {after[axis]:.3g} um rms" for axis in before)
    return f"learned {wave}: {', '.join(said)}; {found.reason}; kept in {hub.folder / name}, {page}"


def tune(hub: Hub, given: Arguments) -> str:
    """Measures the response of an axis, shapes a loop on it, measures that, and uploads the model with its gains."""
    values, stamp = _given(JOBS["tune"], given), _stamp()
    axis, name = values["axis"] or "x", f"tuned-{stamp}.toml"
    peak, level = _number("peak sensitivity", values["peak"]), _number("voltage", values["level"])
    options: dict[str, Any] = {} if peak is None else {"peak": peak}
    _at_rest(hub)
    with hub.working("tune"):
        found = hub.dev.tune(axis, model=hub.stage, level=level, on_progress=hub.progress, **options)
        found.save(hub.new_file(name))
        hub.dev.upload(found.model)
        hub.stage = found.model
        asked = [f"--level={level:g}V" if level else "", f"--peak={peak:g}" if peak else ""]
        page = _page(hub, f"tuned-{stamp}.html", found, "tune", "--axis", axis, *asked, "-o", name)
    return (
        f"tuned {found.axis}: bandwidth {found.closed.bandwidth_Hz:.0f} Hz, peak sensitivity "
        f"{found.closed.peak_sensitivity:.2f}, both measured; uploaded; the model is in {hub.folder / name}, {page}"
    )


def gap(hub: Hub, given: Arguments) -> str:
    """Where model and saved recordings disagree, and what is missing."""
    from phaselead.gap import run_gap  # slow to load, needed here only
    from phaselead.report import gap_page, made_by

    values = _given(JOBS["gap"], given)
    if hub.stage is None:
        raise BadInput("gap compares a model with recordings; upload a model, or identify the stage")
    train, holdout = (values[part].split() for part in ("train", "holdout"))
    if not train or not holdout:
        raise BadInput("gap needs recordings to fit and others to judge by; save some first")
    for name in train + holdout:
        if PurePath(name.partition("@")[0]).name != name.partition("@")[0]:
            raise BadInput(f"{name}: name a recording in {hub.folder}, without a folder")
    _at_rest(hub)
    with hub.working("gap", streams=False):
        parts = [gather([str(hub.folder / name) for name in part]) for part in (train, holdout)]
        result = run_gap(hub.stage, *parts, on_progress=hub.progress)
        page, following = f"gap-{_stamp()}.html", f"next-{_stamp()}.toml"
        result.next_model.save(hub.new_file(following))
        words = ["gap", "--model", hub.stage.name, "--train", *train, "--holdout", *holdout, "-o", following]
        with made_by(shlex.join(["phaselead", *words, "--report", page])):
            write_text(str(hub.folder / page), gap_page(result, hub.stage.name))
        hub.new_file(page)
    named = ", ".join(effect.name for effect in result.effects) or "nothing"
    return f"gap: {', '.join(result.verdicts)} ({named}); page {hub.folder / page}, model {hub.folder / following}"


JOBS: dict[str, Job] = {
    "identify": Job(
        identify,
        "Identify",
        "Parks, drives sines in volts and fits a model, which is uploaded. Without a limit of its time it takes six"
        " minutes an axis, creep included.",
        (
            Field("axes", "Axes", "x", "x, or x,y,z"),
            Field("u_max", "Largest voltage (V)", "", "empty: the usual levels"),
            Field("duration", "Seconds", "120", "at least 56 for each axis; empty: all sines, and creep"),
        ),
    ),
    "tune": Job(
        tune,
        "Tune",
        "Parks, plays multisines of some micrometres, shapes PID and filters on what comes back, measures the loop, and"
        " uploads the model with its gains.",
        (
            Field("axis", "Axis", "x"),
            Field("level", "Voltage (V)", "", "peak-to-peak; empty: a sixtieth of the limits"),
            Field("peak", "Peak sensitivity", "2", "allowed, 1.2 to 3; 1.4 to 2 is usual"),
        ),
    ),
    "learn": Job(
        learn,
        "Learn",
        "Parks and drives a periodic path again and again, corrected by the error that repeats.",
        (Field("wave", "Waveform", "x=sine:40um@5Hz"), Field("trials", "Trials", "5")),
    ),
    "gap": Job(
        gap,
        "Gap",
        "Parks and compares the model with saved recordings: where do they disagree, and what is missing?",
        (
            Field("train", "Fitted to", "", "names of saved .h5, spaces between"),
            Field("holdout", "Judged by", "", "other saved .h5"),
        ),
    ),
}
"""By the name of the order. A further job is one entry here."""
