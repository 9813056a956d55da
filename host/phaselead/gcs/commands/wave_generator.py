"""Wave tables and generators."""

from __future__ import annotations

from phaselead.device import TICK_HZ
from phaselead.errors import BadInput
from phaselead.gcs.commands.known import Stage, Words, by_two, command, stretch
from phaselead.gcs.errors import Code, GcsError
from phaselead.gcs.syntax import array, groups, number, pairs, place, switch, whole
from phaselead.gcs.wave_shapes import MOST_POINTS
from phaselead.gcs.waves import TABLES


@command("WAV", "<TableID> <X|&|+> <LIN|RAMP|SIN_P|PNT> <Parameters> Define waveform", changes=True)
def define_wave(stage: Stage, words: Words) -> None:
    stage.axes.where()
    stage.waves.define(words)


@command("WAV?", "[{<TableID> 1}] Get number of points of wave tables")
def wave_lengths(stage: Stage, words: Words) -> str:
    tables = [stage.waves.table(table) for table, _ in by_two(words)] if words else range(1, TABLES + 1)
    return pairs({f"{table} 1": len(stage.waves.tables.get(table, ())) for table in tables})


@command("WCL", "{<TableID>} Clear wave tables", changes=True)
def clear_waves(stage: Stage, words: Words) -> None:
    stage.axes.where()
    stage.waves.clear([stage.waves.table(word) for (word,) in groups(words, 1)])


@command("GWD?", "[<StartPoint> <Number> {<TableID>}] Get points of wave tables, um")
def wave_points(stage: Stage, words: Words) -> str:
    first, count, chosen = stretch(words, [stage.waves.table(word) for word in words[2:]] or sorted(stage.waves.tables))
    count = count or min((len(stage.waves.points(at)) for at in chosen), default=0)
    if not chosen or any(len(stage.waves.points(at)) < first + count - 1 for at in chosen):
        raise GcsError(Code.WAV_NOT_DEFINED, "the tables have not so many points")
    columns = {f"wave table {at}": stage.waves.points(at)[first - 1 : first - 1 + count].tolist() for at in chosen}
    return array("phaselead wave tables", 1 / TICK_HZ, columns)


@command("WMS?", "[{<TableID>}] Get most points of wave tables")
def most_points(stage: Stage, words: Words) -> str:
    return pairs({str(at): MOST_POINTS for at in [stage.waves.table(w) for w in words] or range(1, TABLES + 1)})


@command("TWG?", "Get number of wave generators")
def number_of_generators(stage: Stage, words: Words) -> str:
    return f"{len(stage.waves.generators)}\n"


def _generators(stage: Stage, words: Words) -> list[int]:
    return [stage.waves.generator(word) for word in words] or list(stage.waves.generators)


@command("WSL?", "[{<WaveGenID>}] Get selected wave table")
def selected(stage: Stage, words: Words) -> str:
    return pairs({str(at): stage.waves.generators[at].table for at in _generators(stage, words)})


@command("WSL", "{<WaveGenID> <TableID>} Select wave table, 0 for none", changes=True)
def select(stage: Stage, words: Words) -> None:
    chosen = {
        stage.waves.generator(at): 0 if whole(table) == 0 else stage.waves.table(table) for at, table in by_two(words)
    }
    stage.axes.where()
    if any(stage.waves.running(at) for at in chosen):
        raise GcsError(Code.WAVE_GENERATOR_ACTIVE)
    for at, table in chosen.items():
        stage.waves.generators[at].table = table


@command("WGC?", "[{<WaveGenID>}] Get number of cycles")
def cycles(stage: Stage, words: Words) -> str:
    return pairs({str(at): stage.waves.generators[at].cycles for at in _generators(stage, words)})


@command("WGC", "{<WaveGenID> <Cycles>} Set number of cycles, 0 for ever", changes=True)
def set_cycles(stage: Stage, words: Words) -> None:
    chosen = {stage.waves.generator(at): whole(count) for at, count in by_two(words)}
    if any(not 0 <= count <= 2**31 for count in chosen.values()):
        raise GcsError(Code.PARAM_OUT_OF_RANGE)
    for at, count in chosen.items():
        stage.waves.generators[at].cycles = count


@command("WOS?", "[{<WaveGenID>}] Get offset of the wave, um")
def offsets(stage: Stage, words: Words) -> str:
    return pairs({str(at): place(stage.waves.generators[at].offset_um) for at in _generators(stage, words)})


@command("WOS", "{<WaveGenID> <Offset>} Set offset of the wave, um", changes=True)
def set_offset(stage: Stage, words: Words) -> None:
    for at, um in {stage.waves.generator(at): number(um) for at, um in by_two(words)}.items():
        stage.waves.generators[at].offset_um = um


@command("WTR?", "[{<WaveGenID>}] Get ticks per point and interpolation")
def table_rates(stage: Stage, words: Words) -> str:
    found = {at: stage.waves.generators[at] for at in _generators(stage, words)}
    return pairs({str(at): f"{one.ticks_per_point} {one.interpolation}" for at, one in found.items()})


@command("WTR", "{<WaveGenID|0> <Ticks> <Interpolation>} Set ticks per point; points are joined by lines", changes=True)
def set_table_rate(stage: Stage, words: Words) -> None:
    given = [(whole(at), whole(ticks), switch(joined)) for at, ticks, joined in groups(words, 3)]
    if any(not 1 <= ticks <= 2**31 for _, ticks, _ in given):
        raise GcsError(Code.PARAM_OUT_OF_RANGE)
    for at, ticks, joined in given:
        for one in list(stage.waves.generators) if at == 0 else [stage.waves.generator(str(at))]:
            stage.waves.generators[one].ticks_per_point = ticks
            stage.waves.generators[one].interpolation = int(joined)


@command("WGO?", "[{<WaveGenID>}] Get start/stop mode")
def running(stage: Stage, words: Words) -> str:
    stage.axes.where()
    return pairs({str(at): int(stage.waves.running(at)) for at in _generators(stage, words)})


@command("WGO", "{<WaveGenID> <Mode>} Start (1) and stop (0) wave generators", changes=True)
def go(stage: Stage, words: Words) -> None:
    modes = {stage.waves.generator(at): whole(mode) for at, mode in by_two(words)}
    try:
        stage.waves.go(modes)
    except BadInput as error:
        raise GcsError(Code.WAV_PARAMETER_OUT_OF_LIMIT, str(error)) from None
    if any(modes.values()):
        stage.recorder.begin()
