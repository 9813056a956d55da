"""What is a table of samples: its columns as attributes, named like the header of a CSV file."""

from __future__ import annotations

from collections.abc import Mapping

from phaselead.record.axis_record import Samples
from phaselead.result import Result


class Column:
    """A column by its name: ``recording.x_um``. Raises AttributeError, with the columns there are, where it is not."""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, one: SampledResult | None, owner: type | None = None) -> Samples:
        if one is None:  # asked of the class, as by help()
            return self  # type: ignore[return-value]
        if self.name not in one.columns:
            raise AttributeError(f"there is no column {self.name}; there are {', '.join(one.columns)}")
        return one.columns[self.name]


class SampledResult(Result):
    """A result that is a table of samples. Every column is a float64 array of shape (n,).

    ``t_s`` are the times; ``u_V``, ``x_um`` and ``r_um`` voltage, position and reference of a recording of axis x
    alone. With other or more axes they are ``ux_V``, ``x_um``, ``rx_um``, ``uy_V``, ``y_um``, ``ry_um`` ...
    """

    u_V, x_um, r_um = Column(), Column(), Column()
    ux_V, uy_V, uz_V = Column(), Column(), Column()
    y_um, z_um = Column(), Column()
    rx_um, ry_um, rz_um = Column(), Column(), Column()

    @property
    def columns(self) -> Mapping[str, Samples]:
        """The samples by column, in the order of a CSV header: arrays of shape (n,)."""
        raise NotImplementedError
