"""The parameters of one effect of a stage file, checked as they are taken."""

from __future__ import annotations

import math
from collections.abc import Sequence

from phaselead.errors import BadInput
from phaselead.model import Params, catalogue


class Terms:
    """The parameters of one effect, complete by the catalogue's names, checked as they are taken."""

    def __init__(self, name: str, params: Params, where: str) -> None:
        self._where, self._given = f"{where}: effect {name!r}", params
        try:
            self._params = dict(catalogue()[name].complete(params))
        except BadInput as error:
            raise BadInput(f"{where}: {error}") from None

    def __contains__(self, name: str) -> bool:
        return name in self._params

    def many(self, name: str) -> list[float]:
        """A parameter that may be a list."""
        if name not in self._params:
            raise BadInput(f"{self._where} has no parameter {name}; add it")
        value = self._params[name]
        return [float(v) for v in value] if isinstance(value, Sequence) else [float(value)]

    def one(self, name: str, *, low: float = -math.inf, above: float = -math.inf, below: float = math.inf) -> float:
        """A parameter that is one number within bounds; ``low`` itself is allowed."""
        values = self.many(name)
        if len(values) != 1:
            raise BadInput(f"{self._where}: {name} has {len(values)} terms; the simulator takes one")
        self._within(name, values, low, above, below)
        return values[0]

    def corner_Hz(self) -> float:
        """Of a low-pass, as the file has it; 0 where there is none."""
        given = self._given.get("corner_Hz")
        if isinstance(given, (int, float)):
            return float(given)
        tau_s = self.one("tau_s", low=0.0)
        return 1 / (2 * math.pi * tau_s) if tau_s > 0 else 0.0

    def alike(self, *names: str, most: int) -> list[list[float]]:
        """Lists of one length."""
        lists = [self.many(name) for name in names]
        for name, values in zip(names, lists, strict=True):
            if len(values) != len(lists[0]):
                raise BadInput(
                    f"{self._where}: {name} has {len(values)} terms, its partner has {len(lists[0])}; give one for each"
                )
            if len(values) > most:
                raise BadInput(f"{self._where}: {name} has {len(values)} terms, the simulator takes {most}")
        return lists

    def positive(self, name: str, values: Sequence[float], below: float = math.inf) -> None:
        """Refuse what is not above 0."""
        self._within(name, values, -math.inf, 0.0, below)

    def _within(self, name: str, values: Sequence[float], low: float, above: float, below: float) -> None:
        for value in values:
            if not (math.isfinite(value) and value >= low and value > above and value < below):
                bounds = [f"at least {low:g}"] * (low > -math.inf) + [f"above {above:g}"] * (above > -math.inf)
                bounds += [f"below {below:g}"] * (below < math.inf)
                raise BadInput(f"{self._where}: {name} must be {' and '.join(bounds) or 'finite'}; it is {value:g}")
