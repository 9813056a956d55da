"""Positions, servo, moves, stop."""

from __future__ import annotations

import math
from collections.abc import Callable

from phaselead.gcs.commands.known import COMMANDS, Stage, Words, by_two, command
from phaselead.gcs.errors import Code, GcsError
from phaselead.gcs.syntax import PLACES, number, pairs, place, switch


@command("POS?", "[{<AxisID>}] Get current position, um")
def positions(stage: Stage, words: Words) -> str:
    asked, found = stage.asked(words), stage.axes.where()
    return pairs({axis: place(found.axes[axis].x_um) for axis in asked})


@command("MOV?", "[{<AxisID>}] Get target position, um")
def targets(stage: Stage, words: Words) -> str:
    asked = stage.asked(words)
    stage.axes.where()
    return pairs({axis: place(stage.axes.target_um[axis]) for axis in asked})


@command("ONT?", "[{<AxisID>}] Get on-target state")
def on_target(stage: Stage, words: Words) -> str:
    asked, found = stage.asked(words), stage.axes.where()
    return pairs({axis: int(stage.axes.on_target(found, axis)) for axis in asked})


@command("SVO?", "[{<AxisID>}] Get servo mode")
def servo_modes(stage: Stage, words: Words) -> str:
    asked = stage.asked(words)
    stage.axes.where()
    return pairs({axis: int(stage.axes.servo(axis)) for axis in asked})


@command("SVO", "{<AxisID> <State>} Set servo mode; the first 1 arms, the last 0 parks", changes=True)
def set_servo(stage: Stage, words: Words) -> None:
    states = stage.axes.by_axis(by_two(words))
    stage.axes.set_servo({axis: switch(word) for axis, word in states.items()})
    stage.hub.restream()


@command("MOV", "{<AxisID> <Position>} Set target position, um", changes=True, moves=True)
def move(stage: Stage, words: Words) -> None:
    stage.axes.move(_numbers(stage, words))


@command("MVR", "{<AxisID> <Distance>} Set target position relative to the last target, um", changes=True, moves=True)
def move_relative(stage: Stage, words: Words) -> None:
    ways = _numbers(stage, words)
    stage.axes.where()
    stage.axes.move({axis: stage.axes.target_um[axis] + way for axis, way in ways.items()})


@command("VEL?", "[{<AxisID>}] Get highest velocity of moves, um/s")
def velocities(stage: Stage, words: Words) -> str:
    return pairs({axis: place(stage.axes.speed(axis)) for axis in stage.asked(words)})


@command("VEL", "{<AxisID> <Velocity>} Set highest velocity of moves, um/s", changes=True)
def set_velocity(stage: Stage, words: Words) -> None:
    for axis, value in _numbers(stage, words).items():
        stage.axes.set_speed(axis, value)


@command("TMN?", "[{<AxisID>}] Get lowest position that can be commanded, um")
def lowest(stage: Stage, words: Words) -> str:
    return pairs({axis: place(_inward(stage.axes.dev.range_um(axis)[0], math.ceil)) for axis in stage.asked(words)})


@command("TMX?", "[{<AxisID>}] Get highest position that can be commanded, um")
def highest(stage: Stage, words: Words) -> str:
    return pairs({axis: place(_inward(stage.axes.dev.range_um(axis)[1], math.floor)) for axis in stage.asked(words)})


@command("HLT", "[{<AxisID>}] Halt motion, hold, set error 10")
def halt(stage: Stage, words: Words) -> None:
    stage.axes.stop("".join(stage.asked(words)) if words else "")
    raise GcsError(Code.STOP)


@command("STP", "Stop all axes, hold, set error 10")
def stop(stage: Stage, words: Words) -> None:
    stage.axes.stop()
    raise GcsError(Code.STOP)


COMMANDS["#24"] = COMMANDS["STP"]


@command("HIN?", "[{<AxisID>}] Get whether a hand-held device controls an axis: never")
def hand_held(stage: Stage, words: Words) -> str:
    return pairs(dict.fromkeys(stage.asked(words), 0))


def _numbers(stage: Stage, words: Words) -> dict[str, float]:
    return {axis: number(word) for axis, word in stage.axes.by_axis(by_two(words)).items()}


def _inward(um: float, rounded: Callable[[float], int]) -> float:
    """An end of the range as it can be written, so that a move there is not refused."""
    return rounded(um * PLACES) / PLACES
