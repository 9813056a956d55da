"""A fitted time view with the standard errors of its parameters, its residuals, and the sizes that were tried."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from phaselead.identify.operator.creep import Creep
from phaselead.identify.operator.regressors import FitRun, Turns, with_weight
from phaselead.identify.operator.solution import Solution, lag_column, linearised
from phaselead.model import (
    AxisModel,
    Entry,
    Mode,
    TimeView,
    effect_of_fading,
    effect_of_lag,
    rest_position_um,
    resting_at,
    turned_view,
)
from phaselead.record import Samples

SHOWN_RECORDS = 6
Z95 = 1.96
"""Standard errors to either side that hold 95 % of a normal distribution."""


@dataclass(frozen=True)
class Choice:
    """One size of the model that was tried, and its relative rms error on data left out."""

    n_plays: int
    n_segments: int
    left_out: float
    n_fading: int = 0
    chosen: bool = False

    @property
    def size(self) -> int:
        """How many slopes it has."""
        return self.n_plays + self.n_segments + self.n_fading


@dataclass(frozen=True)
class RecordResidual:
    """Residual of one record over the rows that the fit was asked to explain."""

    source: str
    rms_um: float
    max_um: float
    mean_um: float
    """With its sign: the record's own offset against the fitted one."""
    range_um: float
    turned_V: Turns | None
    """Where the voltage turned round before the record; () where it had gone to its first voltage straight and stood
    there, None where it stepped there from rest."""

    @staticmethod
    def of(fit: FitRun, residual: Samples, *, own_offset: bool) -> RecordResidual:
        """From what the fit leaves of a record (rows,) in um; an offset of its own is not counted against it."""
        mean = float(residual.mean())
        left = residual - mean if own_offset else residual
        rms, largest = float(np.sqrt(np.mean(left**2))), float(np.abs(left).max())
        return RecordResidual(fit.run.source, rms, largest, mean, fit.run.range_um, fit.turned_V)


