"""The stage file: everything known about a stage, as TOML that a person can read and edit.

Two views of the same measurements per axis (``table`` and ``time``), limits, converter calibration, adopted
effects, the cross-coupling of the axes, and where it all came from. Every key is described by its ``Field``;
the same words become the comments of a saved file.
"""

from __future__ import annotations

import datetime
import hashlib
import json
import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, StringConstraints, ValidationError, field_validator, model_validator

from phaselead.errors import BadInput
from phaselead.model.axis import AdoptedEffect, AxisModel
from phaselead.model.effects import catalogue
from phaselead.model.fields import Matrix3, Part, Times
from phaselead.model.stage_toml import toml_text
from phaselead.model.summary import axis_table, parameter_columns, parameter_table, stage_figure
from phaselead.model.validation_errors import explain, explained, fault, key_path
from phaselead.nearest import nearest
from phaselead.record import AXES, Recording, own_header, shortest_names, write_text
from phaselead.result import Result, Table, pairs_table
from phaselead.version import VERSION as PROGRAM_VERSION

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMAT: Literal["phaselead-stage"] = "phaselead-stage"
VERSION: Literal[1] = 1
LARGEST_FILE = 16 * 2**20
_NUMBER = re.compile(r"[-+]?[\d.]+(?:[eE][-+]?\d+)?")


def _axis_name(name: str) -> str:
    if name not in AXES:
        fault("is no axis; there are x, y and z")
    return name


AxisName = Annotated[str, AfterValidator(_axis_name)]
Sha256 = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]


class DataSource(Part):
    """A recording the stage was fitted on."""

    file: str = Field(description="name of the recording")
    sha256: Sha256 = Field(description="SHA-256 of its file, else of its samples")
    rows_s: Times | None = Field(None, description="s, first and last of its rows that were used")


class Provenance(Part):
    """Where the stage file came from."""

    parent_sha256: Sha256 | None = Field(None, description="hash of the stage file this one was derived from")
    data: tuple[DataSource, ...] = Field((), description="recordings it was fitted on")
    left_out: tuple[str, ...] | None = Field(None, description="recordings that could not be used, and why")
    tool: str = Field("", description="program and version that wrote it")
    created: str = Field("", description="when, ISO 8601")

    def holds_rows_of(self, recording: Recording) -> bool:
        """Whether it is known that the stage was fitted on scored rows of a recording: an older stage file lacks
        ``rows_s``."""
        digests, (first_s, last_s) = (recording.sha256, recording.samples_sha256), recording.scored_s
        used_s = [source.rows_s for source in self.data if source.rows_s and source.sha256 in digests]
        return any(first_s <= to_s and from_s <= last_s for from_s, to_s in used_s)

    @field_validator("parent_sha256", mode="before")
    @classmethod
    def _empty_is_none(cls, value: object) -> object:
        return None if value == "" else value


def provenance_of(parent: Stage | None, recordings: Sequence[Recording]) -> Provenance:
    """Of a stage file that is made now, by this program, from the one before and from what was learned."""
    traced = [(r.traced, r.scored_s) for r in recordings]
    names = shortest_names({source.name for source, _ in traced})
    sources = {
        (source.sha256, rows_s): DataSource(file=names[source.name], sha256=source.sha256, rows_s=rows_s)
        for source, rows_s in traced
    }
    now = datetime.datetime.now(datetime.UTC).replace(microsecond=0)
    return Provenance(
        parent_sha256=parent.sha256 if parent is not None else None,
        data=tuple(sources.values()),
        tool=f"phaselead {PROGRAM_VERSION}",
        created=now.isoformat().replace("+00:00", "Z"),
    )


