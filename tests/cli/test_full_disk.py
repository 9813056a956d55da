"""A disk that fills up, at any size: no half file under the output's name, and what was received is not lost."""

from __future__ import annotations

import json
import os
import resource
import signal
from contextlib import contextmanager
from random import Random

import h5py
import numpy as np
import pytest

from phaselead.device import FrameReader, wire
from phaselead.device.session import Session
from phaselead.errors import BadInput
from phaselead.record import JournalReader

RECORD = ("log", "record", "--drive", "sine:5V@5Hz", "--duration", "2")
IDENTIFY = ("identify", "--levels", "1,2,3V", "--frequencies", "10,15,20", "--no-creep")
TRACK = ("track", "sine:40um@5Hz", "--mode", "pid", "--duration", "1")


@contextmanager
def room_for(size):
    """Files may grow to so many bytes, and fail there as on a full disk (with EFBIG in place of ENOSPC)."""
    limits, handler = resource.getrlimit(resource.RLIMIT_FSIZE), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)


def sizes(largest, name):
    random = Random(name)
    return [0, 10, *sorted(random.randrange(20, largest) for _ in range(8))]


def left_over(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("words", [RECORD, TRACK], ids=["log record", "track"])
def test_a_recording_on_a_disk_that_fills_up(run, tmp_path, words):
    output, journal = tmp_path / "run.h5", tmp_path / "run.h5.journal"
    assert run(*words, "-o", output).status == 0
    largest = 2 * output.stat().st_size
    output.unlink()
    kept = 0
    for size in sizes(largest, words[0]):
        with room_for(size):
            outcome = run(*words, "-o", output)
        if outcome.status == 0:
            assert left_over(tmp_path) == ["run.h5"]
            output.unlink()
            continue
        assert outcome.error is None, (size, outcome)
        assert (outcome.status, outcome.err.count("\n")) == (2, 1), (size, outcome)
        assert not output.exists()
        assert set(left_over(tmp_path)) <= {"run.h5.journal"}, size
        if f"phaselead log recover {journal}" in outcome.err:
            recovered = run("log", "recover", journal, "-o", output, "--json", "-")
            assert recovered.status == 0, recovered.err
            assert json.loads(recovered.out)["samples"] > 0
            kept += 1
            output.unlink()
        elif journal.exists():
            pytest.fail(f"a journal was left without a word: {outcome.err}")
    assert kept > 3


@pytest.mark.parametrize("suffix", [".csv", ".h5", ".mat", ".parquet"])
def test_a_conversion_on_a_disk_that_fills_up(run, tmp_path, suffix):
    assert run(*RECORD, "-o", tmp_path / "run.h5").status == 0
    out = tmp_path / f"out{suffix}"
    assert run("log", "export", tmp_path / "run.h5", out).status == 0
    largest = out.stat().st_size
    for size in sizes(largest - 1, suffix):
        before = b"what stood there"
        out.write_bytes(before)
        with room_for(size):
            outcome = run("log", "export", tmp_path / "run.h5", out, "--overwrite")
        assert outcome.error is None, (size, outcome)
        assert (outcome.status, outcome.err.count("\n")) == (2, 1), (size, outcome)
        assert out.read_bytes() == before
        assert left_over(tmp_path) == sorted(["run.h5", out.name])


def test_recovering_on_a_disk_that_fills_up_keeps_the_journal(run, tmp_path, journal):
    output = tmp_path / "run.h5"
    content = journal.read_bytes()
    for size in sizes(20_000, "recover"):
        with room_for(size):
            outcome = run("log", "recover", journal, "-o", output)
        assert (outcome.status, outcome.err.count("\n")) == (2, 1), (size, outcome)
        assert left_over(tmp_path) == ["run.h5.journal"]
        assert journal.read_bytes() == content


@pytest.fixture
def journal(run, tmp_path, monkeypatch):
    """Of a run of two seconds that could not be written in the end."""

    def failing(*_arguments, **_named):
        raise BadInput("run.h5: cannot be written (No space left on device)")

    with monkeypatch.context() as patch:
        patch.setattr("phaselead.control.journal.convert", failing)
        assert run(*RECORD, "-o", tmp_path / "run.h5").status == 2
    return tmp_path / "run.h5.journal"


def test_everything_to_the_last_whole_frame_is_recovered_wherever_it_ends(run, tmp_path, journal):
    content, random = journal.read_bytes(), Random(5)
    output = tmp_path / "run.h5"
    head = content.index(b"\n") + 1
    recovered = 0
    for cut in sorted(random.randrange(head, len(content)) for _ in range(25)):
        journal.write_bytes(content[:cut])
        with JournalReader(journal) as reader:
            entries = list(reader)
        line = b"".join(payload for kind, payload in entries if kind == "rx")
        batches = [wire.Samples.unpack(b[11:]) for b in FrameReader().feed(line) if b[0] == wire.Samples.NUMBER]
        outcome = run("log", "recover", journal, "-o", output)
        if not batches:
            assert (outcome.status, outcome.err.count("\n")) == (2, 1)
            continue
        assert outcome.status == 0, outcome.err
        with h5py.File(output) as file:
            ticks = file["device/tick"][:]
        assert ticks[0] == batches[0].first_tick
        assert len(ticks) == sum(len(batch.data) for batch in batches) // 12
        assert (np.diff(ticks) == 1).all()
        recovered += 1
        output.unlink()
    assert recovered > 15


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="needs a folder that even root cannot write to")
@pytest.mark.parametrize("words", [RECORD, TRACK, IDENTIFY, ("log", "export", "IN")])
def test_a_folder_that_cannot_be_written_to_is_told_before_anything_moves(run, tmp_path, words, monkeypatch):
    """Root may write anywhere by its permissions, so that only the attempt tells."""
    made = tmp_path / "in.csv"
    made.write_text("t_s,u_V,x_um\n" + "".join(f"{i / 1000},{i},{i}\n" for i in range(20)))
    starts = []
    submit = Session.submit

    def counted(session, command):
        starts.extend([command] * isinstance(command, wire.StartRequest))
        return submit(session, command)

    monkeypatch.setattr(Session, "submit", counted)
    name = "out.h5" if words[0] != "identify" else "out.toml"
    named = [str(made) if word == "IN" else word for word in words] + ["-o"] * ("export" not in words)
    outcome = run(*named, f"/proc/self/{name}")
    assert outcome.error is None
    assert (outcome.status, outcome.err.count("\n")) == (2, 1), outcome
    assert starts == []
    assert run(*named, tmp_path / name).status == 0
    assert bool(starts) == ("export" not in words)
