"""Batches become arrays, whatever is streamed and wherever it is cut."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.device import wire
from phaselead.device.stream import ALL_CHANNELS, AXES, axes_of, decode_samples, tick_dtype
from phaselead.errors import LinkError


def body(
    sequence: int, first: int, data: bytes, channels: int, mask: int, decimation: int = 1, dropped: int = 0
) -> bytes:
    message = wire.Samples(sequence, first, dropped, channels, mask, decimation, data)
    return wire.HEADER.pack(wire.Samples.NUMBER, 0, 1) + message.pack()


@settings(max_examples=100, deadline=None)
@given(
    channels=st.integers(1, ALL_CHANNELS),
    mask=st.integers(1, 7),
    decimation=st.integers(1, 100),
    counts=st.lists(st.integers(1, 25), min_size=1, max_size=5),
    seed=st.integers(0, 2**32 - 1),
)
def test_what_goes_in_comes_out(channels: int, mask: int, decimation: int, counts: list[int], seed: int) -> None:
    layout = tick_dtype(channels, mask)
    rng = np.random.default_rng(seed)
    data = np.frombuffer(rng.bytes(layout.itemsize * sum(counts)), layout)
    bodies, at = [], 0
    for i, n in enumerate(counts):
        bodies.append(body(i, 1000 + at * decimation, data[at : at + n].tobytes(), channels, mask, decimation))
        at += n
    stream = decode_samples(bodies, 1000, sum(counts))
    assert np.array_equal(stream.ticks, 1000 + decimation * np.arange(sum(counts)))
    assert "".join(stream.axes) == axes_of(mask)
    for axis, arrays in stream.axes.items():
        for channel in wire.Channel:
            name = channel.name.lower()
            got = getattr(arrays, name)
            if channels & channel:
                assert np.array_equal(got, data[axis][name])
                assert got.dtype == wire.CHANNEL_DTYPES[name]
            else:
                assert got is None
    assert (stream.gaps, stream.lost_batches, stream.dropped_ticks) == ([], 0, 0)


def test_a_tick_of_three_axes_is_36_bytes() -> None:
    assert tick_dtype(ALL_CHANNELS, 7).itemsize == 36


def test_drops_of_the_device_are_gaps_and_counted() -> None:
    bodies = [body(0, 0, bytes(20), 2, 1), body(1, 15, bytes(10), 2, 1, dropped=5)]
    stream = decode_samples(bodies, 0, 15)
    assert [(g.first_tick, g.ticks) for g in stream.gaps] == [(10, 5)]
    assert (stream.lost_batches, stream.dropped_ticks) == (0, 5)


def test_the_sequence_may_wrap_around() -> None:
    bodies = [body(2**32 - 1, 0, bytes(4), 2, 1), body(0, 2, bytes(4), 2, 1), body(2, 4, bytes(4), 2, 1)]
    assert decode_samples(bodies).lost_batches == 1


def test_no_batch_at_all() -> None:
    assert decode_samples([], 7, 0).gaps == []
    assert [(g.first_tick, g.ticks) for g in decode_samples([], 7, 50).gaps] == [(7, 50)]


@pytest.mark.parametrize(
    "bodies",
    [
        [body(0, 0, bytes(4), 2, 1), body(1, 2, bytes(4), 2, 2)],
        [body(0, 0, bytes(4), 2, 1), body(1, 2, bytes(4), 4, 1)],
        [body(0, 0, bytes(3), 2, 1)],
        [body(0, 0, bytes(4), 0, 1)],
        [body(0, 0, bytes(4), 2, 1, decimation=0)],
        [body(0, 9, bytes(4), 2, 1), body(1, 2, bytes(4), 2, 1)],
        [b"short"],
    ],
)
def test_what_is_no_stream_is_refused_in_words(bodies: list[bytes]) -> None:
    with pytest.raises(LinkError) as caught:
        decode_samples(bodies)
    assert "\n" not in str(caught.value)


def test_axis_letters() -> None:
    assert [axes_of(1 << i) for i in range(3)] == list(AXES)


@settings(max_examples=100, deadline=None)
@given(
    decimation=st.integers(1, 9),
    fates=st.lists(st.sampled_from(["comes", "comes", "twice", "lost", "dropped"]), min_size=1, max_size=12),
    order=st.randoms(use_true_random=False),
)
def test_every_row_is_there_or_in_a_gap(decimation, fates, order) -> None:
    """Whatever is lost on the line, dropped by the device, comes twice or out of order, and at the ends too."""
    bodies: list[bytes] = []
    sequence = dropped = 0
    here: list[int] = []
    for i, fate in enumerate(fates):
        rows = [1000 + decimation * row for row in range(5 * i, 5 * i + 5)]
        if fate == "dropped":
            dropped += 5
            continue
        batch = body(sequence, rows[0], bytes(10), 2, 1, decimation, dropped)
        sequence += 1
        here += rows if fate != "lost" else []
        bodies += {"comes": [batch], "twice": [batch, batch], "lost": []}[fate]
    order.shuffle(bodies)
    stream = decode_samples(bodies, 1000, 5 * sequence, dropped, decimation)
    assert stream.ticks.tolist() == here
    gone = {tick for gap in stream.gaps for tick in range(gap.first_tick, gap.first_tick + gap.ticks, decimation)}
    assert gone.isdisjoint(here)
    assert len(gone) + len(here) == 5 * len(fates)
    assert gone | set(here) == set(range(1000, 1000 + 5 * len(fates) * decimation, decimation))


def test_batches_of_the_stream_before_are_not_of_this_one() -> None:
    bodies = [body(7, 90, bytes(20), 2, 1), body(0, 100, bytes(20), 2, 1)]
    assert decode_samples(bodies, 100, 10).ticks.tolist() == list(range(100, 110))
