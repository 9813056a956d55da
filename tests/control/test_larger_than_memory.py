"""A recording may be larger than the memory, and one that is made part by part is the one that is made at once."""

from __future__ import annotations

import shutil
import tracemalloc
from dataclasses import replace

import h5py
import numpy as np
import pytest

from phaselead.control import converting, record_to_file, recover_run
from phaselead.control.journal import journal_header, record_open_loop
from phaselead.device import TICK_HZ, encode_frame, read_capture, wire
from phaselead.device.device import Device
from phaselead.record import JournalWriter, read_recording, t0_unix_s
from phaselead.sim.replaying import replay
from phaselead.waveforms import parse_wave

SINE = {"x": parse_wave("sine:5V@5Hz")}
ALL = sum(wire.Channel)


@pytest.fixture
def small_blocks(monkeypatch):
    monkeypatch.setattr(converting, "BLOCK_BYTES", 1 << 17)


def samples(session, sequence, first, count):
    rows = np.zeros(count, [(c.name, wire.CHANNEL_DTYPES[c.name.lower()]) for c in wire.Channel])
    rows["ADC"] = np.arange(first, first + count) % 60_000
    head = wire.Samples(sequence, first, 0, ALL, 1, 1, rows.tobytes())
    return encode_frame(wire.HEADER.pack(wire.Samples.NUMBER, 0, session) + head.pack())


def write_journal(path, batches, order=None):
    """A generated stream of 80 ticks a batch."""
    with Device.open("sim://xyz250") as device:
        header = journal_header(device, "open", None)
    with JournalWriter(path, header) as journal:
        for i in range(batches) if order is None else order:
            journal.append("rx", samples(header["session"], i, 500 + 80 * i, 80))


def peak_MB(act):
    tracemalloc.start()
    act()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 1e6


def test_recovering_takes_no_more_memory_for_more(tmp_path, small_blocks):
    """Twelve times as much: all of it in memory would be 30 MB."""
    peaks = []
    for batches in (500, 6000):
        write_journal(tmp_path / "a.journal", batches)
        peaks.append(peak_MB(lambda: recover_run(str(tmp_path / "a.journal"), str(tmp_path / "a.h5"))))
        with h5py.File(tmp_path / "a.h5") as file:
            assert len(file["x_um"]) == 80 * batches
    assert peaks[1] < peaks[0] + 4


def test_recording_takes_no_more_memory_for_more(tmp_path, small_blocks):
    def record(seconds):
        with Device.open("sim://xyz250") as device:
            record_to_file(device, SINE, output=str(tmp_path / "a.h5"), duration_s=seconds)

    record(0.2)
    short, long = peak_MB(lambda: record(5)), peak_MB(lambda: record(100))
    assert long < short + 4


def test_part_by_part_is_as_at_once(tmp_path, small_blocks):
    with Device.open("sim://xyz250?seed=3") as device:
        facts = record_to_file(device, SINE, output=str(tmp_path / "parts.h5"), duration_s=6)
    with Device.open("sim://xyz250?seed=3") as device:
        whole = record_open_loop(device, SINE, output=None, duration_s=6)
    told = whole.facts()
    assert {name: facts[name] for name in told} == told
    with h5py.File(tmp_path / "parts.h5") as file:
        for name, column in whole.columns.items():
            assert np.array_equal(file[name], column)
    assert replay(read_capture(tmp_path / "parts.h5")) is None  # every DAC code is the same


def test_late_batches_are_put_in_their_place(tmp_path, small_blocks):
    rng = np.random.default_rng(1)
    order = np.argsort(np.arange(900) + rng.uniform(0, 20, 900))
    write_journal(tmp_path / "a.journal", 900, [*order.tolist(), *range(300, 310)])
    facts = recover_run(str(tmp_path / "a.journal"), str(tmp_path / "a.h5"))
    assert (facts["samples"], facts["gaps"]) == (72_000, [])


def test_gaps_within_and_between_the_parts_are_all_told(tmp_path, small_blocks):
    rng = np.random.default_rng(2)
    here = np.flatnonzero(rng.random(900) > 0.1)
    write_journal(tmp_path / "a.journal", 900, here.tolist())
    facts = recover_run(str(tmp_path / "a.journal"), str(tmp_path / "a.h5"))
    ticks = {500 + 80 * i + j for i in here.tolist() for j in range(80)}
    gone = {tick for first, count in facts["gaps"] for tick in range(first, first + count)}
    assert gone.isdisjoint(ticks)
    assert gone | ticks == set(range(min(ticks), max(ticks) + 1))
    assert facts["missing_ticks"] == len(gone)
    with h5py.File(tmp_path / "a.h5") as file:
        assert set(file["device/tick"][:].tolist()) == ticks


def test_samples_of_another_session_are_not_taken(tmp_path):
    with Device.open("sim://xyz250") as device:
        header = journal_header(device, "open", None)
    with JournalWriter(tmp_path / "a.journal", header) as journal:
        for i in range(3):
            journal.append("rx", samples(header["session"], i, 80 * i, 80))
        journal.append("rx", samples(header["session"] ^ 1, 0, 80, 80))
    assert recover_run(str(tmp_path / "a.journal"), str(tmp_path / "a.h5"))["samples"] == 240


def test_the_end_of_a_stream_that_was_lost_is_a_gap(tmp_path, monkeypatch):
    """Of a run that came to its end: the device says how much it has sent."""
    ends = []

    def longer(path, output, run):
        ends.append(run.rows_end)
        return converting.convert(path, output, replace(run, rows_end=run.rows_end + 70))

    monkeypatch.setattr("phaselead.control.journal.convert", longer)
    with Device.open("sim://xyz250") as device:
        facts = record_to_file(device, None, output=str(tmp_path / "a.h5"), duration_s=0.5)
    assert facts["gaps"] == [[*ends, 70]]


def test_a_run_says_when_it_was_taken_and_so_does_what_is_recovered_of_it(tmp_path, monkeypatch):
    """By the clock at the hello and the ticks since then; a virtual device counts its own seconds alone."""
    began_unix_s, kept = 1.7e9, tmp_path / "kept.journal"

    def keeping(path, output, run):
        shutil.copy(path, kept)
        return converting.convert(path, output, run)

    monkeypatch.setattr("phaselead.control.journal.convert", keeping)
    with Device.open("sim://xyz250") as device:
        silent = record_to_file(device, None, output=str(tmp_path / "silent.h5"), duration_s=0.1)
        device.session.tick_0_unix_s = began_unix_s
        record_to_file(device, SINE, output=str(tmp_path / "a.h5"), duration_s=0.5)
    monkeypatch.undo()
    assert "t0_utc" not in silent
    assert read_recording(str(tmp_path / "silent.h5")).meta["t0_device_s"] >= 0
    recording = read_recording(str(tmp_path / "a.h5"))
    first_s = recording.meta["start_tick"] / TICK_HZ
    assert first_s > 0
    assert t0_unix_s(recording.meta) == pytest.approx(began_unix_s + first_s, abs=1e-5)
    assert read_capture(str(tmp_path / "a.h5")).tick_0_unix_s == began_unix_s
    recover_run(str(kept), str(tmp_path / "again.h5"))
    again = read_recording(str(tmp_path / "again.h5"))
    with h5py.File(tmp_path / "again.h5") as file:
        first_s = file["device/tick"][0] / TICK_HZ
    assert t0_unix_s(again.meta) == pytest.approx(began_unix_s + first_s, abs=1e-5)