@dataclass(frozen=True)
class OperatorFit:
    """A fitted time view and how sure its parameters are. Prints as a table.

    ``std`` is keyed like the fields of TimeView, and ``lag_s``; a parameter at its bound has none (nan). Rows whose
    residuals agree with their neighbours' count less (``effective_rows``); that the size of the model was chosen is not
    counted.
    """

    view: TimeView
    std: dict[str, tuple[float, ...]]
    records: tuple[RecordResidual, ...]
    choices: tuple[Choice, ...]
    messages: tuple[str, ...]
    effective_rows: float
    own_offsets: bool = False
    """Whether each record has an offset of its own."""
    modes: tuple[Mode, ...] = ()
    """Behind the operator, fitted together with it."""
    lag_s: float = 0.0
    """Time constant of a low-pass in front of the operator, fitted together with it."""
    lag_share: float = 0.0
    """Of the squared residual without that low-pass: what it explains."""
    fading_r_V: Samples = field(default_factory=lambda: np.zeros(0))
    """Thresholds (k,) of the fading plays."""
    fading_w_um_per_V: Samples = field(default_factory=lambda: np.zeros(0))
    """Their weights (k,); the gain of the view holds them."""
    creep: Creep | None = None
    """That was taken out of the records first; None of those that show none."""
    creep_share: float = 0.0
    """Of the squared residual without it: what it explains."""
    about_memories: tuple[str, ...] = ()
    """Of the messages those on where records began."""

    def beside_view(self) -> list[Entry]:
        """What the time view does not hold, as effects: a lag, what fades, and creep."""
        found = [effect_of_lag(self.lag_s)] if self.lag_s else []
        if len(self.fading_r_V):
            axis = AxisModel(time=self.view)
            found.append(effect_of_fading(self.fading_r_V, self.fading_w_um_per_V, axis))
        return [*found, self.creep.entry] if self.creep is not None else found

    def creeping(self, creep: Creep) -> OperatorFit:
        """The same fit, of records without this creep, as one of the records with it; creep that it has is replaced.
        About where the stage rests creep adds nothing."""
        bare = rest_position_um(self.view) / (1 if self.creep is None else self.creep.whole)
        return replace(self, view=resting_at(self.view, bare * creep.whole), creep=creep)

    @property
    def lag_ci95_s(self) -> tuple[float, float] | None:
        """95 % interval of the time constant; None where its standard error is not known."""
        (std,) = self.std["lag_s"]
        return (max(self.lag_s - Z95 * std, 0.0), self.lag_s + Z95 * std) if np.isfinite(std) else None

    def turned(self) -> OperatorFit:
        """The same fit to a sensor that counts the other way."""
        return replace(
            self,
            view=turned_view(self.view),
            fading_w_um_per_V=-self.fading_w_um_per_V,
            records=tuple(replace(record, mean_um=-record.mean_um) for record in self.records),
        )

    def __str__(self) -> str:
        view = self.view
        lines = [
            f"{'gain':14}{view.gain_um_per_V:12.5g} +- {self.std['gain_um_per_V'][0]:.2g} um/V",
            f"{'offset':14}{view.offset_um:12.5g} +- {self.std['offset_um'][0]:.2g} um",
            f"{'delay':14}{1e3 * view.delay_s:12.5g} +- {1e3 * self.std['delay_s'][0]:.2g} ms",
            f"{'rest fraction':14}{view.rest_fraction:12.5g} +- {self.std['rest_fraction'][0]:.2g}",
        ]
        if self.lag_s:
            lines.insert(3, f"{'lag':14}{1e3 * self.lag_s:12.5g} +- {1e3 * self.std['lag_s'][0]:.2g} ms")
        if view.field_bend:
            lines.append(f"{'field bend':14}{view.field_bend:12.5g} of half the voltage range")
        if not view.density.is_even:
            lines.append(f"{'play weights':14}{view.play_tilt:12.5g} tilt, {view.play_taper:.5g} taper")
        if self.creep is not None:
            lines.append(
                f"{'creep':14}{100 * self.creep.per_decade:12.5g} % per decade from {self.creep.first_s:.2g} s on"
            )
        pairs = zip(view.play_r_V, view.play_w_um_per_V, self.std["play_w_um_per_V"], strict=True)
        lines += [f"play {r:<9.4g}{w:12.5g} +- {s:.2g} um/V" for r, w, s in pairs]
        pairs = zip(self.fading_r_V, self.fading_w_um_per_V, self.std["fading_w_um_per_V"], strict=True)
        lines += [f"fading {r:<7.4g}{w:12.5g} +- {s:.2g} um/V" for r, w, s in pairs]
        pairs = zip(view.deadzone_d_V, view.deadzone_s_um_per_V, self.std["deadzone_s_um_per_V"], strict=True)
        lines += [f"dead zone {d:<+4.3g}{s:12.5g} +- {e:.2g} um/V" for d, s, e in pairs]
        lines.append(f"residual {view.residual_um_rms:.4g} um rms, {self.effective_rows:.0f} independent rows")
        worst = sorted(self.records, key=lambda r: r.rms_um / r.range_um, reverse=True)
        lines += [
            f"  {r.source}: rms {r.rms_um:.4g} um, max {r.max_um:.4g} um of {r.range_um:.4g} um"
            for r in worst[:SHOWN_RECORDS]
        ]
        if len(worst) > SHOWN_RECORDS:
            lines.append(f"  and {len(worst) - SHOWN_RECORDS} records that fit better")
        return "\n".join([*lines, *self.messages])


def effective_rows(residual: Samples) -> float:
    """How many independent rows a residual (n,) is worth: n / (1 + 2 sum rho).

    rho is its autocorrelation, up to where it first falls below 0.05.
    """
    e = residual - residual.mean()
    n = len(e)
    spectrum = np.abs(np.fft.rfft(e, 2 * n)) ** 2
    rho = np.fft.irfft(spectrum)[:n]
    if not rho[0] > 0:
        return float(n)
    rho = rho / rho[0]
    end = int(np.argmax(rho < 0.05)) or n
    return max(1.0, n / (1 + 2 * float(rho[1:end].sum())))


