"""What a scan is: one written path for two axes. Each kind is a class in a file of its own beside this one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar, NamedTuple

from phaselead.waveforms.waveform import Waveform
from phaselead.waveforms.written import Written


class Scan(ABC):
    """A path in the plane of x and y. It is found by its file, as a waveform is."""

    kind: ClassVar[str]
    """The word before the colon."""
    written: ClassVar[tuple[tuple[str, str], ...]]
    """Ways to write it and what they mean; messages show the first."""
    order: ClassVar[int] = 100

    @classmethod
    @abstractmethod
    def parse(cls, written: Written) -> Mapping[str, Waveform]:
        """The waveforms of its axes. Raises BadInput."""


class Counted(NamedTuple):
    """``LEVELS/COUNT@FREQUENCY``, taken apart."""

    levels: str
    number: int
    f_Hz: float


def counted(written: Written, what: str, most: int) -> Counted:
    """Raises BadInput where the count of ``what`` is none, or above ``most``."""
    body, f_Hz = written.at_frequency()
    levels, slash, count = body.rpartition("/")
    if not slash or not count.strip().isdigit() or not 1 <= int(count) <= most:
        raise written.refusal(f"it needs a number of {what} from 1 to {most} (more in a file, path:scan.csv)")
    return Counted(levels, int(count), f_Hz)
