"""The hub through its websocket: what is seen, who drives, what stops, what is kept."""

from __future__ import annotations

import math
import subprocess
import sys
import threading
import time
from importlib import import_module
from types import SimpleNamespace

import numpy as np
import pytest

import phaselead as pl
from phaselead import report
from phaselead.device import TICK_HZ
from phaselead.record import t0_unix_s
from phaselead.scope.samples import TRACES
from phaselead.scope.view import COLUMNS, HEAD, LOOP, SPECTRUM
from phaselead.sim import built_in

WAVE = {"x": "sine:20um@5Hz"}


def heads(tab) -> list[tuple]:
    return [HEAD.unpack_from(frame) for frame in tab.frames]


def running(tab) -> bool:
    return tab.state.get("state") == "running"


def at_rest(tab) -> bool:
    return tab.state.get("state") == "parked"


def test_traces_spectrum_and_loop_come_while_nothing_moves(rig):
    tab = rig.open()
    tab.ask(view={"window_s": 0.5, "columns": 200, "spectrum": "x_um", "loop": "y/x"})
    tab.until(lambda: {COLUMNS, SPECTRUM, LOOP} <= {head[0] for head in heads(tab)})
    assert tab.state["state"] == "parked"
    assert tab.welcome["axes"] == "xyz"
    assert {job["name"] for job in tab.welcome["jobs"]} >= {"identify", "learn", "gap"}
    assert not tab.ask(view={"window_s": "long"})["ok"]


def test_move_play_hold_park(rig):
    tab = rig.open()
    assert "x to 30.000 um" in tab.order("move", targets={"x": "30um"}, mode="pid")
    tab.until(lambda: running(tab) and tab.state["axes"]["x"]["on_target"])
    tab.order("move", targets={"x": "+5um"})
    tab.until(lambda: abs(tab.state["axes"]["x"]["x_um"] - 35) < 0.5)
    assert "mode pid" in tab.order("play", waves=WAVE)
    tab.until(lambda: tab.state["axes"]["x"]["moving"])
    tab.order("hold")
    tab.until(lambda: running(tab) and not tab.state["axes"]["x"]["moving"])
    assert tab.order("park") == "parked"
    tab.until(lambda: at_rest(tab))
    tab.order("arm")
    tab.until(lambda: tab.state["state"] == "armed")


def test_the_best_mode_there_is_plays_what_it_moves_in(make_rig):
    tab = make_rig(stage=built_in("xyz250")).open()
    assert "mode inverse+pid" in tab.order("play", waves=WAVE)
    assert tab.order("park") == "parked"
    assert tab.order("play", waves=WAVE, mode="inverse").endswith("mode inverse")


def test_refusals_are_the_lines_of_the_api(rig):
    tab = rig.open()
    assert "sensor" in tab.refused("move", targets={"x": "4000um"})
    assert "needs a model" in tab.refused("play", waves=WAVE, mode="inverse")
    assert "wobble" in tab.refused("play", waves={"x": "wobble"})
    assert "without a model" in tab.refused("loop", axis="x")
    assert "is no order" in tab.refused("format")
    assert "no text" in tab.refused("move", targets={"x": 7})
    assert "is no number" in tab.refused("move", targets={"x": "7um"}, duration="soon")
    tab.until(lambda: any(kind == "refused" for _, kind, _ in tab.state["lines"]))
    assert at_rest(tab)


def test_a_second_tab_looks_on_but_stops(rig):
    first, second = rig.open(), rig.open()
    first.order("play", waves=WAVE)
    second.until(lambda: running(second))
    assert second.state["drives"] is False
    assert "looks on" in second.refused("park")
    assert not second.ask(take=True)["ok"]
    second.until(lambda: second.frames)
    second.socket.send_json({"stop": True})
    second.until(lambda: at_rest(second))
    first.until(lambda: any("STOP" in words for _, _, words in first.state["lines"]))


