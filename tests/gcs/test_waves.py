"""The curves of WAV, and what generators refuse."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from phaselead.gcs.axes import Axes
from phaselead.gcs.errors import GcsError
from phaselead.gcs.wave_shapes import bow, line, ramp, segment
from phaselead.gcs.waves import Waves
from phaselead.waveforms import of_points

sizes = st.integers(4, 400)


@given(sizes.flatmap(lambda points: st.tuples(st.just(points), st.integers(0, points // 2))))
@example((22, 11))
def test_a_line_goes_from_0_to_1_and_bends_evenly(sizes):
    points, bent = sizes
    shares = line(points, bent)
    assert shares[0] == 0
    assert abs(shares[-1] - 1) < 1e-9
    steps = np.diff(shares)
    assert (steps > -1e-12).all()
    assert np.allclose(steps, steps[::-1])
    speeding = steps[: max(bent, 1)]
    assert (np.diff(speeding) >= -1e-9).all()


@given(st.data(), sizes)
def test_ramps_and_bows_reach_1_at_their_centre_alone(data, points):
    centre = data.draw(st.integers(2, points - 2))
    bent = data.draw(st.integers(0, min(centre, points - centre) // 2))
    for shares in (ramp(points, bent, centre), bow(points, centre)):
        assert shares.shape == (points,)
        assert shares[0] == 0
        assert np.argmax(shares) == centre
        assert abs(shares[centre] - 1) < 1e-9
        assert (np.diff(shares[: centre + 1]) > -1e-12).all()
        assert (np.diff(shares[centre:]) < 1e-12).all()


def test_a_bow_is_a_sine_when_its_centre_is_in_the_middle():
    """WAV 2 X SIN_P 2000 20 10 2000 0 1000 of the E-727's manual: 10 to 30 um and back."""
    _, values = segment("SIN_P", ["2000", "20", "10", "2000", "0", "1000"])
    assert np.allclose(values, 20 - 10 * np.cos(2 * np.pi * np.arange(2000) / 2000))


def test_segments_rest_before_and_after_their_curve():
    _, falling = segment("LIN", ["3000", "-40", "50", "2000", "500", "650"])
    assert (falling[:501].tolist(), set(falling[2500:])) == ([50.0] * 501, {10.0})
    _, hill = segment("RAMP", ["100", "8", "1", "50", "20", "0", "25"])
    assert (hill[20], hill[45], set(hill[70:])) == (1, 9, {1.0})


@pytest.fixture
def waves():
    return Waves(Axes(None, "xy"))


def test_tables_begin_go_on_and_add(waves):
    for words in ("1 X PNT 1 2 5 6", "1 & PNT 3 2 7 8", "1 + PNT 2 4 1 1 1 9"):
        waves.define(words.split())
    assert waves.points(1).tolist() == [5, 7, 8, 9, 9]


@pytest.mark.parametrize(
    ("words", "name"),
    [
        ("1 X PNT 2 1 5", "WAV_PARAMETER_OUT_OF_LIMIT"),
        ("1 ? PNT 1 1 5", "WAV_PARAMETER_OUT_OF_LIMIT"),
        ("1 X RAMP 100 1 0 100 0 60 50", "WAV_PARAMETER_OUT_OF_LIMIT"),
        ("1 X SIN_P 100 1 0 100 0", "WAV_PARAMETER_NR"),
        ("1 X", "MISSING_PARAM"),
        ("1 + PNT 65536 2 1 1", "WAVE_TOO_LARGE"),
    ],
)
def test_what_is_no_waveform_leaves_the_table_as_it_is(waves, words, name):
    waves.define(["1", "X", "PNT", "1", "2", "5", "6"])
    with pytest.raises(GcsError, match=name):
        waves.define(words.split())
    assert waves.points(1).tolist() == [5, 6]


@given(st.lists(st.floats(-100, 100), min_size=2, max_size=1024).filter(lambda v: np.ptp(v) > 1e-3))
def test_the_path_of_points_passes_through_them(values):
    wave = of_points(values, "um", 10.0)
    found = wave.value(np.arange(len(values)) / len(values) / 10)
    assert np.allclose(found, values, atol=1e-6)
    assert (wave.lowest, wave.highest) == pytest.approx((min(values), max(values)))