class Stage(Result, Part):
    """The model of a stage, as a stage file holds it.

    ``axes`` is keyed "x", "y", "z"; ``cross_coupling[i][j]`` is what i sees of j.
    Nothing in it can be changed; ``model_copy(update=...)`` gives a changed copy. Raises pydantic's ValidationError for
    values that make no sense.

    >>> import phaselead as pl
    >>> with pl.connect() as dev:
    ...     model = pl.fit(dev.record("sine:5V@5Hz", duration=1)).model
    >>> model.save("stage.toml")
    >>> pl.load("stage.toml") == model
    True
    >>> sorted(model.axes), model.axis("x").time.gain_um_per_V > 5
    (['x'], True)
    """

    format: Literal["phaselead-stage"] = FORMAT
    version: Literal[1] = VERSION
    name: str = Field(description="name of the stage")
    provenance: Provenance = Provenance()
    cross_coupling: Matrix3 | None = Field(
        None, description="row: responding axis, column: driven axis (x, y, z); diagonal 1"
    )
    axes: dict[AxisName, AxisModel] = Field(min_length=1)

    @field_validator("cross_coupling")
    @classmethod
    def _diagonal_is_one(cls, matrix: Matrix3 | None) -> Matrix3 | None:
        for i, row in enumerate(matrix or ()):
            if row[i] != 1:
                fault(f"= {row[i]:g}: must be 1; an axis' own gain belongs to its own model", f"[{i}][{i}]")
        return matrix

    @model_validator(mode="after")
    def _effects_are_known(self) -> Self:
        for axis, model in self.axes.items():
            for i, adopted in enumerate(model.effects):
                if adopted.name not in catalogue():
                    known = nearest(adopted.name, catalogue())
                    fault(f"= {adopted.name!r}: is no known effect; {known}", f"axes.{axis}.effects[{i}].name")
        return self

    @property
    def sha256(self) -> str:
        """Hash of the content: keys and exact values, not comments or layout."""
        content = self.model_dump(mode="json", exclude_none=True)
        canonical = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
        return hashlib.sha256(canonical.encode()).hexdigest()

    @property
    def columns(self) -> dict[str, list[Any]]:
        """One entry for each parameter: axis, part, parameter, value, low_95, high_95 (nan where not known)."""
        return parameter_columns(self.axes)

    def tables(self) -> list[Table | str]:
        about: dict[str, Any] = {"stage": self.name, "sha256": self.sha256[:12], "records": len(self.provenance.data)}
        about |= {
            key: text for key, text in (("made by", self.provenance.tool), ("on", self.provenance.created)) if text
        }
        return [pairs_table(about), axis_table(self.axes), parameter_table(self.axes)]

    def plot(self) -> Figure:
        """The steady loop of every axis over the voltages it was fitted on, without the adopted effects."""
        return stage_figure(self.axes)

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Writes a commented stage file, whole or not at all. Raises BadInput where it exists and ``overwrite`` is
        False, OSError where it cannot be written."""
        save_stage(path, self, overwrite=overwrite)

    def __repr__(self) -> str:
        return f"<Stage {self.name!r}: axes {', '.join(sorted(self.axes))}, {self.sha256[:12]}>"

    def axis(self, name: str) -> AxisModel:
        """The model of one axis; BadInput when the stage has none."""
        if name not in self.axes:
            raise BadInput(
                f"stage {self.name!r} has no axis {name}; it has {', '.join(sorted(self.axes))}: "
                f"choose one of these, or identify {name}"
            )
        return self.axes[name]

    def with_effect(self, name: str, axis: str = "x", **params: float | Sequence[float]) -> Self:
        """A copy in which this axis has one more effect of the catalogue, so that a virtual stage can be changed.

        Raises BadInput for an axis that the stage lacks, and for an effect, a parameter or a value that is not in the
        catalogue.

        >>> import phaselead as pl
        >>> pl.load("sim://xyz250").with_effect("amplifier_lowpass", tau_s=5e-4).save("changed.toml")
        >>> with pl.connect("sim://changed.toml") as dev:
        ...     record = dev.record("sine:5V@5Hz", duration=0.4)
        """
        before = self.axis(axis)
        with explained(f"effect {name} of {self.name}"):
            effect = AdoptedEffect.model_validate({"name": name, "params": params})
            after = before.model_copy(update={"effects": (*before.effects, effect)})
            changed = type(self).model_validate(dict(self) | {"axes": {**self.axes, axis: after}})
        _refuse_parameters(f"effect {name} of {self.name}", effect, "params")
        return changed


def load_stage(path: str | Path) -> Stage:
    """Read a stage file. Raises BadInput with one line that names the file, the key and the fix."""
    try:
        with open(path, "rb") as file:
            content = file.read(LARGEST_FILE + 1)
    except OSError as error:
        raise BadInput(f"{path}: cannot be read ({error.strerror}); give a stage file (.toml)") from None
    except ValueError:  # a NUL in the path
        raise BadInput(f"{path!r}: is no file name; give a stage file (.toml)") from None
    if len(content) > LARGEST_FILE:
        raise BadInput(f"{path}: is larger than any stage file (16 MiB); is it one?")
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError:
        raise BadInput(f"{path}: is not text, but a stage file (.toml) is; is it a recording?") from None
    return parse_stage(text, str(path))


def parse_stage(text: str, source: str = "stage") -> Stage:
    """A stage from the text of its file; ``source`` names it in messages."""
    try:
        content = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        if _is_table(text):
            raise BadInput(f"{source}: has columns, but a stage file (.toml) has keys; is it a recording?") from None
        if text.lstrip().startswith("{"):
            raise BadInput(f"{source}: is JSON, but a stage file is TOML; give the .toml beside it") from None
        reason = " ".join(str(error).split())[:200]
        raise BadInput(f"{source}: is not TOML: {reason}; repair the line, or fit the stage file again") from None
    if content.get("format") != FORMAT:
        raise BadInput(f'{source}: is no stage file; one begins with format = "{FORMAT}"')
    version = content.get("version")
    if isinstance(version, int) and version > VERSION:
        raise BadInput(
            f"{source}: was written by a newer phaselead (format version {version}; this one knows "
            f"{VERSION}); update phaselead"
        )
    try:
        stage = Stage.model_validate(content)
    except ValidationError as error:
        raise BadInput(f"{source}: {explain(error, Stage)}") from None
    for axis, model in stage.axes.items():
        for i, adopted in enumerate(model.effects):
            _refuse_parameters(source, adopted, f"axes.{axis}.effects[{i}].params")
    return stage


def _is_table(text: str) -> bool:
    """Whether the first line is one of a recording: names of columns, or numbers."""
    first = next((line for line in text.splitlines() if line.strip() and line.lstrip()[0] not in "#%"), "")
    fields = [field.strip(' "') for field in re.split(r"[,;\t]", first)]
    return own_header(fields) or (len(fields) > 1 and all(_NUMBER.fullmatch(field) for field in fields))


def _refuse_parameters(source: str, adopted: AdoptedEffect, key: str) -> None:
    """Raises BadInput for a parameter that the effect has not, and for a value outside its range."""
    known = catalogue()[adopted.name]
    for name, value in adopted.params.items():
        if (wrong := known.fault_of(name, value)) is not None:
            raise BadInput(f"{source}: {key_path((key, name))} {wrong}")


def save_stage(path: str | Path, stage: Stage, *, overwrite: bool = True) -> None:
    """Write a commented stage file, whole or not at all. ``load_stage`` gives back an equal Stage."""
    write_text(path, stage_text(stage), overwrite=overwrite)


def stage_text(stage: Stage) -> str:
    """The commented TOML of a stage."""
    return toml_text(stage)
