"""One figure of several runs, in which no spike is lost."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import phaselead as pl
from phaselead.drawing import thin


@given(st.integers(0, 2**32 - 1), st.integers(2, 20_000), st.integers(1, 3))
def test_what_is_drawn_has_every_extreme_and_few_rows(seed, rows, columns):
    rng = np.random.default_rng(seed)
    given_rows = [np.arange(rows, dtype=float), *(rng.normal(size=rows) for _ in range(columns))]
    drawn = thin(*given_rows, most=300)
    assert len({len(column) for column in drawn}) == 1
    assert len(drawn[0]) <= 302
    assert (np.diff(drawn[0]) > 0).all()
    for whole, kept in zip(given_rows[1:], drawn[1:], strict=True):
        assert (kept.min(), kept.max()) == (whole.min(), whole.max())
        assert np.array_equal(kept, whole[drawn[0].astype(int)])


def test_a_spike_of_one_sample_is_drawn():
    """Every n-th sample missed it."""
    x = np.zeros(100_000)
    x[54_321] = 1.0
    assert thin(np.arange(1e5), x)[1].max() == 1.0


@pytest.fixture(name="runs", scope="module")
def _runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    with pl.connect() as dev:
        for name, gains in (("fast", "paper"), ("slow", (0, 2, 0))):
            dev.track("sine:20um@5Hz", mode="pid", gains=gains, duration=0.4, output=folder / f"{name}.h5")
        dev.record(duration=0.2, output=folder / "still.h5")
    return folder


@pytest.mark.parametrize("shown", ["position", "error", "spectrum"])
@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_the_command_draws_runs_together(run, runs, tmp_path, shown, suffix):
    output = tmp_path / f"both{suffix}"
    words = ("plot", runs / "fast.h5", runs / "slow.h5", "--of", shown, "-o", output)
    assert run(*words).status == 0
    assert output.stat().st_size > 1000
    assert "exists already" in run(*words).err


def test_errors_are_named_with_their_size(runs):
    figure = pl.plot([runs / "fast.h5", runs / "slow.h5"], of="error")
    (panel,) = figure.axes
    labels = [text.get_text() for text in panel.get_legend().get_texts()]
    assert [label.split(",")[0] for label in labels] == ["fast.h5", "slow.h5"]
    assert all("rms" in label for label in labels)
    assert "reference" in panel.get_ylabel()


@pytest.mark.parametrize(
    ("names", "of"),
    [(["fast", "slow"], "error"), (["still"], "position"), (["fast", "still"], "error or position")],
)
def test_a_spectrum_says_what_it_is_of(runs, names, of):
    figure = pl.plot([runs / f"{name}.h5" for name in names], of="spectrum")
    assert figure.get_suptitle() == f"At which frequencies is the {of}?"
    assert figure.axes[0].get_ylabel().startswith(f"x: {of} (")


def test_the_reference_has_one_name_in_the_legend(runs):
    (panel,) = pl.plot([runs / "still.h5", runs / "fast.h5", runs / "slow.h5"]).axes
    labels = [text.get_text() for text in panel.get_legend().get_texts()]
    assert labels == ["still.h5", "reference", "fast.h5", "slow.h5"]


def test_a_record_without_a_reference_has_a_spectrum_but_no_error(run, runs, tmp_path):
    assert run("plot", runs / "still.h5", "--of", "spectrum", "-o", tmp_path / "noise.png").status == 0
    outcome = run("plot", runs / "still.h5", "--of", "error", "-o", tmp_path / "none.png")
    assert outcome.status == 2
    assert '--of position (in Python of="position")' in outcome.err
    assert not (tmp_path / "none.png").exists()
