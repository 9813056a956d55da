"""The cases of ``tests/gap/truth`` seen by a noisy sensor: white noise is added to every row of every position.

``phaselead gap campaign --truth tests/gap/truth_noisy`` runs it. What is known of a case, and its name, are those of
the quiet one; the noise of a record is the same in every process.
"""

import hashlib
import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

NOISE_UM = 0.5
"""Deviation of the noise of a row, some hundred times that of the quiet sensors."""


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


class NoisyCase:
    """A case whose sensor is noisy, and otherwise the quiet one."""

    def __init__(self, quiet):
        self.quiet = quiet

    def __getattr__(self, name):
        return getattr(self.quiet, name)

    def records(self):
        """(reference, train, holdout)"""
        return tuple([self._seen(record, role) for record in part] for role, part in enumerate(self.quiet.records()))

    def bare_holdout(self):
        """The held-out records with nothing hidden, under the same noise."""
        return [self._seen(record, 2) for record in self.quiet.bare_holdout()]

    def follow_up(self, voltage, seconds, axis):
        """One more record after the others."""
        return self._seen(self.quiet.follow_up(voltage, seconds, axis), 3)

    def _seen(self, record, role):
        words = f"{self.quiet.name}/{role}/{record.source}"
        rng = np.random.default_rng(int.from_bytes(hashlib.sha256(words.encode()).digest()[:8], "big"))
        axes = {}
        for name, axis in record.axes.items():
            axes[name] = replace(axis, x_um=axis.x_um + NOISE_UM * rng.normal(size=len(axis.x_um)))
        return replace(record, axes=axes)


def cases(*args, **kwargs):
    """Those of the quiet generator."""
    return [NoisyCase(one) for one in QUIET.cases(*args, **kwargs)]


def case(name):
    """The case of that name. Raises ValueError."""
    return NoisyCase(QUIET.case(name))
