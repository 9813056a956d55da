"""Parameters, for which PIPython's recorder asks. None can be set."""

from __future__ import annotations

from collections.abc import Mapping

from phaselead.device import TICK_HZ
from phaselead.gcs import recorder
from phaselead.gcs.commands.known import Stage, Words, by_two, command
from phaselead.gcs.errors import Code, GcsError
from phaselead.gcs.syntax import groups, lines, pairs, whole
from phaselead.gcs.wave_shapes import MOST_POINTS

PARAMETERS: Mapping[int, tuple[str, str, float]] = {
    0x0E000200: ("FLOAT", "Servo update time (s)", 1 / TICK_HZ),
    0x13000004: ("INT", "Most points of a wave table", MOST_POINTS),
    0x16000200: ("INT", "Data recorder: most points of all tables", recorder.TABLES * recorder.MOST_POINTS),
    0x16000201: ("INT", "Data recorder: most points of a table", recorder.MOST_POINTS),
    0x16000300: ("INT", "Data recorder: number of tables", recorder.TABLES),
}
"""Type, what it is, value; none of them can be set."""


@command("HPA?", "Get list of parameters")
def parameter_list(stage: Stage, words: Words) -> str:
    listed = (f"0x{at:X}=\t0\t1\t{kind}\tphaselead\t{title}" for at, (kind, title, _) in PARAMETERS.items())
    return lines(["The following parameters are valid:", *listed, "end of help"])


@command("SPA?", "{<ItemID> <ParamID>} Get parameters")
def parameters(stage: Stage, words: Words) -> str:
    asked = [(item, whole(parameter)) for item, parameter in by_two(words)]
    return pairs({f"{item} 0x{at:X}": f"{_parameter(at):.10g}" for item, at in asked})


@command("SPA", "{<ItemID> <ParamID> <Value>} Set parameters: none can be set", changes=True)
def set_parameters(stage: Stage, words: Words) -> None:
    for _, parameter, _ in groups(words, 3):
        _parameter(whole(parameter))
    raise GcsError(Code.READ_ONLY_PARAMETER)


def _parameter(at: int) -> float:
    if at not in PARAMETERS:
        raise GcsError(Code.UNKNOWN_PARAMETER, f"0x{at:X}; HPA? lists them")
    return PARAMETERS[at][2]