def apart_from(columns: Samples, before: Samples, left: Samples) -> Samples:
    """Columns (rows, k) about their means, less what goes with the columns ``before`` (rows, m), which is what had gone
    on before a record began.

    Least squares, where each amount of ``before`` has a normal prior of deviation 1 (a ridge) and the error is ``left``
    (rows,), the residual whose independent rows say how surely the amounts are told.
    """
    columns, before = columns - columns.mean(axis=0), before - before.mean(axis=0)
    return np.asarray(columns - before @ amounts_before(before, columns, left))


def amounts_before(before: Samples, columns: Samples, left: Samples) -> Samples:
    """How much (m,) or (m, k) of the columns ``before`` goes with columns (rows,) or (rows, k), all about their means:
    the ridge of ``apart_from``."""
    told = before.T @ before + float(np.var(left)) * len(left) / effective_rows(left) * np.eye(before.shape[1])
    return np.asarray(np.linalg.solve(told, before.T @ columns))


def standard_errors(fits: list[FitRun], solution: Solution, residuals: list[Samples]) -> dict[str, tuple[float, ...]]:
    """Standard errors of the parameters of a time view, linearised at the solution; keys as in ``OperatorFit.std``.

    G^-1 M G^-1, where M weighs the moments G of each record by the record's own residual and by how few of its rows are
    independent (Huber 1967). Slopes at their bound of zero are held there.
    """
    lags = fits[0].lag_s > 0
    size = int(np.count_nonzero(solution.slopes > 0)) + 3 + 3 * len(solution.modes) + lags
    information, scatter = np.zeros((size, size)), np.zeros((size, size))
    delay_step_s = 0.02 * min(f.run.step_s for f in fits) + 0.01 * solution.delay_s
    for f, e in zip(fits, residuals, strict=True):
        columns = linearised(f, solution, delay_step_s)[:, :-1]
        if lags:
            columns = np.insert(columns, -1, lag_column(f, solution), axis=1)
        moments = f.weight * (columns.T @ columns)
        information += moments
        # Judged about its own mean, a record whose offset differs from the others' would seem exact.
        scatter += f.weight * np.mean(e**2) * len(e) / effective_rows(e) * moments
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    inverse = np.linalg.pinv(information / np.outer(scale, scale), rcond=1e-10, hermitian=True)
    covariance = inverse @ (scatter / np.outer(scale, scale)) @ inverse / np.outer(scale, scale)
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    std[scale <= 1e-140] = np.nan
    return {**_by_parameter(solution, covariance, std), "lag_s": (float(std[-2]) if lags else float("nan"),)}


def _by_parameter(solution: Solution, covariance: Samples, std: Samples) -> dict[str, tuple[float, ...]]:
    """The errors under the names and in the order of the time view of a solution.

    ``covariance`` and its root diagonal ``std`` are of [slopes that are not 0, delay, rest fraction, modes, lag if any,
    offset].
    """
    basis, slopes, free = solution.basis, solution.slopes, solution.slopes > 0
    n, where = basis.n_segments, np.flatnonzero(free)
    count = len(where)
    m = basis.n_plays
    full = np.zeros((basis.size, basis.size))
    full[np.ix_(where, where)] = covariance[:count, :count]
    bend = np.diff(np.eye(n), axis=0)
    bends = np.sqrt(np.maximum(np.diag(bend @ full[:n, :n] @ bend.T), 0.0))
    weights = np.sqrt(np.maximum(np.diag(full)[n : n + m], 0.0))
    keep, bent = with_weight(basis, slopes)
    at_bound = float("nan")
    return {
        "gain_um_per_V": (float(np.sqrt(full[0, 0])) if free[0] else at_bound,),
        "play_w_um_per_V": tuple(weights[keep].tolist()),
        "fading_w_um_per_V": tuple(np.sqrt(np.maximum(np.diag(full)[n + m :], 0.0))[slopes[n + m :] > 0].tolist()),
        "deadzone_s_um_per_V": tuple(bends[bent].tolist()),
        "offset_um": (float(std[-1]),),
        "delay_s": (float(std[count]),),
        "rest_fraction": (float(std[count + 1]) if 0 < abs(solution.rest_fraction) < 1 else at_bound,),
    }
