"""Models: load, fit, verify, predict, and their feedback loop."""

from __future__ import annotations

import os
from pathlib import PurePath
from typing import TYPE_CHECKING, get_args

from phaselead.errors import BadInput

if TYPE_CHECKING:
    from phaselead.control import GainsLike, Loop
    from phaselead.identify import Base, FitResult, Verifications, View
    from phaselead.model import Stage, StageLike
    from phaselead.record import MapLike, Recording, RecordLike, RecordsLike


def load(path: str | os.PathLike[str]) -> Stage:
    """Reads a stage file; ``sim://xyz250`` is that of a built-in virtual stage, which knows its own truth.

    Raises BadInput with one line that names the file, the key and the fix.

    >>> import phaselead as pl
    >>> with pl.connect() as dev:
    ...     pl.fit(dev.record("sine:5V@5Hz", duration=1)).save("stage.toml")
    >>> sorted(pl.load("stage.toml").axes)
    ['x']
    >>> sorted(pl.load("sim://xyz250").axes)
    ['x', 'y', 'z']
    """
    from phaselead.model import load_stage
    from phaselead.sim import stage_at

    place = os.fspath(path)
    return stage_at(place) if place.startswith("sim://") else load_stage(place)


def fit(
    records: RecordsLike,
    *,
    base: Base = "operator",
    creep: bool = True,
    name: str = "fitted",
    parent: StageLike | None = None,
    map: MapLike | None = None,
    rate: str | float | None = None,
) -> FitResult:
    """Fits a model to recordings: the time view, and the table view where these are sines of several levels.

    ``records`` as for ``read``, or recordings and runs. ``base="linear"`` is gain and offset only. Creep is looked for
    unless ``creep=False``. ``parent`` gives name, limits, calibration and gains; where these are nobody's choice, a
    model that shows a mode gets gains designed for it. The result is taken wherever a model is.

    Records of which nothing can be used (clipped, gapped, still) are left out: ``report.left_out`` says which and why.
    Raises BadInput, one line, when none remains, none goes round a loop, or rates are mixed, and for another ``base``.

    >>> import phaselead as pl
    >>> with pl.connect() as dev:
    ...     fitted = pl.fit(dev.record("sine:5V@5Hz", duration=1))
    >>> fitted.model.axis("x").time.gain_um_per_V > 5
    True
    """
    from phaselead.control import with_gains
    from phaselead.identify import Base, FitResult
    from phaselead.identify import fit as fit_stage
    from phaselead.model import as_stage
    from phaselead.record import gather

    if base not in get_args(Base):
        raise BadInput(f"base={base!r}: a fit has one of the bases {', '.join(get_args(Base))}")
    found = gather(records, map, rate)
    known = None if parent is None else as_stage(parent)
    stage, report = fit_stage(found, base, name=name, parent=known, creep=creep)
    return FitResult(with_gains(stage), report, found)


def verify(
    model: StageLike,
    records: RecordsLike,
    *,
    view: View = "time",
    refit_offset: bool = False,
    map: MapLike | None = None,
    rate: str | float | None = None,
) -> Verifications:
    """Judges a model on recordings that it was not fitted on; nothing is refitted but, if asked, the offset.

    ``model``: a stage, the result of a fit, or a stage file's name. ``view`` "time" starts from rest at 0 V before the
    first row; "table" answers the sine that the voltage is. Errors in um and in per cent of the measured range.

    Records of which nothing can be used (clipped, gapped, still) are left out: ``left_out`` says which and why, and
    ``doubts`` which seem to be in other units or of another stage. Raises BadInput when none remains and when the model
    lacks that view, or an axis of a record.

    >>> import phaselead as pl
    >>> with pl.connect() as dev:
    ...     fitted = pl.fit(dev.record("sine:5V@5Hz", duration=1))
    ...     other = dev.record("sine:4V@5Hz", duration=1)
    >>> pl.verify(fitted, other)[0].mean_pct < 5
    True
    """
    from phaselead.identify import judge
    from phaselead.model import as_stage
    from phaselead.record import gather

    stage = as_stage(model)
    given = PurePath(model).name if isinstance(model, str | os.PathLike) else stage.name
    return judge(stage, gather(records, map, rate), view, given, refit_offset=refit_offset)


def predict(
    model: StageLike, record: RecordLike, *, map: MapLike | None = None, rate: str | float | None = None
) -> Recording:
    """The model's answer to the voltage of one recording, from rest at 0 V before the first row.

    Gives a recording of the same times and voltages, with the predicted positions, shape (n,). Raises BadInput when
    voltage or time view is missing, and for several recordings.

    >>> import phaselead as pl
    >>> with pl.connect() as dev:
    ...     record = dev.record("sine:5V@5Hz", duration=1)
    >>> predicted = pl.predict(pl.fit(record), record)
    >>> bool(abs(predicted.x_um - record.x_um).mean() < 1)
    True
    """
    from phaselead.model import as_stage
    from phaselead.model import predict as predict_position
    from phaselead.record import gather_one

    return predict_position(as_stage(model), gather_one(record, map, rate))


def loop(model: StageLike, axis: str = "x", *, gains: GainsLike | None = None) -> Loop:
    """The feedback loop of one axis on its model: open loop, sensitivity, margins, bandwidth, before anything moves.

    ``gains`` as for ``track``: "paper", (KP, KI, KD) in V/um, V/(um s), V s/um, or ``Gains``; default the model's own,
    else those designed for it. Raises BadInput for a model without a time view or gains that make no sense.

    >>> import phaselead as pl
    >>> with pl.connect() as dev:
    ...     model = pl.fit(dev.record("sine:5V@5Hz", duration=1))
    >>> print(pl.loop(model, gains="paper"))  # doctest: +ELLIPSIS
    loop of axis x
    local gain (um/V) ...
    """
    from phaselead.control import gains_of, loop_of
    from phaselead.model import as_stage

    stage = as_stage(model)
    return loop_of(axis, stage.axis(axis), gains_of(gains, stage, axis))
