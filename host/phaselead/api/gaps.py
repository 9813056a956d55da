"""Where model and measurement disagree: compare, run the next experiment, write the page."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import PurePath
from typing import TYPE_CHECKING

from phaselead.errors import BadInput

if TYPE_CHECKING:
    from phaselead.control import Learned, Run
    from phaselead.gap import GapResult
    from phaselead.identify import FitResult, Verifications
    from phaselead.model import StageLike
    from phaselead.record import MapLike, Recording, RecordsLike


def gap(
    model: StageLike,
    *,
    train: RecordsLike,
    holdout: RecordsLike,
    reference: RecordsLike = (),
    frozen: bool | None = None,
    verify_on: str | None = None,
    map: MapLike | None = None,
    rate: str | float | None = None,
    on_progress: Callable[[float], None] | None = None,
) -> GapResult:
    """Finds where model and measurement disagree, names the missing effect or says why not, and adds it.

    Effects are fitted to ``train`` and must pay on ``holdout``; ``reference`` are records known to be without what is
    missing. ``frozen``: whether the base is kept as it is; by default it is where there are references, which say how
    far it may be off. ``verify_on`` is a port: the same paths are tracked there under the model before and the one
    after. The given model is untouched; ``next_model`` of the result holds what was found.

    Raises BadInput, one line, for records that cannot be compared and for a ``frozen`` that is neither True, False nor
    None; LinkError at once when ``verify_on`` is no device.

    >>> import numpy as np
    >>> import phaselead as pl
    >>> def made(f_Hz, seed):
    ...     t_s = np.arange(300) / 200
    ...     u_V = 2.5 - 2.5 * np.cos(2 * np.pi * f_Hz * t_s)
    ...     noise_um = np.random.default_rng(seed).normal(0, 0.01, 300)
    ...     return pl.recording(t_s=t_s, u_V=u_V, x_um=20 * u_V + noise_um)
    >>> model = pl.fit(made(2, seed=0), base="linear")
    >>> gap = pl.gap(model, train=made(2, seed=1), holdout=made(3, seed=2))
    >>> gap.verdicts
    ('none',)
    """
    from phaselead.freed_memory import keep_freed_memory
    from phaselead.gap import check_port, run_gap, verified_on
    from phaselead.model import as_stage
    from phaselead.record import gather_parts

    if not (frozen is None or isinstance(frozen, bool)):
        raise BadInput(f"frozen={frozen!r}: give True, False, or None to have the references decide")
    stage = as_stage(model)
    parts = gather_parts((train, holdout, reference), map, rate)
    if verify_on is not None:
        check_port(verify_on)
    keep_freed_memory()
    result = run_gap(stage, *parts, frozen=frozen, on_progress=on_progress)
    return result if verify_on is None else verified_on(verify_on, stage, result)


def gap_next(
    proposal: GapResult | str | os.PathLike[str],
    port: str | None = None,
    *,
    output: str | os.PathLike[str],
    axis: str | None = None,
    model: StageLike | None = None,
    overwrite: bool = False,
    on_progress: Callable[[float], None] | None = None,
) -> Recording:
    """Runs the experiment that a tie asks for, open loop, and keeps the record in ``output`` (.h5).

    ``proposal`` is the result of ``gap`` or a gap.json. ``axis`` is by default that of the tie, and x where the
    proposal does not say. ``model`` has limits and calibration; it is uploaded first. Raises BadInput when no
    experiment is proposed, for another axis than the tie's, and for an output that exists unless ``overwrite``, and
    what the device says.

    >>> import phaselead as pl
    >>> pl.gap_next("gap.json", output="more.h5")
    Traceback (most recent call last):
    phaselead.errors.BadInput: gap.json: cannot be read (No such file or directory); make it with phaselead gap --json
    """
    from phaselead.gap import GapResult, axis_driven, proposal_of, read_proposal, run_proposal
    from phaselead.model import as_stage
    from phaselead.record import RUN_SUFFIXES, check_output, gather_one
    from phaselead.serial_ports import default_port

    inputs = [one for one in (proposal, model) if isinstance(one, str | os.PathLike)]
    check_output(os.fspath(output), suffixes=RUN_SUFFIXES, inputs=inputs, overwrite=overwrite)
    if isinstance(proposal, str | os.PathLike):
        proposed = read_proposal(os.fspath(proposal))
    elif isinstance(proposal, GapResult):
        proposed = proposal_of(proposal.as_json(), "this result")
    else:
        raise BadInput(f"a {type(proposal).__name__} proposes no experiment; give the result of gap, or a gap.json")
    stage = None if model is None else as_stage(model)
    driven = axis_driven(proposed, axis)
    run_proposal(proposed, port or default_port(), driven, os.fspath(output), stage, on_progress)
    return gather_one(output)


def write_report(
    result: GapResult | FitResult | Verifications | Run | Learned,
    path: str | os.PathLike[str],
    *,
    model_name: str = "",
    overwrite: bool = False,
) -> None:
    """Writes the page of a result: of a gap where, what, why not the runner-up, before and after; of a fit, a
    verification, a run or what was learned its figures and tables. One file, no network.

    ``model_name`` is what the page of a gap calls the model; default its name. Raises BadInput for a gap that ``gap``
    did not make, for what has no page, and for a file that exists unless ``overwrite``, OSError where the file cannot
    be written.

    >>> import numpy as np
    >>> import phaselead as pl
    >>> def made(f_Hz, seed):
    ...     t_s = np.arange(300) / 200
    ...     u_V = 2.5 - 2.5 * np.cos(2 * np.pi * f_Hz * t_s)
    ...     noise_um = np.random.default_rng(seed).normal(0, 0.01, 300)
    ...     return pl.recording(t_s=t_s, u_V=u_V, x_um=20 * u_V + noise_um)
    >>> model = pl.fit(made(2, seed=0), base="linear")
    >>> gap = pl.gap(model, train=made(2, seed=1), holdout=made(3, seed=2))
    >>> pl.write_report(gap, "gap.html")
    """
    from phaselead.gap import GapResult
    from phaselead.record import write_text
    from phaselead.report import gap_page, result_page

    if not isinstance(result, GapResult):
        write_text(os.fspath(path), result_page(result), overwrite=overwrite)
        return
    if result.base is None:
        raise BadInput("this result does not say which model was compared; make it with phaselead.gap")
    name = model_name or PurePath(result.base.name).name
    write_text(os.fspath(path), gap_page(result, name), overwrite=overwrite)
