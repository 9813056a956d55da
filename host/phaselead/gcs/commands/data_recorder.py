"""The data recorder."""

from __future__ import annotations

from phaselead.gcs import recorder
from phaselead.gcs.commands.known import Stage, Words, command, stretch
from phaselead.gcs.errors import Code, GcsError
from phaselead.gcs.syntax import array, exactly, groups, lines, pairs, whole


@command("HDR?", "Get options of the data recorder")
def recorder_options(stage: Stage, words: Words) -> str:
    return lines(
        [
            "#RecordOptions",
            *(f"{option}={words}" for option, (words, _) in recorder.OPTIONS.items()),
            "#TriggerOptions",
            *(f"{source}={words}" for source, words in recorder.TRIGGERS.items()),
            "#Parameters to be set with SPA",
            "none",
            "#Additional information",
            f"{recorder.TABLES} record tables",
            f"{recorder.MOST_POINTS} datapoints per table",
            "end of help",
        ]
    )


@command("TNR?", "Get number of record tables")
def number_of_tables(stage: Stage, words: Words) -> str:
    return f"{recorder.TABLES}\n"


def _tables(stage: Stage, words: Words) -> list[int]:
    return [stage.recorder.table(word) for word in words] or list(stage.recorder.tables)


@command("DRC?", "[{<RecTableID>}] Get what is recorded")
def recorded_sources(stage: Stage, words: Words) -> str:
    return pairs({str(at): "{} {}".format(*stage.recorder.tables[at]) for at in _tables(stage, words)})


@command("DRC", "{<RecTableID> <Source> <RecOption>} Set what is recorded", changes=True)
def set_recorded(stage: Stage, words: Words) -> None:
    for table, source, option in groups(words, 3):
        stage.recorder.configure(stage.recorder.table(table), source, whole(option))


@command("DRT?", "[{<RecTableID>}] Get trigger source")
def trigger_source(stage: Stage, words: Words) -> str:
    return pairs({str(at): f"{stage.recorder.trigger} 0" for at in _tables(stage, words)})


@command("DRT", "{<RecTableID|0> <TriggerSource> <Value>} Set trigger source, of all tables", changes=True)
def set_trigger(stage: Stage, words: Words) -> None:
    sources = []
    for table, source, _ in groups(words, 3):
        if whole(table) != 0:
            stage.recorder.table(table)
        sources.append(whole(source))
    stage.recorder.set_trigger(sources[-1])


@command("RTR?", "Get record table rate, ticks")
def record_rate(stage: Stage, words: Words) -> str:
    return f"{stage.recorder.rate}\n"


@command("RTR", "<Ticks> Set record table rate", changes=True)
def set_record_rate(stage: Stage, words: Words) -> None:
    exactly(words, 1)
    ticks = whole(words[0])
    if not 1 <= ticks <= 10**6:
        raise GcsError(Code.PARAM_OUT_OF_RANGE)
    stage.recorder.rate = ticks


@command("DRL?", "[{<RecTableID>}] Get number of recorded points")
def recorded_points(stage: Stage, words: Words) -> str:
    return pairs({str(at): stage.recorder.recorded(at) for at in _tables(stage, words)})


@command("DRR?", "[<StartPoint> <Number> {<RecTableID>}] Get recorded points")
def recorded_values(stage: Stage, words: Words) -> str:
    used = [at for at in stage.recorder.tables if stage.recorder.tables[at][1] != recorder.NOTHING]
    first, count, chosen = stretch(words, [stage.recorder.table(word) for word in words[2:]] or used)
    count = count or min((stage.recorder.recorded(at) for at in chosen), default=0)
    columns = stage.recorder.columns(chosen, first, count)
    return array("phaselead data recorder", stage.recorder.sample_s, columns)
