"""The table view of a stage: gain, phase lag and offset of its answer to a sine (Xu & Li 2010, eqs. 4-8).

    u(t) = um/2 (1 - cos 2 pi f t)                                   0 <= u <= um
    x(t) = K um/2 (1 - cos(2 pi f t - theta)) + x0
    K(um)        = a0 + a1 um + a2 um^2                              um/V
    theta(um, f) = b0 + b1 um + b2 f + b3 um f + b4 um^2 + b5 f^2    degrees
    x0(um, f)    = c0 + c1 um + c2 f + c3 um f + c4 um^2 + c5 f^2    um

``um`` (``swing_V`` here) is the peak-to-peak voltage, not the amplitude. The polynomials mean nothing outside
the rectangle they were fitted on, so every function refuses to leave it unless told ``extrapolate=True``.
"""

from __future__ import annotations

from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from phaselead.errors import BadInput
from phaselead.model.fields import Matrix3, Matrix6, NotNegative, Number, Numbers3, Numbers6, Part, Positive, Span
from phaselead.model.validation_errors import fault

EDGE = 1e-9
"""Relative slack at the edge of the rectangle, for values that went through a text file."""


class TablePoint(Part):
    """One measured point of the grid, with standard deviations."""

    swing_V: Positive = Field(description="peak-to-peak voltage, V")
    f_Hz: Positive = Field(description="frequency, Hz")
    gain_um_per_V: Number = Field(description="K, um/V")
    gain_std: NotNegative = Field(0.0, description="its standard deviation, um/V")
    phase_deg: Number = Field(description="phase lag theta, degrees")
    phase_std: NotNegative = Field(0.0, description="its standard deviation, degrees")
    x0_um: Number = Field(description="offset x0, um")
    x0_std: NotNegative = Field(0.0, description="its standard deviation, um")