def test_a_reload_goes_on_driving_and_a_tab_that_is_gone_is_followed(rig, monkeypatch):
    tabs = import_module("phaselead.scope.tabs")
    monkeypatch.setattr(tabs, "RELOAD_S", math.inf)
    first = rig.open()
    name = first.welcome["tab"]
    second = rig.open(name)
    assert second.welcome["tab"] != name  # a copy of a tab that is open
    first.socket.close()
    second.until(lambda: name not in rig.site.tabs.open)
    again = rig.open(name)
    again.until(lambda: "drives" in again.state)
    assert again.state["drives"]
    again.socket.close()
    second.until(lambda: name not in rig.site.tabs.open)
    assert not second.ask(take=True)["ok"]
    monkeypatch.setattr(tabs, "RELOAD_S", 0.0)
    second.until(lambda: second.state.get("may_take"))
    assert second.ask(take=True)["ok"]
    assert "parked" in second.order("park")


def test_nothing_moves_unattended(make_rig):
    said = []
    rig = make_rig(park_after_s=0.5, say=said.append)
    tab = rig.open()
    tab.order("play", waves=WAVE)
    tab.until(lambda: running(tab))
    tab.socket.close()
    end_s = time.monotonic() + 20
    while rig.hub.state()["state"] != "parked" and time.monotonic() < end_s:
        rig.hub._ending.wait(0.05)
    assert rig.hub.state()["state"] == "parked"
    assert said == ["parked: no page was open for 0.5 s"]
    again = rig.open()
    again.until(lambda: any("no page was open" in words for _, _, words in again.state.get("lines", [])))


def test_what_is_saved_is_what_was_recorded(rig, tmp_path):
    tab = rig.open()
    rig.hub.dev.device.session.tick_0_unix_s = 1.7e9  # a simulated device has no clock of its own
    tab.order("play", waves=WAVE)
    tab.until(lambda: rig.hub.samples.end - rig.hub.samples.begin > 6000)
    assert "saved 5000 ticks" in tab.order("save", name="run.h5", seconds=1.0)
    (found,) = pl.read(str(tmp_path / "run.h5"))
    assert len(found.t_s) == 5000
    assert found.rate_Hz == pytest.approx(5000)
    assert np.ptp(found.x_um) > 15
    since_tick_0_s = t0_unix_s(found.meta) - 1.7e9
    assert rig.hub.samples.begin <= since_tick_0_s * TICK_HZ <= rig.hub.samples.end - 5000
    assert "run.h5" in rig.browser.get("/files/run.h5").headers.get("content-disposition", "run.h5")
    assert rig.browser.get("/files/run.h5").content == (tmp_path / "run.h5").read_bytes()
    assert rig.browser.get("/files/other.h5").status_code == 404
    assert "exists" in tab.refused("save", name="run.h5", seconds=1.0)
    for name in ("../run.h5", "run.csv", ".h5"):
        tab.refused("save", name=name)


def test_a_trigger_freezes_its_stretch_and_that_is_saved(rig, tmp_path):
    tab = rig.open()
    tab.order("trigger", run="single", axis="x", trace="x_um", level=10.0, before=0.5, window_s=0.2)
    tab.order("play", waves=WAVE)
    tab.frames.clear()
    tab.until(lambda: any(not math.isnan(head[8]) for head in heads(tab)))
    head = next(one for one in heads(tab) if not math.isnan(one[8]))
    assert head[8] - head[7] == pytest.approx(500)
    tab.order("save", name="shot.h5")
    (found,) = pl.read(str(tmp_path / "shot.h5"))
    assert found.t_s[0] == pytest.approx(-0.1)
    assert found.axes["x"].x_um[500] >= 10 > found.axes["x"].x_um[499]


