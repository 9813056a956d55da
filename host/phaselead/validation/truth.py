"""What a generator of blind trials must offer, and how it is loaded from its folder."""

from __future__ import annotations

import hashlib
import importlib.util
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol, cast

from phaselead.errors import BadInput
from phaselead.record import Recording, Samples

MODULE = "phaselead_truth"
KINDS = ("none", "single", "sines", "pair", "triple", "removed", "closed_loop", "coupling", "poor", "outside")
"""Kinds of cases; docs/gap-campaign.md describes them."""
ON_REQUEST = ("narrow", "slow_sines", "unreferenced", "straight")
"""More kinds, which a campaign tries only where it is asked for them."""

UNDER_TEST = tuple(Path(__file__).parents[1] / room for room in ("gap", "identify", "model"))
"""Folders of the package whose code a campaign tries."""


class Hidden(Protocol):
    """One hidden effect: ``size`` is a multiple of the typical one, ``value`` is in ``unit``, that of the first size
    parameter in the catalogue."""

    @property
    def name(self) -> str: ...
    @property
    def size(self) -> float: ...
    @property
    def value(self) -> float: ...
    @property
    def unit(self) -> str: ...
    @property
    def axis(self) -> str | None: ...


class Case(Protocol):
    """One blind trial. The same name gives the same records in every process.

    May also have ``referenced``, False where the workflow is not given the reference records; ``base``, ``"linear"``
    where the lab has gain and offset of the training records and no model of the reference records; ``output_V``, the
    voltages of the output converter's lowest code and one past the highest, where they are not those of a stage file by
    default; and ``allowed``, names that are right too, for a system outside the catalogue or a base that lacks much.
    """

    @property
    def name(self) -> str: ...
    @property
    def kind(self) -> str: ...
    @property
    def hidden(self) -> Sequence[Hidden]: ...
    @property
    def without(self) -> tuple[str, ...]:
        """Effects to leave out of the catalogue."""
        ...

    @property
    def bits(self) -> int:
        """Resolution of the output converter, which a lab knows."""
        ...

    def records(self) -> tuple[list[Recording], list[Recording], list[Recording]]:
        """Reference (without what is hidden), training and held-out records."""
        ...

    def bare_holdout(self) -> list[Recording] | None:
        """The held-out records without what is hidden; None where they cannot be known."""
        ...

    def follow_up(self, voltage: Callable[[Samples], Samples], seconds: float, axis: str | None) -> Recording:
        """One more record of the same stage after the others, driven by ``voltage`` of the time from its start."""
        ...


class Truth(Protocol):
    """The folder as a Python module. May also have ``KINDS``, where it does not have all of them;
    those on request are not among these."""

    def cases(self, set_name: str, kinds: Sequence[str], sizes: Sequence[float], scale: float) -> Sequence[Case]:
        """The cases, ordered so that any first few are a fair sample. Raises ValueError for unknown options."""
        ...

    def case(self, name: str) -> Case:
        """The case of that name. Raises ValueError."""
        ...


def load_truth(folder: str | Path) -> Truth:
    """The generator in a folder with an ``__init__.py``. Raises BadInput."""
    path = Path(folder).resolve() / "__init__.py"
    if not path.is_file():
        raise BadInput(
            f"{folder}: holds no generator of hidden truths; it needs an __init__.py with cases() and case(); "
            "the source tree has one in tests/gap/truth"
        )
    loaded = sys.modules.get(MODULE)
    if loaded is not None and loaded.__file__ == str(path):
        return cast(Truth, loaded)
    spec = importlib.util.spec_from_file_location(MODULE, path, submodule_search_locations=[str(path.parent)])
    assert spec is not None
    assert spec.loader is not None
    for name in [name for name in sys.modules if name.startswith(MODULE)]:
        del sys.modules[name]
    module = importlib.util.module_from_spec(spec)
    sys.modules[MODULE] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # whatever a user's module raises
        del sys.modules[MODULE]
        raise BadInput(f"{path}: cannot be loaded ({type(error).__name__}: {error}); mend it first") from error
    missing = [name for name in ("cases", "case") if not hasattr(module, name)]
    if missing:
        del sys.modules[MODULE]
        raise BadInput(f"{path}: has no function {' and no '.join(missing)}; docs/gap-campaign.md has the protocol")
    return cast(Truth, module)


def fingerprint(folder: str | Path) -> str:
    """Twelve digits that change with any line of the generator or of the rooms of the package under test."""
    digest = hashlib.sha256()
    for root in [Path(folder).resolve(), *UNDER_TEST]:
        for file in sorted(root.rglob("*")):
            if file.suffix in (".py", ".c", ".h"):
                digest.update(file.relative_to(root).as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:12]
