"""Whether the records are of the model's stage, in its units and within its range: how far they move beside what the
model says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.signal import detrend

from phaselead.errors import BadInput, more_like_it
from phaselead.gap.goodness_of_fit import FinalFit
from phaselead.gap.history import stands_off
from phaselead.gap.posterior import TIMES_BASE, names_of
from phaselead.gap.records import GapRun, Role
from phaselead.gap.residual import RunResidual, modelled_run
from phaselead.gap.selection import Selection
from phaselead.identify import fitted_span_V
from phaselead.model import AxisModel, Place, Stage, as_far, out_of_scale, range_um, scale_doubt
from phaselead.quantity import digits
from phaselead.record import Samples, factors_moved, in_another_unit, seem_exchanged, slow_gain, unit_remedy

ROLES: dict[Role, str] = {"train": "training", "holdout": "held-out", "reference": "reference"}
MOST_UNLIKE = TIMES_BASE[-1]
"""Times what the model leaves of other records, beyond which a record is not like them: to the judge it differs from
the reference records by no more."""
MOST_AT_REST = 0.2
"""Share of its travel by which a stage may move at rest, about a straight line: creep after a step over all of it is 10
to 15 % (Jung and Gweon 2000), and surroundings shake none as far."""
UNFITTED = 0.05
"""Share of the fitted range by which a record may leave it without a warning. Beyond that a base that goes straight on,
of a stage whose slope changes by a fifth over its range, is off by 0.025 % of the travel."""
Moved = tuple[GapRun, Samples, Samples]
"""A record, what the model says of it from the memory that suits it best, and its position, (n,) in um over the scored
rows."""
Compared = Mapping[str, Sequence[Moved]]
"""By axis its driven records."""


class _Left(NamedTuple):
    """RMS that a model leaves of some records, each about its mean."""

    share: float
    """Of their motion; infinite at rest, where there should be none."""
    um: float

    def far_beyond(self, known: _Left) -> bool:
        """Whether it is far more than what is left of others, as a share and in um."""
        return self.share > MOST_UNLIKE * known.share and self.um > MOST_UNLIKE * known.um


_LeftOfRecord = tuple[str, _Left]
"""Name of a record, and what a model leaves of it."""


class FarAbove(NamedTuple):
    """Records of which far more is left than is known of a model."""

    um2: float
    """Mean square, over the rows of all that were asked, of what is left of them; 0 where there are none."""
    farthest: str
    """The record of which most is left."""
    farthest_um: float
    """RMS of that."""
    known: str
    """What is known, for a person."""


def beside_model(stage: Stage, runs: Mapping[str, Sequence[GapRun]]) -> Compared:
    """By axis the driven records, each with what the model says of it and its position."""
    return {
        axis: [(run, modelled_run(stage.axes[axis], run).answer(), run.x_um[run.rows]) for run in of_axis if run.driven]
        for axis, of_axis in runs.items()
    }


def model_doubts(stage: Stage, driven: Compared) -> list[str]:
    """Whether the records are of the model's stage: lines on all axes that are out of scale, then on those whose roles
    seem exchanged, then on those that go beyond the fit."""
    return [
        line
        for asked in (_out_of_scale, _exchanged, _beyond_fit)
        for axis, of_axis in driven.items()
        for line in asked(axis, stage.axes[axis], of_axis)
    ]


def led_beyond_fit(selection: Selection) -> list[str]:
    """One line where an effect that is named moves the voltage at the ceramic beyond those that the model was fitted
    to, and further than the records go, by what it does in them and had done before. None of a set that was not fitted
    as it is."""
    fit = selection.contest.fits.get(names_of(selection.entries))
    named = {claim.effect.name for claim in selection.claims if len(claim.tied) == 1}
    names = [] if fit is None else [effect.name for effect, _ in fit.entries if stands_off(effect)]
    if fit is None or not named.intersection(names):
        return []
    acting = [one for one in selection.contest.likelihood.acting(fit.entries, fit.terms.stood) if one[1]]
    by_itself = _span_V([modelled.chain.signal_at(Place.AMPLIFIER).value for modelled, _ in acting])
    moved = _span_V([modelled.chain.signal_at(Place.AMPLIFIER, extra).value for modelled, extra in acting])
    beyond = _beyond_range(selection.base, *moved)
    if beyond is None or not (moved[0] < by_itself[0] or moved[1] > by_itself[1]):
        return []
    least_V, most_V = (digits(one, 3) for one in moved)
    return [
        f"{' and '.join(names)} moves the voltage at the ceramic over {least_V} to {most_V} V, {beyond}; fit it to "
        "records that go as far"
    ]


def _span_V(voltages: Sequence[Samples]) -> tuple[float, float]:
    """The lowest and the highest of some voltages (n_i,)."""
    return min(float(v.min()) for v in voltages), max(float(v.max()) for v in voltages)


def _beyond_range(model: AxisModel, least_V: float, most_V: float) -> str | None:
    """What to say of voltages that are beyond those that a model was fitted to, None of others."""
    assert model.time is not None
    low, high = model.time.u_range_V
    within = UNFITTED * (high - low)
    if low - within <= least_V and most_V <= high + within:
        return None
    return f"and the model was fitted from {digits(low, 3)} to {digits(high, 3)} V: beyond that it is a guess"


def _beyond_fit(axis: str, model: AxisModel, driven: Sequence[Moved]) -> list[str]:
    """One line where records go beyond the voltages that the model was fitted to: what it says there is a guess."""
    spans = [(run, *fitted_span_V([run.as_fitted])) for run, _, _ in driven]
    told = [(run, least_V, most_V, _beyond_range(model, least_V, most_V)) for run, least_V, most_V in spans]
    far = [one for one in told if one[3] is not None]
    if not far:
        return []
    (run, least_V, most_V, beyond), *more = far
    return [
        f"{run.source}: axis {axis} is driven from {digits(least_V, 3)} to {digits(most_V, 3)} V, {beyond}"
        f"{more_like_it(len(more))}; fit it to records that go as far"
    ]


def _exchanged(axis: str, model: AxisModel, driven: Sequence[Moved]) -> list[str]:
    """One line where the model describes the reference records far worse than the others, and than its fit says that it
    described its own records: it was made of them, so they may have been given in the others' place.

    What the fit left counts since references that are quick leave more than others that are slow, exchanged or not.
    """
    left = {role: _left([moved for moved in driven if moved[0].role == role]) for role in ROLES}
    reference, others = left.pop("reference"), [one for one in left.values() if one is not None]
    if reference is None or not others:
        return []
    # Of small motion noise is a large share; exchanged records leave more in um too.
    most, own = _most(others), _own_fit(model)
    if not reference.far_beyond(most) or (own is not None and reference.um <= MOST_UNLIKE * own.um):
        return []
    return [
        f"{axis}: of the reference records' motion the model leaves {digits(100 * reference.share, 2)} %, of the "
        f"others' at most {digits(100 * most.share, 2)} %: were they exchanged? --reference takes records of when the "
        "model fitted"
    ]


def unlike_others(final: FinalFit) -> list[str]:
    """One line for the held-out records, and beside reference records one for the training records, where the model
    with what was found leaves far more of one of them than of any record of the other roles: what moved the stage then
    is in none of these. Without reference records the training records may be the only ones that are quick."""
    every = {role: _left_of_each(final.residuals(role)) for role in ROLES}
    left = {role: [one for one in of_role if np.isfinite(one[1].share)] for role, of_role in every.items()}
    found = []
    for role in ("train", "holdout") if left["reference"] else ("holdout",):
        others = [one for other, of_role in left.items() if other != role for _, one in of_role]
        found += _unlike(left[role], others) if others else []
    return found


def far_above_known(final: FinalFit, residuals: Sequence[RunResidual]) -> FarAbove:
    """The records of which the final model leaves far more than of any reference record, or without driven ones of
    these than its own fit left. At rest only um count. None where the stage file does not say what the fit left."""
    references = [one for _, one in _left_of_each(final.residuals("reference"))]
    driven = any(np.isfinite(one.share) for one in references)
    known = _most(references) if driven else _own_fit(final.before[0].axis)
    of = "any reference record" if driven else "what the model was fitted to"
    left = [(r, one) for r in residuals for _, one in _left_of_each([r])]
    far = [(r, one) for r, one in left if known is not None and one.far_beyond(known)]
    if not far:
        return FarAbove(0.0, "", 0.0, of)
    rows = sum(len(r.error_um) for r in residuals)
    farthest, most = max(far, key=lambda pair: pair[1].um)
    return FarAbove(sum(float(np.sum(r.error_um**2)) for r, _ in far) / rows, farthest.run.name, most.um, of)


def _own_fit(model: AxisModel) -> _Left | None:
    """What a model left of its own records, beside a sine over its range; None where the stage file does not say."""
    assert model.time is not None
    um = model.time.residual_um_rms
    return _Left(um / (range_um(model) / np.sqrt(8)), um) if um else None


def _most(left: Sequence[_Left]) -> _Left:
    """The most that is left of some records, of which some are driven: those at rest have no share."""
    return _Left(max(one.share for one in left if np.isfinite(one.share)), max(one.um for one in left))


def _unlike(records: Sequence[_LeftOfRecord], others: Sequence[_Left]) -> list[str]:
    """One line for the driven records of which far more is left than of any other, as a share of their motion and in
    um; none where there are none."""
    most = _most(others)
    far = [(name, one.share) for name, one in records if one.far_beyond(most)]
    if not far:
        return []
    name, share = max(far, key=lambda pair: pair[1])
    return [
        f"{name}: of its motion the model with what was found leaves {digits(100 * share, 2)} %, of the others "
        f"at most {digits(100 * most.share, 2)} %{more_like_it(len(far) - 1)}: is it of this stage, in its units, "
        "and driven no further or faster than the others?"
    ]


def _left_of_each(residuals: Sequence[RunResidual]) -> list[_LeftOfRecord]:
    """Name of every record at rest or well driven, and what the model leaves of it of which these are the residuals."""
    found = []
    for residual in residuals:
        run, x = residual.run, residual.run.x_um[residual.run.rows]
        if run.idle:
            found.append((run.name, _Left(np.inf, float(np.std(residual.error_um)))))
        elif run.driven_well and (one := _left([(run, x - residual.error_um, x)])) is not None:
            found.append((run.name, one))
    return found


def _left(driven: Sequence[Moved]) -> _Left | None:
    """What the model leaves of some records; None without any that moves."""
    rows = sum(len(x) for _, _, x in driven)
    moved = sum(float(np.var(x) * len(x)) for _, _, x in driven)
    left = sum(float(np.var(x - said) * len(x)) for _, said, x in driven)
    return _Left(float(np.sqrt(left / moved)), float(np.sqrt(left / rows))) if moved > 0 else None


def refuse_moved_at_rest(stage: Stage, runs: Mapping[str, Sequence[GapRun]]) -> None:
    """Refuse records whose position moves as no stage does while its voltage stands still. Raises BadInput, one
    line."""
    for axis, of_axis in runs.items():
        for run in of_axis:
            moved_um = _moves_by_itself_um(stage, run) if run.idle else 0.0
            if moved_um > MOST_AT_REST * range_um(stage.axes[axis]):
                raise BadInput(
                    f"{run.source}: axis {axis} moves {digits(moved_um, 2)} um while its voltage stands still: name "
                    "the column that drives it, or leave the record out"
                )


def _moves_by_itself_um(stage: Stage, run: GapRun) -> float:
    """How far a record at rest moves about a straight line, but for one row in a hundred and for what the model says of
    what was before."""
    left = detrend(run.x_um[run.rows] - modelled_run(stage.axes[run.axis], run).answer())
    low, high = np.quantile(left, [0.005, 0.995])
    return float(high - low)


def refuse_unlike_model(driven: Compared) -> None:
    """Refuse records whose motion is so far from what the model says that a column must be in another unit, and those
    that move as no stage does and whose voltage looks like a position. Raises BadInput, one line."""
    for axis, of_axis in driven.items():
        well = [(run, said, moved) for run, said, moved in of_axis if run.driven_well]
        found = factors_moved([(said, moved) for _, said, moved in well], [run.step_s for run, _, _ in well])
        exchanged = {i for i, factor in found.items() if out_of_scale(factor) and _seems_exchanged(well[i][0])}
        off = {i: factor for i, factor in found.items() if in_another_unit(factor) or i in exchanged}
        if not off:
            continue
        (first, factor), *more = off.items()
        of_all = len(off) == len(found)
        instead = "fit the model to this stage" if of_all else "leave the record out"
        swapped = _seems_exchanged(well[first][0])
        mend = "voltage and position seem exchanged: name them right" if swapped else unit_remedy(factor, of_all)
        raise BadInput(
            f"{well[first][0].source}: axis {axis} moves {as_far(factor)}"
            f"{more_like_it(len(more))}; {mend}, or {instead}"
        )


def _seems_exchanged(run: GapRun) -> bool:
    """Whether the columns of an open loop seem exchanged."""
    return run.r_um is None and seem_exchanged(run.u_V, run.x_um)


def _out_of_scale(axis: str, _: AxisModel, driven: Sequence[Moved]) -> list[str]:
    """One line where the records move as no change of the stage makes them: out of scale, or backwards."""
    known = _gains_of_roles(driven)
    off = {role: gain for role, gain in known.items() if out_of_scale(gain)}
    if not off:
        return _one_out_of_scale(axis, driven)
    roles = " and ".join(ROLES[role] for role in off)
    which = "records" if len(off) == len(known) else f"{roles} records"
    return [f"{axis}: the {which} move {scale_doubt(off.values())}"]


def _one_out_of_scale(axis: str, driven: Sequence[Moved]) -> list[str]:
    """One line where single records move as no change of the stage makes them: among others of their role they may not
    tell."""
    gains = [
        (run, slow_gain([(said, moved)])) for run, said, moved in driven if run.driven_well and _goes_far(said, driven)
    ]
    off = [(run, gain) for run, gain in gains if gain is not None and out_of_scale(gain)]
    if not off:
        return []
    (run, gain), *more = off
    return [
        f"{run.source}: axis {axis} moves {as_far(gain)}{more_like_it(len(more))}: "
        "check its units, signs and columns, or leave it out"
    ]


def _goes_far(said: Samples, driven: Sequence[Moved]) -> bool:
    """Whether the model says that a record goes as far as no stage does by itself."""
    return float(np.ptp(said)) > MOST_AT_REST * max(float(np.ptp(other)) for _, other, _ in driven)


def _gains_of_roles(driven: Sequence[Moved]) -> dict[Role, float]:
    """By how much the model's answer is to be multiplied to give the records of a role, slowly, where they tell."""
    known = {}
    for role in ROLES:
        pairs = [(said, moved) for run, said, moved in driven if run.role == role and np.ptp(said) > 0]
        gain = slow_gain(pairs)
        if gain is not None:
            known[role] = gain
    return known
