"""From records in which the axes of a stage move together to names: common modes, what couples, what softens.

The workflow of one axis cannot look at such records: cross-talk through a common structure is as large as an axis' own
path. Here the frequency response matrix leads to modes that all axes share, these to `resonance` and `cross_coupling`,
several levels to `softening`, and a score test of the rest of the catalogue shows what else could be there. Every name
must pay on the held-out records.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from phaselead.errors import BadInput
from phaselead.gap.axis import AxisResult
from phaselead.gap.multi_axis_fit import SharedFit, fit_linear, fit_softening
from phaselead.gap.multi_axis_judge import Judged, judge, pays
from phaselead.gap.multi_axis_records import Stand, level_groups, response_groups, stands
from phaselead.gap.multi_axis_result import Findings, axis_results
from phaselead.gap.multi_axis_scan import scan
from phaselead.gap.records import Run
from phaselead.identify import frequency_response
from phaselead.model import AxisModel, Effect, Stage
from phaselead.record import Recording

Report = Callable[[float], None]

NEEDED = ("resonance", "cross_coupling")
BARELY = 0.1
"""A stage that leaves less than this share of the power of records needs no common modes."""
KNOWN = 0.5
"""What the stage misses of reference records, as a share of what it misses of the held-out ones, from which on it is
the same that it misses: nothing new to name."""
LOWEST_LINES = 8
"""Of the frequency response, that stand for its static value."""


def search_together(
    stage: Stage,
    runs: Mapping[str, Sequence[Run]],
    holdout: Sequence[Recording],
    reference: Sequence[Recording],
    effects: Sequence[Effect],
    seed: int,
    report: Report,
) -> list[AxisResult] | None:
    """One result per axis, or None where the records or the stage are not of this kind."""
    names = {e.name for e in effects}
    if len(runs) < 2 or not all(name in names for name in NEEDED):
        return None
    together = stands({a: stage.axes[a] for a in runs}, runs)
    if together is None or not all(s.together for s in together if s.role != "reference"):
        return None
    before = judge(stage, holdout, list(runs))
    if not has_common_modes(stage) and before.share_left < BARELY:
        return None
    if reference and judge(stage, reference, list(runs)).share_left > KNOWN * before.share_left:
        return None
    models = _with_static_gains(stage, [s for s in together if s.role == "train"])
    if models is None:
        return None
    together = stands(models, runs)
    assert together is not None
    train = [s for s in together if s.role == "train"]
    held = [s for s in together if s.role == "holdout"]
    strongest, linear = fit_linear(train, lambda share: report(0.35 * share))
    softened = None
    if "softening" in names and len(level_groups(train)) > 1:
        softened = fit_softening(train, strongest, lambda share: report(0.35 + 0.5 * share))
    fit, soft = _chosen(linear, softened, held)
    others = scan(train, fit, effects)
    report(0.95)
    findings = Findings(stage, models, fit, linear, soft, others, before, train, held, tuple(e.name for e in effects))
    return axis_results(findings, runs, holdout, seed)


def has_common_modes(stage: Stage) -> bool:
    """Whether an axis has adopted modes that the axes share."""
    return any(e.name == "resonance" and "velocity" in e.params for a in stage.axes.values() for e in a.effects)


def _chosen(linear: SharedFit, softened: SharedFit | None, held: Sequence[Stand]) -> tuple[SharedFit, Judged | None]:
    """The softened modes where the held-out records want them."""
    if softened is None:
        return linear, None
    judged = pays(held, linear.answer, softened.answer)
    return (softened, judged) if judged.pays else (linear, judged)


def _with_static_gains(stage: Stage, train: Sequence[Stand]) -> dict[str, AxisModel] | None:
    """The axes, straight lines among them with the gain of the lowest lines of the frequency response: a line fitted
    to axes that move together has the sign of whatever resonates. None where there is no frequency response."""
    axes = train[0].axes
    try:
        response = frequency_response([s.experiment for s in response_groups(train)[0]])
    except BadInput:
        return None
    static = response.matrix[:LOWEST_LINES].real.mean(axis=0)
    models = {}
    for i, axis in enumerate(axes):
        model = stage.axes[axis]
        view = model.time
        assert view is not None
        straight = not (view.play_r_V or view.deadzone_d_V)
        if straight and not has_common_modes(stage) and abs(static[i, i]) > 0:
            model = model.model_copy(update={"time": view.model_copy(update={"gain_um_per_V": float(static[i, i])})})
        models[axis] = model
    return models
