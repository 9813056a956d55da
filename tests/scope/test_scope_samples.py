"""What is kept of the ticks, and what of it is shown: no extreme is lost, no gap is hidden."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import phaselead as pl
from phaselead.device import LiveAxis, LiveSamples
from phaselead.scope.samples import TRACES, Samples
from phaselead.scope.saving import save
from phaselead.scope.trigger import Trigger
from phaselead.scope.view import HEAD, View, spectrum

X = TRACES.index("x_um")


def part(first: int, values: np.ndarray, missing: int = 0) -> LiveSamples:
    x_um = np.asarray(values, np.float32)
    nothing = np.zeros_like(x_um)
    return LiveSamples(first, len(x_um), {"x": LiveAxis(nothing, x_um, nothing, nothing, nothing)}, missing)


@given(
    st.lists(st.tuples(st.integers(1, 40), st.integers(0, 30)), min_size=1, max_size=20),
    st.integers(1, 9),
    st.integers(0, 2**32),
)
@settings(max_examples=100, deadline=None)
def test_an_envelope_holds_every_tick_that_came(stretches, ticks, seed):
    """Parts of any length with gaps of any length, a ring that is too short for them."""
    samples, random = Samples("x", seconds=0.02), np.random.default_rng(seed)
    all_um, end = {}, 1000
    for length, gap in stretches:
        values = random.normal(size=length).astype(np.float32)
        samples.add(part(end + gap, values, gap))
        all_um |= dict(zip(range(end + gap, end + gap + length), values, strict=True))
        end += gap + length
    assert samples.dropped == sum(gap for _, gap in stretches)
    first = (end - samples.capacity) // ticks * ticks
    columns = (end - first) // ticks
    low, high = samples.envelope(first, columns, ticks)
    lost = samples.dropped_in(first, columns, ticks)
    for i in range(columns):
        place = range(first + i * ticks, first + (i + 1) * ticks)
        there = [all_um[tick] for tick in place if tick in all_um and tick >= samples.begin]
        if there:
            assert low[0, X, i] == min(there)
            assert high[0, X, i] == max(there)
        else:
            assert np.isnan(low[0, X, i])
        inside = [tick for tick in place if samples.begin <= tick < end]
        if inside and min(place) >= 1000 + stretches[0][1]:
            assert bool(lost[i]) == any(tick not in all_um for tick in place if tick < end)


@given(st.integers(16, 300), st.floats(0.01, 2.0), st.lists(st.integers(1, 900), min_size=1, max_size=30))
@settings(max_examples=60, deadline=None)
def test_a_view_sends_every_tick_in_one_column(columns, window_s, steps):
    """Columns of one view follow each other without overlap, whenever it is asked."""
    samples, view, trigger = Samples("x", seconds=5), View(window_s, columns), Trigger()
    end, sent = 7, None
    for step in steps:
        samples.add(part(end, np.zeros(step)))
        end += step
        if (frame := view.next(samples, trigger)) is None:
            continue
        _, anew, axes, traces, count, ticks, _, first, mark, _ = HEAD.unpack_from(frame)
        assert np.isnan(mark)
        assert first == sent or anew
        assert len(frame) == HEAD.size + axes * traces * count * 4 * (2 if ticks > 1 else 1) + count
        sent = first + count * ticks
        assert end - ticks < sent <= end


@pytest.mark.parametrize("edge", ["rising", "falling"])
def test_a_trigger_keeps_what_was_before_it(edge):
    sign = 1 if edge == "rising" else -1
    samples, trigger = Samples("x"), Trigger("single", "x", "x_um", 0.0, edge, 0.25, 0.1)
    wave = sign * np.sin(2 * np.pi * (np.arange(5000) - 1234) / 5000)
    for at in range(0, 5000, 77):
        samples.add(part(at, wave[at : at + 77]))
        trigger.look(samples)
    shot = trigger.shot
    assert shot is not None
    assert abs(shot.trigger_tick - 1234) <= 1
    assert (shot.first_tick, shot.ticks) == (shot.trigger_tick - 125, 500)
    assert not trigger.waiting
    assert shot.number == 1


@pytest.mark.parametrize(
    "wrong", [{"run": "often"}, {"edge": "flat"}, {"trace": "v"}, {"before": 1.5}, {"window_s": 0}, {"window_s": 99}]
)
def test_a_trigger_that_makes_no_sense(wrong):
    with pytest.raises(pl.BadInput):
        Trigger(**wrong)


@given(st.floats(5.0, 2000.0), st.floats(1e-3, 100.0))
@settings(max_examples=30, deadline=None)
def test_a_line_has_its_amplitude(f_Hz, amplitude):
    """Between two lines a Hann window takes 15 % at most."""
    rows = (amplitude * np.sin(2 * np.pi * f_Hz * np.arange(8192) / 5000)).astype(np.float32)[None]
    at_Hz, found = spectrum(rows)
    best = int(np.argmax(found[0]))
    assert at_Hz[best] / 1.03 <= f_Hz * 1.03
    assert 0.84 * amplitude <= found[0, best] <= 1.01 * amplitude


@given(st.sets(st.integers(0, 400), min_size=2), st.integers(0, 300), st.integers(2, 200))
@settings(max_examples=60, deadline=None)
def test_what_is_saved_tells_of_every_tick_that_lacks(came, first, ticks):
    """Wherever the stretch begins and ends, within a gap too: samples and gaps are the ticks from first to last."""
    samples = Samples("x", seconds=0.2)
    for tick in sorted(came):
        samples.add(part(tick, np.array([float(tick)])))
    inside = sorted(tick for tick in came if first <= tick < first + ticks)
    assume(len(inside) >= 2)
    with TemporaryDirectory() as folder:
        saved = save(samples, first, ticks, inside[0], Path(folder) / "saved.h5", {})
    gaps = saved.meta["gaps"]
    missing = [tick for at, length in gaps for tick in range(at, at + length)]
    assert sorted(inside + missing) == list(range(inside[0], inside[-1] + 1))
    assert saved.meta["missing_ticks"] == len(missing)
