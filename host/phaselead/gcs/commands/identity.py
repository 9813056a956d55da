"""Who is there, and what can be asked."""

from __future__ import annotations

from phaselead.gcs.commands.known import COMMANDS, Stage, Words, command
from phaselead.gcs.syntax import lines
from phaselead.version import VERSION


@command("*IDN?", "Get device identification")
def identification(stage: Stage, words: Words) -> str:
    info = stage.axes.dev.device.hello
    return f"phaselead, PHASELEAD, {info.build_id.hex()[:16]}, {VERSION}\n"


COMMANDS["IDN?"] = COMMANDS["*IDN?"]


@command("VER?", "Get versions of firmware and program")
def versions(stage: Stage, words: Words) -> str:
    info = stage.axes.dev.info()
    return lines(
        [f"phaselead: {VERSION}", f"firmware: {info['build_id']} on {info['target']}", f"wire: {info['wire']}"]
    )


@command("CSV?", "Get syntax version of GCS")
def syntax_version(stage: Stage, words: Words) -> str:
    return "2.0\n"


@command("HLP?", "Get list of commands")
def help_text(stage: Stage, words: Words) -> str:
    listed = [f"{name} {known.usage}" for name, known in COMMANDS.items()]
    return lines(["The following commands are valid:", *listed, "end of help"])


@command("SAI?", "[ALL] Get identifiers of axes")
def axis_identifiers(stage: Stage, words: Words) -> str:
    return lines(stage.axes.letters)


@command("TVI?", "Get valid characters of axis identifiers")
def valid_identifiers(stage: Stage, words: Words) -> str:
    return f"{stage.axes.letters}\n"


@command("#5", "Get motion status, a bit for each axis")
def motion_status(stage: Stage, words: Words) -> str:
    return f"{stage.axes.moving():X}\n"


@command("#7", "Get whether the controller is ready: 0xB1, else 0xB0")
@command("ERR?", "Get the last error of this client, and forget it")
def by_the_service(stage: Stage, words: Words) -> None:
    """Answered without the hub."""


@command("#9", "Get wave generator status, a bit for each generator")
def wave_status(stage: Stage, words: Words) -> str:
    stage.axes.where()
    return f"{sum(stage.waves.running(at) << (at - 1) for at in stage.waves.generators):X}\n"