def test_drops_are_shown_and_a_pulled_cable_is_found_again(make_rig):
    rig = make_rig("faulty://sim://xyz250#lose=0.0002&seed=5")
    tab = rig.open()
    tab.until(
        lambda: tab.state.get("dropped", 0) > 0 and any(frame[-heads(tab)[-1][4] :].count(1) for frame in tab.frames)
    )
    tab.order("play", waves=WAVE)
    tab.until(lambda: running(tab))
    rig.hub.dev.device.session.port.line.unplug()
    tab.until(lambda: any("has gone away" in words for _, _, words in tab.state["lines"]))
    tab.until(lambda: "there again" in tab.state["lines"][-1][2] or tab.state["state"] == "fault")
    tab.until(lambda: "host_timeout" in tab.state["fault"])
    tab.order("park")
    tab.until(lambda: at_rest(tab))


def test_jobs_show_progress_and_stop_ends_them(rig, tmp_path):
    tab = rig.open()
    number = 4711
    tab.socket.send_json({"order": "identify", "id": number, "axes": "x", "duration": ""})
    tab.until(lambda: (tab.state.get("job") or {}).get("share", 0) > 0.01)
    tab.frames.clear()
    tab.until(lambda: tab.frames)
    tab.socket.send_json({"stop": True})
    tab.until(lambda: number in tab._replies)
    assert tab._replies[number]["said"] == "stopped"
    tab.until(lambda: at_rest(tab) and tab.state["job"] is None)
    assert "identified x" in tab.order("identify", axes="x", duration="60")
    tab.until(lambda: tab.state["model"] is not None)
    tab.until(lambda: len(tab.state["files"]) == 2)
    file, page = tab.state["files"]
    assert pl.load(str(tmp_path / file)).axes.keys() == {"x"}
    shown = rig.browser.get(f"/files/{page}")
    assert "What does the model leave?" in shown.text
    command = f"phaselead identify --axis x --duration=60s -o {file} --port sim://xyz250 --report {page}"
    assert f"<code>{command}</code>" in shown.text
    assert "sandbox" in shown.headers["content-security-policy"]
    assert "peak sensitivity" in tab.order("loop", axis="x")
    assert "um rms" in tab.order("learn", wave="x=sine:20um@10Hz", trials="1")
    tab.until(lambda: tab.state["files"][-1].startswith("learned-") and tab.state["files"][-1].endswith(".html"))
    assert "What did each trial leave?" in rig.browser.get(f"/files/{tab.state['files'][-1]}").text
    for name, volts in (("a", 3), ("b", 2)):
        tab.order("play", waves={"x": f"sine:{volts}V@5Hz"}, mode="open")
        tab.until(lambda: running(tab))
        end = rig.hub.samples.end + 5000
        tab.until(lambda end=end: rig.hub.samples.end > end)
        tab.order("save", name=f"{name}.h5", seconds=0.5)
        tab.order("park")
    assert "a folder" in tab.refused("gap", train="../a.h5", holdout="b.h5")


