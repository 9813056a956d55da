"""The table regression: exact on its own form, and honest covariances off it."""

from __future__ import annotations

import numpy as np
import pytest

from phaselead.errors import BadInput
from phaselead.identify.runs import distinct
from phaselead.identify.table import compare_with_table_1, comparison_text, regress, regressors, table_fit
from phaselead.model.table import XU_LI_2010, TablePoint

LEVELS, FREQUENCIES = (0.5, 1, 2, 4, 6, 8, 10), (1, 2, 5, 10, 15, 20)


def paper_points(noise: float = 0.0, seed: int = 0, stated: float = 0.0) -> list[TablePoint]:
    rng = np.random.default_rng(seed)
    return [
        TablePoint(
            swing_V=a,
            f_Hz=f,
            gain_um_per_V=XU_LI_2010.gain(a) + noise * rng.normal(),
            gain_std=stated,
            phase_deg=XU_LI_2010.phase_deg(a, f) + noise * rng.normal(),
            phase_std=stated,
            x0_um=XU_LI_2010.x0(a, f) + noise * rng.normal(),
            x0_std=stated,
        )
        for a in LEVELS
        for f in FREQUENCIES
    ]


def test_returns_table_1_from_its_own_points():
    view = table_fit(paper_points())
    assert view.swing_V == (0.5, 10.0)
    assert view.f_Hz == (1.0, 20.0)
    for row in compare_with_table_1(view):
        assert row.ours == pytest.approx(row.paper, abs=1e-8)
        assert row.std < 1e-6


@pytest.mark.parametrize("stated", [0.0, 0.05, 0.2])
def test_covariance_covers_the_truth(stated):
    """Whether the scatter of 0.2 is stated by the points, partly stated, or all lack of fit."""
    normalised = []
    for seed in range(150):
        rows = compare_with_table_1(table_fit(paper_points(0.2, seed, stated)))
        normalised.append([(row.ours - row.paper) / row.std for row in rows])
    spread = np.sqrt(np.mean(np.square(normalised), axis=0))
    assert np.all((spread > 0.8) & (spread < 1.25)), spread


def test_full_covariance_and_not_only_its_diagonal():
    """The error of a *predicted* gain needs the off-diagonal terms."""
    errors, stated = [], []
    for seed in range(150):
        view = table_fit(paper_points(0.2, seed))
        x = np.array([1.0, 5.0, 25.0])
        errors.append(view.gain(5.0) - XU_LI_2010.gain(5.0))
        stated.append(np.sqrt(x @ np.array(view.a_cov) @ x))
    assert np.std(errors) == pytest.approx(np.mean(stated), rel=0.2)


def test_an_exact_point_does_not_outweigh_the_lack_of_fit():
    x = np.linspace(-1, 1, 21)
    X, y = np.stack([np.ones(21), x], axis=1), x + 0.3 * x**2
    std = np.full(21, 0.05)
    std[3] = 1e-12
    even = regress(X, y, np.full(21, 0.05)).coefficients
    assert regress(X, y, std).coefficients == pytest.approx(even, abs=0.02)


def test_lack_of_fit_is_nothing_when_the_points_explain_themselves():
    rng = np.random.default_rng(3)
    swing, f = np.repeat(LEVELS, 6).astype(float), np.tile(FREQUENCIES, 7).astype(float)
    X = regressors(swing, f)
    y = X @ np.arange(6) + rng.normal(0, 0.1, len(swing))
    assert regress(X, y, np.full(len(y), 0.2)).lack_of_fit == 0.0
    assert regress(X, y, np.full(len(y), 0.01)).lack_of_fit == pytest.approx(0.1, rel=0.4)


def test_converter_codes_do_not_shrink_the_rectangle():
    points = [p.model_copy(update={"swing_V": p.swing_V * 1.0002}) for p in paper_points()]
    assert table_fit(points).swing_V == (0.5, 10.0)


def test_distinct_levels():
    assert distinct([1.0, 5.0, 1.001, 4.99]) == [pytest.approx(1.0005), pytest.approx(4.995)]


@pytest.mark.parametrize(
    "keep",
    [
        lambda p: p.swing_V < 1.5,
        lambda p: p.f_Hz < 3,
        lambda p: (p.swing_V, p.f_Hz) in {(0.5, 1), (1, 2), (2, 5), (4, 10), (6, 15)},
    ],
)
def test_refuses_a_grid_that_does_not_determine_it(keep):
    with pytest.raises(BadInput, match=r"(levels and|spread them over)") as caught:
        table_fit([p for p in paper_points() if keep(p)])
    assert "\n" not in str(caught.value)


def test_comparison_reads_like_the_paper():
    text = comparison_text(table_fit(paper_points()))
    assert text.splitlines()[1].split()[:3] == ["a0", "15.2536", "15.2536"]
    assert len(text.splitlines()) == 16
