"""Paths as they may be given from Python: words or waveforms, for one axis or by axis."""

from __future__ import annotations

from collections.abc import Mapping

from phaselead.errors import BadInput
from phaselead.record import parse_axes
from phaselead.waveforms import Waveform, parse_wave, parse_waves

WaveLike = str | Waveform
WavesLike = WaveLike | Mapping[str, WaveLike]


def wave_text(*waves: WavesLike | None) -> str:
    """What a run without a file is called."""
    given = [wave for wave in waves if wave is not None]
    parts = given[0].values() if len(given) == 1 and isinstance(given[0], Mapping) else given
    return ",".join(wave if isinstance(wave, str) else getattr(wave, "kind", "run") for wave in parts)


def given_waves(
    wave: WavesLike | None, axis: str | None, by_axis: Mapping[str, WaveLike | None]
) -> dict[str, Waveform]:
    """The waveform of each axis. Raises BadInput when there is none, or one is given twice."""
    found: dict[str, Waveform] = {}
    if isinstance(wave, str):
        found = parse_waves(wave, axis)
    elif wave is not None:
        given: Mapping[str, WaveLike] = (
            wave if isinstance(wave, Mapping) else dict.fromkeys(parse_axes(axis or "x", "axis"), wave)
        )
        found = {name: as_waveform(one, name) for name, one in given.items()}
    for name, one in by_axis.items():
        if one is not None:
            if name in found:
                raise BadInput(f"axis {name} is given two waveforms; give it one")
            found[name] = as_waveform(one, name)
    if not found or not set(found) <= set("xyz"):
        raise BadInput('which path? e.g. track("sine:60um@5Hz") or track(x="sine:60um@5Hz", y="sine:30um@5Hz")')
    return found


def as_waveform(one: WaveLike, axis: str = "x") -> Waveform:
    """The waveform of an axis. Raises BadInput for what is neither words nor one."""
    if isinstance(one, str):
        return parse_wave(one, axis)
    if not isinstance(one, Waveform):
        raise BadInput(f"{axis}: {one!r} is no path; write one, e.g. sine:60um@5Hz")
    return one
