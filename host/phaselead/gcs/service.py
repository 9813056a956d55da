"""What is asked for in GCS, carried out by the hub: who drives, which error is whose, what the person is told."""

from __future__ import annotations

import asyncio
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from phaselead.errors import LinkError, PhaseleadError
from phaselead.gcs.commands import COMMANDS, Known, Stage
from phaselead.gcs.errors import Code, GcsError, code_of
from phaselead.gcs.syntax import Command, Reader, Unreadable
from phaselead.scope import Hub

LOOK_S = 0.25
"""Between two looks at what the person should be told, and at what the recorder has to take."""
READY, NOT_READY = "\xb1\n", "\xb0\n"


@dataclass(eq=False)
class Client:
    """One connection. Each has an error of its own."""

    reader: Reader = field(default_factory=Reader)
    error: Code = Code.NO_ERROR
    faults_told: int = 0


@dataclass
class Service:
    """All clients of one stage. The first that changes something drives until it has left; the others read, and may
    stop."""

    stage: Stage
    say: Callable[[str], None]
    driver: Client | None = None
    _faults: int = 0
    _said: str = ""
    _trouble: str = ""

    @property
    def hub(self) -> Hub:
        return self.stage.hub

    def joined(self) -> Client:
        """Another client."""
        return Client(faults_told=self._faults)

    def left(self, client: Client) -> None:
        """The axes are held where they are or come to; somebody else may drive."""
        if self.driver is client:
            self.driver = None

    async def answer(self, client: Client, asked: Command | Unreadable) -> str | None:
        """What to send back, if anything; an error waits for ERR?."""
        if isinstance(asked, Unreadable):
            client.error = asked.code
            return None
        if asked.name == "ERR?":
            return f"{self._error(client).value}\n"
        if asked.name == "#7":
            return NOT_READY if self.hub.away else READY
        known = COMMANDS.get(asked.name)
        try:
            if known is None:
                raise GcsError(Code.UNKNOWN_COMMAND)
            if known.changes:
                self._take_over(client)
            return await self._carried_out(client, known, asked)
        except PhaseleadError as error:
            client.error = code_of(error)
            if known is not None and client.error is not Code.STOP and client is self.driver:
                self._tell(f"{asked.name}: {' '.join(str(error).split())}")
            return None

    def _error(self, client: Client) -> Code:
        """The client's, which is then forgotten; else a fault that it has not been told."""
        found, client.error = client.error, Code.NO_ERROR
        if found is Code.NO_ERROR and client.faults_told < self._faults:
            found = Code.MOTION_ERROR
        client.faults_told = self._faults
        return found

    def _take_over(self, client: Client) -> None:
        if self.driver is None:
            self.driver = client
        if self.driver is not client:
            raise GcsError(Code.CONTROLLER_BUSY, "another client drives; it may be left to, or every client may STP")

    async def _carried_out(self, client: Client, known: Known, asked: Command) -> str | None:
        if self.hub.away:
            raise LinkError(self.hub.away)
        answers: list[str | None] = []
        stage, drives = self.stage, client is self.driver

        def order(_hub: Hub, _given: Mapping[str, Any]) -> str:
            stage.recorder.collect()
            begin_tick = stage.recorder.samples.end
            with warnings.catch_warnings(record=True) as warned:
                warnings.simplefilter("always")
                answers.append(known.run(stage, asked.words))
            if drives and asked.name != "DRT":
                stage.recorder.commanded(begin_tick, moves=known.moves)
            for one in warned:
                self._tell(f"warning: {one.message}")
            return ""

        await asyncio.wrap_future(self.hub.give(order, {}))
        return answers[0]

    async def watch(self) -> None:
        """Tells the person of faults and of a port that has gone away, and lets the recorder take what has come."""

        def collect(_hub: Hub, _given: Mapping[str, Any]) -> str:
            self.stage.recorder.collect()
            self.stage.axes.where()
            return ""

        while True:
            trouble = self.hub.away or self.hub.fault
            if trouble and trouble != self._trouble:
                self._faults += trouble == self.hub.fault
                self.say(trouble)
            self._trouble = trouble
            if not self.hub.away:
                self.hub.give(collect, {})
            await asyncio.sleep(LOOK_S)

    def _tell(self, line: str) -> None:
        """Once where it comes again and again."""
        if line != self._said:
            self._said = line
            self.say(line)
