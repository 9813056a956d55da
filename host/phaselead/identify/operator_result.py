"""What a fit of the time-domain view says about itself: errors of its parameters, residuals, choices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phaselead.identify.operator_design import Basis, FitRun, delay_step_s, linearised
from phaselead.model import TimeView
from phaselead.record import Samples

SHOWN_RECORDS = 6


@dataclass(frozen=True)
class Choice:
    """One size of the model that was tried, and its relative rms error on data left out."""

    n_plays: int
    n_segments: int
    left_out: float
    chosen: bool = False


@dataclass(frozen=True)
class RecordResidual:
    """What the fit leaves of one record, over the rows it was asked to explain."""

    source: str
    rms_um: float
    max_um: float
    mean_um: float
    """Signed: the record's own offset against the fitted one."""
    range_um: float
    came_from_V: float | None

    @staticmethod
    def of(fit: FitRun, left: Samples) -> RecordResidual:
        rms, largest = float(np.sqrt(np.mean(left**2))), float(np.abs(left).max())
        return RecordResidual(fit.run.source, rms, largest, float(left.mean()), fit.run.range_um, fit.came_from_V)


@dataclass(frozen=True)
class OperatorFit:
    """A fitted time view, the standard errors of its parameters, and how it was come by. Prints as a table.

    ``std`` is keyed like the fields of TimeView; a parameter at its bound has none (nan). The errors count
    how far neighbouring residuals agree (``effective_rows``), but they are those of the model as chosen.
    """

    view: TimeView
    std: dict[str, tuple[float, ...]]
    records: tuple[RecordResidual, ...]
    choices: tuple[Choice, ...]
    messages: tuple[str, ...]
    effective_rows: float
    own_offsets: bool = False
    """Whether each record has an offset of its own."""

    def __str__(self) -> str:
        view = self.view
        lines = [
            f"{'gain':14}{view.gain_um_per_V:12.5g} +- {self.std['gain_um_per_V'][0]:.2g} um/V",
            f"{'offset':14}{view.offset_um:12.5g} +- {self.std['offset_um'][0]:.2g} um",
            f"{'delay':14}{1e3 * view.delay_s:12.5g} +- {1e3 * self.std['delay_s'][0]:.2g} ms",
            f"{'rest fraction':14}{view.rest_fraction:12.5g} +- {self.std['rest_fraction'][0]:.2g}",
        ]
        pairs = zip(view.play_r_V, view.play_w_um_per_V, self.std["play_w_um_per_V"], strict=True)
        lines += [f"play {r:<9.4g}{w:12.5g} +- {s:.2g} um/V" for r, w, s in pairs]
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


def effective_rows(left: Samples) -> float:
    """Rows as many independent residuals would be worth: n / (1 + 2 sum rho), rho until it first falls below
    0.05."""
    e = left - left.mean()
    n = len(e)
    spectrum = np.abs(np.fft.rfft(e, 2 * n)) ** 2
    rho = np.fft.irfft(spectrum)[:n]
    if not rho[0] > 0:
        return float(n)
    rho = rho / rho[0]
    end = int(np.argmax(rho < 0.05)) or n
    return max(1.0, n / (1 + 2 * float(rho[1:end].sum())))


def standard_errors(
    fits: list[FitRun], basis: Basis, delay: float, rest: float, slopes: Samples, left: list[Samples]
) -> dict[str, tuple[float, ...]]:
    """Standard errors of the parameters of ``time_view``, linearised at the solution.

    G^-1 M G^-1, where M weighs each record's moments by its own residual and by how few rows are independent
    (Huber 1967). Slopes at their bound of zero are held there.
    """
    free = slopes > 0
    n_free = int(free.sum())
    size = n_free + 3
    information, meat = np.zeros((size, size)), np.zeros((size, size))
    step = delay_step_s(fits, delay)
    for f, e in zip(fits, left, strict=True):
        columns = linearised(f, basis, delay, rest, slopes, step)[:, :-1]
        moments = f.weight * (columns.T @ columns)
        information += moments
        # Judged about its own mean, a record that sits beside the others would seem exact.
        meat += f.weight * np.mean(e**2) * len(e) / effective_rows(e) * moments
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    inverse = np.linalg.pinv(information / np.outer(scale, scale), rcond=1e-10, hermitian=True)
    covariance = inverse @ (meat / np.outer(scale, scale)) @ inverse / np.outer(scale, scale)
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    std[scale <= 1e-140] = np.nan
    return _named(basis, free, slopes, covariance[:n_free, :n_free], std, rest)


def _named(
    basis: Basis, free: NDArray[np.bool_], slopes: Samples, covariance: Samples, std: Samples, rest: float
) -> dict[str, tuple[float, ...]]:
    """The errors under the names and in the order of the view that ``time_view`` makes of the same slopes."""
    n = len(basis.knots_V) - 1
    full = np.zeros((basis.size, basis.size))
    where = np.flatnonzero(free)
    full[np.ix_(where, where)] = covariance
    bend = np.diff(np.eye(n), axis=0)
    bends = np.sqrt(np.maximum(np.diag(bend @ full[:n, :n] @ bend.T), 0.0))
    scale = float(slopes[:n].sum() / n + slopes[n:].sum())
    knees = np.abs(np.diff(slopes[:n])) > 1e-6 * scale
    keep = slopes[n:] > 1e-6 * scale
    weights = np.sqrt(np.maximum(np.diag(full)[n:], 0.0))
    at_bound = float("nan")
    count = len(where)
    return {
        "gain_um_per_V": (float(np.sqrt(full[0, 0])) if free[0] else at_bound,),
        "play_w_um_per_V": tuple(weights[keep].tolist()),
        "deadzone_s_um_per_V": tuple(bends[knees].tolist()),
        "offset_um": (float(std[count + 2]),),
        "delay_s": (float(std[count]),),
        "rest_fraction": (float(std[count + 1]) if 0 < abs(rest) < 1 else at_bound,),
    }
