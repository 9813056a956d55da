"""What an upload gives back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from phaselead.device import inverse_refusal
from phaselead.model import Stage
from phaselead.result import Result, Table, pairs_table


@dataclass(frozen=True)
class Upload(Result):
    """A model that was uploaded and read back: bytes, CRC-32, and the number of its flash record if it was kept."""

    model: Stage
    bytes: int
    crc: str
    flash_record: int | None = None

    def as_dict(self) -> dict[str, Any]:
        """The figures that ``phaselead upload`` prints, without the file's name."""
        figures: dict[str, Any] = {"bytes": self.bytes, "crc": self.crc, "read_back": "equal"}
        return figures | ({} if self.flash_record is None else {"flash_record": self.flash_record})

    @property
    def columns(self) -> dict[str, list[Any]]:
        """One row."""
        return {name: [value] for name, value in self.as_dict().items()}

    def tables(self) -> list[Table | str]:
        return [pairs_table({"model": self.model.name} | self.as_dict())]


def without_inverse(stage: Stage) -> list[str]:
    """One line for each axis with a time view that the device holds no inverse of, with the reason."""
    refused = ((name, inverse_refusal(model, name)) for name, model in stage.axes.items() if model.time is not None)
    return [f"axis {name}: uploaded without an inverse of its model: {why}" for name, why in refused if why is not None]