@pytest.fixture(name="left_held")
def _left_held(tmp_path, monkeypatch):
    """The port of a stage that `phaselead move` left at 40 um, on a pseudo-terminal."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    link = tmp_path / "stage"
    command = [sys.executable, "-m", "phaselead", "sim", "--pty", "--link", str(link)]
    served = subprocess.Popen(command, stdout=subprocess.PIPE)
    try:
        served.stdout.readline()
        with pl.connect(str(link)) as dev:
            dev.move(x=40)
            dev.leave_running()
        yield str(link)
    finally:
        served.terminate()
        served.wait()
        served.stdout.close()


def test_what_is_held_is_taken_over_where_it_stands(make_rig, left_held):
    rig = make_rig(left_held, axes="x", park_after_s=0.2)
    while rig.hub.samples.end - rig.hub.samples.begin < 2500:  # 0.5 s on the device: longer than it may be alone
        rig.hub._ending.wait(0.02)
    assert rig.hub.state()["state"] == "running", "nobody has looked yet, so nobody has gone"
    tab = rig.open()
    tab.until(lambda: running(tab) and tab.state.get("axes"))
    x = tab.state["axes"]["x"]
    assert (x["held"], x["moving"], x["target_um"]) == (True, False, 40.0)
    assert any("taken over as it was held: x at 40.000 um" in words for _, _, words in tab.state["lines"])
    r_um = rig.hub.samples.rows(rig.hub.samples.begin, 500)[0, TRACES.index("r_um")]
    assert np.nanmin(r_um) == np.nanmax(r_um) == 40.0
    seen_um = rig.hub.samples.rows(rig.hub.samples.begin, 500)[0, TRACES.index("x_um")]
    assert np.nanmin(seen_um) > 38
    assert "moving x to 45.000 um" in tab.order("move", targets={"x": "+5um"})
    tab.order("park")
    tab.until(lambda: at_rest(tab))


def test_a_line_that_is_too_slow_is_said_once(make_rig):
    rig = make_rig("sim://xyz250?baud=115200")
    tab = rig.open()
    tab.until(lambda: any("baud_budget" in words for _, _, words in tab.state.get("lines", [])))
    began = rig.hub._came_s
    tab.until(lambda: rig.hub._came_s > began + 1.5)  # it has been tried again
    assert sum("baud_budget" in words for _, _, words in rig.hub.lines) == 1
    assert "armed" in tab.order("arm")
    tab.order("park")


def test_tune_is_started_from_the_page(rig, tmp_path, monkeypatch):
    """What it measures and shapes is `dev.tune`, which has tests of its own and takes a minute."""

    def tuned(axis, *, model, level, on_progress):
        assert (axis, model, level) == ("y", None, 0.3)
        on_progress(0.5)
        found, closed = built_in("xyz250"), SimpleNamespace(bandwidth_Hz=140.0, peak_sensitivity=1.9)
        return SimpleNamespace(axis=axis, model=found, save=found.save, closed=closed)

    tab = rig.open()
    assert "tune" in {job["name"] for job in tab.welcome["jobs"]}
    assert "choose 1.2 to 3" in tab.refused("tune", axis="x", peak="9")
    assert "is no number" in tab.refused("tune", axis="x", level="much")
    monkeypatch.setattr(rig.hub.dev, "tune", tuned)
    monkeypatch.setattr(report, "result_page", lambda result: f"the page of {result.axis}")
    assert "tuned y: bandwidth 140 Hz" in tab.order("tune", axis="y", level="0.3", peak="")
    tab.until(lambda: tab.state["model"] is not None and len(tab.state["files"]) == 2)
    file, page = tab.state["files"]
    assert rig.browser.get(f"/files/{page}").text == "the page of y"
    assert pl.load(str(tmp_path / file)).axes.keys() == built_in("xyz250").axes.keys()
    assert "peak sensitivity" in tab.order("loop", axis="x")


def test_a_tab_that_goes_while_an_order_runs_ends_nothing(rig):
    begun, go_on = threading.Event(), threading.Event()

    def slow(_hub, _given):
        begun.set()
        return "" if go_on.wait(60) else "never"

    first, second = rig.hub.give(slow, {}), rig.hub.give(slow, {})
    assert begun.wait(60)
    assert not first.cancel()
    assert second.cancel()  # as a tab that closes does
    go_on.set()
    assert "parked" in rig.open().order("park")


def test_what_is_parked_follows_nothing(rig):
    """Its last reference stood there as an error of half the way."""
    tab, row = rig.open(), TRACES.index("r_um")
    tab.order("play", waves=WAVE)
    tab.until(lambda: running(tab))
    end = rig.hub.samples.end
    tab.until(lambda: rig.hub.samples.end > end + 1000)
    assert np.isfinite(rig.hub.samples.rows(end + 500, 500)[0, row]).all()
    tab.order("park")
    tab.until(lambda: at_rest(tab))
    end = rig.hub.samples.end
    tab.until(lambda: rig.hub.samples.end > end + 1000)
    assert np.isnan(rig.hub.samples.rows(end + 500, 500)[0, row]).all()
    tab.order("trigger", run="off")
    end = rig.hub.samples.end
    tab.until(lambda: rig.hub.samples.end > end + 500)
    assert np.isnan(rig.hub.samples.rows(end, 500)[0, row]).all()
