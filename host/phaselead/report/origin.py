"""Where the numbers of a page come from: recordings by their hashes, models and devices by theirs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from phaselead.model import Stage, parse_stage
from phaselead.record import Recording, Source, shortest_names

SHOWN_DIGITS = 12
"""Of a SHA-256: two recordings of a lab have the same with a chance of one in 10^8 when it has a thousand."""

HOST = "the firmware in the host process"


@dataclass(frozen=True)
class Origin:
    """``recordings`` by what they were used for; ``facts`` are sentences."""

    recordings: Mapping[str, Sequence[Source]] = field(default_factory=dict)
    facts: Sequence[str] = ()

    def used(self) -> list[tuple[str, list[dict[str, str]]]]:
        """For the template: what for, and each recording once."""
        names = shortest_names({one.name for of in self.recordings.values() for one in of})
        return [
            (use, [_row(one, names[one.name]) for one in dict.fromkeys(of)])
            for use, of in self.recordings.items() if of
        ]  # fmt: skip


def _row(source: Source, name: str) -> dict[str, str]:
    return {"name": name, "sha256": source.sha256, "short": source.sha256[:SHOWN_DIGITS]}


def of_stage(stage: Stage, what: str = "The stage file") -> str:
    """Which stage file it was, by the hash of its content, as a stage prints it."""
    return f"{what} “{stage.name}”, content {stage.sha256[:SHOWN_DIGITS]}."


def of_device(recordings: Iterable[Recording]) -> list[str]:
    """What recorded, once each."""
    known = ((one.meta.get("target"), one.meta.get("build_id")) for one in recordings)
    return [
        f"Recorded by {HOST if target == 'host' else target}, build {build[:SHOWN_DIGITS]}."
        for target, build in dict.fromkeys(known)
        if target and build
    ]


def of_run(recording: Recording) -> list[str]:
    """The stage file that a run was driven with, and its device."""
    text = recording.meta.get("stage")
    return [*([of_stage(parse_stage(text), "Driven with the stage file")] if text else []), *of_device([recording])]
