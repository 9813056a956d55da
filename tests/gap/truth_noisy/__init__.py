"""The cases of ``tests/gap/truth`` with a noisy sensor.

``phaselead gap campaign --truth tests/gap/truth_noisy`` runs it. What is known of a case, and its name, are those of
the quiet one. Begin another folder of results when the quiet generator has changed: a campaign looks at this one only.
"""

import importlib.util
import sys
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path

NOISE_UM = 0.5
"""Deviation of the sensor's white noise, 40 to 250 times that of the quiet ones."""


def _quiet():
    """The generator beside this one, as a module of its own."""
    folder = Path(__file__).parent.parent / "truth"
    spec = importlib.util.spec_from_file_location(
        "truth_of_quiet_sensors", folder / "__init__.py", submodule_search_locations=[str(folder)]
    )
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


QUIET = _quiet()
KINDS = QUIET.KINDS


@dataclass(frozen=True)
class NoisyCase(QUIET.Case):
    """A case whose sensor is noisy, and otherwise the quiet one."""

    @cached_property
    def characters(self):
        """The stages."""
        return {axis: replace(c, white_um=NOISE_UM) for axis, c in super().characters.items()}


def _noisy(case):
    return NoisyCase(**{field.name: getattr(case, field.name) for field in fields(case)})


def cases(*args, **kwargs):
    """Those of the quiet generator."""
    return [_noisy(one) for one in QUIET.cases(*args, **kwargs)]


def case(name):
    """The case of that name. Raises ValueError."""
    return _noisy(QUIET.case(name))