class TableView(Part):
    """The coefficients of K, theta and x0, their covariance, and the rectangle they hold on."""

    swing_V: Annotated[Span, Field(description="identified rectangle: peak-to-peak voltage, V")]
    f_Hz: Annotated[Span, Field(description="identified rectangle: frequency, Hz")]
    a_um_per_V: Numbers3 = Field(description="K(um), um/V; regressors 1, um, um^2")
    b_deg: Numbers6 = Field(description="theta(um, f), degrees; regressors 1, um, f, um f, um^2, f^2")
    c_um: Numbers6 = Field(description="x0(um, f), um; same regressors as b_deg")
    a_cov: Matrix3 | None = Field(None, description="covariance of a_um_per_V")
    b_cov: Matrix6 | None = Field(None, description="covariance of b_deg")
    c_cov: Matrix6 | None = Field(None, description="covariance of c_um")
    points: tuple[TablePoint, ...] = Field((), description="the measured grid, with standard deviations")

    @model_validator(mode="after")
    def _usable(self) -> Self:
        for name in ("swing_V", "f_Hz"):
            if getattr(self, name)[0] <= 0:
                fault(f"= {getattr(self, name)[0]:g}: must be above 0", f".{name}[0]")
        for name in ("a_cov", "b_cov", "c_cov"):
            for i, row in enumerate(getattr(self, name) or ()):
                if row[i] < 0:
                    fault(f"= {row[i]:g}: a variance cannot be negative", f".{name}[{i}][{i}]")
        where = self._falls_at()
        if where is not None:
            fault(
                f"is not monotone: the range K(um) um does not rise with um at {where:.4g} V; "
                "fit again with more levels, or narrow swing_V",
                ".a_um_per_V",
            )
        return self

    def _falls_at(self) -> float | None:
        """A swing at which d(K um)/d(um) = a0 + 2 a1 um + 3 a2 um^2 is not positive, or None."""
        _, a1, a2 = self.a_um_per_V
        low, high = self.swing_V
        suspects = [low, high]
        if a2 != 0 and low < -a1 / (3 * a2) < high:
            suspects.append(-a1 / (3 * a2))
        worst = min(suspects, key=self._slope_um_per_V)
        return worst if self._slope_um_per_V(worst) <= 0 or self._range_um(low) <= 0 else None

    def _slope_um_per_V(self, swing_V: float) -> float:
        a0, a1, a2 = self.a_um_per_V
        return a0 + 2 * a1 * swing_V + 3 * a2 * swing_V**2

    def _range_um(self, swing_V: float) -> float:
        a0, a1, a2 = self.a_um_per_V
        return (a0 + a1 * swing_V + a2 * swing_V**2) * swing_V

    def _inside(self, name: str, value: ArrayLike, extrapolate: bool) -> NDArray[np.float64]:
        values = np.asarray(value, dtype=np.float64)
        low, high = self.swing_V if name == "swing" else self.f_Hz
        unit = "V" if name == "swing" else "Hz"
        outside = ~((values >= low * (1 - EDGE)) & (values <= high * (1 + EDGE)))
        if not extrapolate and outside.any():
            raise BadInput(
                f"{name} {float(values[outside].flat[0]):g} {unit} lies outside the identified rectangle "
                f"({low:g}..{high:g} {unit}); choose one inside"
            )
        return values

    def gain(self, swing_V: ArrayLike, *, extrapolate: bool = False) -> Any:
        """K in um/V, in the shape of ``swing_V``. Eq. 6."""
        um = self._inside("swing", swing_V, extrapolate)
        a0, a1, a2 = self.a_um_per_V
        return a0 + a1 * um + a2 * um**2

    def phase_deg(self, swing_V: ArrayLike, f_Hz: ArrayLike, *, extrapolate: bool = False) -> Any:
        """Phase lag theta in degrees, in the broadcast shape. Eq. 7."""
        return self._surface(self.b_deg, swing_V, f_Hz, extrapolate)

    def x0(self, swing_V: ArrayLike, f_Hz: ArrayLike, *, extrapolate: bool = False) -> Any:
        """Offset x0 in um, in the broadcast shape. Eq. 8."""
        return self._surface(self.c_um, swing_V, f_Hz, extrapolate)

    def _surface(self, coefficients: tuple[float, ...], swing_V: ArrayLike, f_Hz: ArrayLike, extrapolate: bool) -> Any:
        um = self._inside("swing", swing_V, extrapolate)
        f = self._inside("frequency", f_Hz, extrapolate)
        k0, k1, k2, k3, k4, k5 = coefficients
        return k0 + k1 * um + k2 * f + k3 * um * f + k4 * um**2 + k5 * f**2

    @property
    def range_um(self) -> tuple[float, float]:
        """The output ranges the rectangle can give, K(um) um at its two ends."""
        return self._range_um(self.swing_V[0]), self._range_um(self.swing_V[1])

    def swing_for_range(self, range_um: float) -> float:
        """The peak-to-peak voltage whose output range is ``range_um``: the root of K(um) um = R.

        Raises BadInput with the allowed range when it lies outside the rectangle.
        """
        low, high = self.range_um
        if not low * (1 - EDGE) <= range_um <= high * (1 + EDGE):
            raise BadInput(
                f"a range of {range_um:g} um is outside what was identified ({low:.4g}..{high:.4g} um); "
                "choose one inside"
            )
        from scipy.optimize import brentq  # slow to load, and needed by table feed-forward alone

        wanted = min(max(range_um, low), high)
        return float(brentq(lambda swing: self._range_um(swing) - wanted, *self.swing_V, xtol=1e-13))

    def response(
        self, t_s: ArrayLike, swing_V: float, f_Hz: float, *, extrapolate: bool = False
    ) -> NDArray[np.float64]:
        """Position in um, shape of ``t_s``, under u = um/2 (1 - cos 2 pi f t). Eq. 5."""
        half_um = self.gain(swing_V, extrapolate=extrapolate) * swing_V / 2
        theta = np.deg2rad(self.phase_deg(swing_V, f_Hz, extrapolate=extrapolate))
        x0_um = self.x0(swing_V, f_Hz, extrapolate=extrapolate)
        phase = 2 * np.pi * f_Hz * np.asarray(t_s, dtype=np.float64)
        return np.asarray(half_um * (1 - np.cos(phase - theta)) + x0_um)


XU_LI_2010 = TableView(
    swing_V=(0.5, 10.0),
    f_Hz=(1.0, 20.0),
    a_um_per_V=(15.2536, 1.9619, -0.1013),
    b_deg=(1.9238, 0.7477, 0.0456, 0.0047, -0.0466, 0.0003),
    c_um=(-1.7893, 1.1365, 0.3635, -0.0463, -0.0140, -0.0150),
)
"""Table I of Xu & Li 2010: the x axis of their stage."""
