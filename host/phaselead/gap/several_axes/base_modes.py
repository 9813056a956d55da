"""The modes that the axes of a stage file share, as the fit of modes has them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from phaselead.errors import BadInput
from phaselead.gap.several_axes.common_modes import CommonModes
from phaselead.gap.several_axes.in_front import no_shaping
from phaselead.gap.several_axes.joint_records import Entries, JointRecord, effect_of
from phaselead.identify import ModalModel, fit_modes
from phaselead.model import AxisModel, Complex, Params, Stage, state_weights
from phaselead.record import Samples


def has_common_modes(stage: Stage) -> bool:
    """Whether an axis has adopted modes that the axes share."""
    return any(_own_path(axis) is not None for axis in stage.axes.values())


def modes_as_they_are(stage: Stage, train: Sequence[JointRecord]) -> CommonModes:
    """The modes, gains, coupling and softening of a stage file, nothing fitted; the records say how exact they are.

    Raises BadInput where not every axis has the same modes.
    """
    axes = {a: stage.axes[a] for a in train[0].axes}
    model = _modal_model(axes)
    softening = _softening(axes)
    fit = fit_modes(model.poles, no_shaping(train, softening), split=model.participation(), most_steps=0, held=model)
    return CommonModes(fit, softening, model.participation(), given=softening, modes_kept=True)


def _own_path(axis: AxisModel) -> Params | None:
    """Parameters of the modes of an axis' own path; None where it has none that axes share."""
    found = _params_of(axis, effect_of("own path").name)
    return found if found is not None and "velocity" in found else None


def _params_of(axis: AxisModel, name: str) -> Params | None:
    effects = [e.params for e in axis.effects if e.name == name]
    return effects[0] if effects else None


def _softening(axes: Mapping[str, AxisModel]) -> Entries:
    """The softening of every axis that has one."""
    effect = effect_of("level")
    found = {name: _params_of(axis, effect.name) for name, axis in axes.items()}
    return {name: [(effect, effect.complete(params))] for name, params in found.items() if params is not None}


def _modal_model(axes: Mapping[str, AxisModel]) -> ModalModel:
    own = {name: _own_path(axis) for name, axis in axes.items()}
    coupled = {name: _params_of(axis, effect_of("coupling").name) for name, axis in axes.items()}
    first = next((params for params in own.values() if params is not None), None)
    lists = [*own.values(), *(params for params in coupled.values() if params is not None and "f_Hz" in params)]
    if first is None or any(params is None or not _same_modes(params, first) for params in lists):
        raise BadInput(
            "--frozen: the axes of the model do not have the same modes f_Hz and zeta in resonance and cross_coupling; "
            "give --refit, which fits them anew"
        )
    f_Hz, zeta = _list(first, "f_Hz"), _list(first, "zeta")
    poles: Complex = np.asarray(2 * np.pi * f_Hz * (-zeta + 1j * np.sqrt(1 - zeta**2)))
    weights = np.zeros((len(axes), 1 + 2 * len(poles), len(axes)))  # actuator, what it drives, sensor
    for i, name in enumerate(axes):
        params = own[name]
        assert params is not None
        c = _list(params, "c")
        weights[i, 0, i], weights[i, 1:, i] = 1 - c.sum(), state_weights(c, _list(params, "velocity"), zeta)
        across = coupled[name] or {}
        for j, other in enumerate(axes):
            if f"velocity_{other}" in across and j != i:
                share, velocity = _list(across, f"from_{other}"), _list(across, f"velocity_{other}")
                weights[j, 0, i] = float(_list(across, f"direct_{other}")[0])
                weights[j, 1:, i] = state_weights(share, velocity, zeta)
    in_order = np.concatenate([weights[:, 0], weights[:, 1:].reshape(-1, len(axes))])
    return ModalModel(poles, in_order, len(axes), _drop(axes, zeta))


def _drop(axes: Mapping[str, AxisModel], zeta: Samples) -> Complex | None:
    """(m, axes) fall of every pole with the level of each actuator; None where no level moves them."""
    found = [_params_of(axis, effect_of("level").name) or {} for axis in axes.values()]
    if not any("f_drop" in params for params in found):
        return None
    none = np.zeros(len(zeta))
    falls = [(_list(p, "f_drop"), _list(p, "zeta_rise")) if "f_drop" in p else (none, none) for p in found]
    return np.stack([f_drop - 1j * zeta_rise / np.sqrt(1 - zeta**2) for f_drop, zeta_rise in falls], axis=1)


def _same_modes(params: Params, first: Params) -> bool:
    return all(np.array_equal(_list(params, key), _list(first, key)) for key in ("f_Hz", "zeta"))


def _list(params: Params, name: str) -> Samples:
    return np.atleast_1d(np.asarray(params[name], dtype=np.float64))
