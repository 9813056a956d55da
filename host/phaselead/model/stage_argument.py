"""A stage however it is given: itself, what carries one, or the name of a stage file."""

from __future__ import annotations

import os
from typing import Protocol, runtime_checkable

from phaselead.errors import BadInput
from phaselead.model.stage_file import Stage, load_stage


@runtime_checkable
class CarriesStage(Protocol):
    """What carries a stage, as the result of a fit does."""

    @property
    def model(self) -> Stage: ...


StageLike = Stage | CarriesStage | str | os.PathLike[str]
"""A stage, the result of a fit, or the name of a stage file."""


def as_stage(model: StageLike) -> Stage:
    """The stage that is meant. Raises BadInput for a file that cannot be read, and for anything else."""
    if isinstance(model, Stage):
        return model
    if isinstance(model, str | os.PathLike):
        return load_stage(os.fspath(model))
    if isinstance(model, CarriesStage):
        return model.model
    raise BadInput(f"a {type(model).__name__} is no model; give a stage, the result of a fit, or a stage file's name")
