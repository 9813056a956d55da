"""What a command is, and what all of them act on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from phaselead.gcs.axes import Axes
from phaselead.gcs.errors import Code, GcsError
from phaselead.gcs.recorder import Recorder
from phaselead.gcs.syntax import groups, whole
from phaselead.gcs.waves import Waves
from phaselead.scope import Hub

Words = Sequence[str]


@dataclass
class Stage:
    """What the commands act on."""

    hub: Hub
    axes: Axes
    waves: Waves = field(init=False)
    recorder: Recorder = field(init=False)

    def __post_init__(self) -> None:
        self.waves, self.recorder = Waves(self.axes), Recorder(self.hub.samples)

    def asked(self, words: Words) -> list[str]:
        """The axes of a query: those named, else all."""
        return [self.axes.known(word) for word in words] or list(self.axes.letters)


@dataclass(frozen=True)
class Known:
    """A command."""

    usage: str
    """Its arguments and what it does, as HLP? shows them."""
    run: Callable[[Stage, Words], str | None]
    changes: bool = False
    """It changes something: the client that drives alone may give it."""
    moves: bool = False
    """It may change a target: the recorder may be waiting for that."""


COMMANDS: dict[str, Known] = {}


def command(
    name: str, usage: str, *, changes: bool = False, moves: bool = False
) -> Callable[[Callable[[Stage, Words], str | None]], Callable[[Stage, Words], str | None]]:
    """Makes a function the command of this name. ``changes`` and ``moves``: see ``Known``."""

    def known(run: Callable[[Stage, Words], str | None]) -> Callable[[Stage, Words], str | None]:
        COMMANDS[name] = Known(usage, run, changes, moves)
        return run

    return known


def by_two(words: Words) -> list[tuple[str, ...]]:
    """Words in pairs. Raises GcsError."""
    return groups(words, 2)


def stretch(words: Words, tables: list[int]) -> tuple[int, int, list[int]]:
    """The first point, how many (0: all), and the tables."""
    if len(words) == 1:
        raise GcsError(Code.MISSING_PARAM)
    first, count = (whole(words[0]), whole(words[1])) if words else (1, 0)
    if first < 1 or count < (1 if words else 0):
        raise GcsError(Code.PARAM_OUT_OF_RANGE)
    return first, count, tables
