"""The page in headless Chromium against the virtual stage: ``make test-browser``."""

from __future__ import annotations

import itertools
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from phaselead.model import load_stage, save_stage
from phaselead.sim import built_in

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: make test-browser")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")

pytestmark = [pytest.mark.browser, pytest.mark.skipif(CHROMIUM is None, reason="no Chromium: make test-browser")]

ENDED = "ERR_CONNECTION_REFUSED"
"""Of a page whose scope has ended before it."""
SIZES = {"desktop": (1440, 1100), "phone": (390, 844)}


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with sync_api.sync_playwright() as browsers:
        browser = browsers.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture
def served(tmp_path: Path) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """The link of a scope that runs as a user runs it, and its process."""
    command = [sys.executable, "-m", "phaselead", "scope", "--no-browser", "--out", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env={**os.environ}) as scope:
        assert scope.stdout is not None
        yield next(line for line in scope.stdout if line.startswith("http")).strip(), scope
        if scope.poll() is None:
            scope.send_signal(signal.SIGINT)
        assert scope.wait(90) == 0


@pytest.fixture
def stage_path(tmp_path: Path) -> Path:
    save_stage(tmp_path / "stage.toml", built_in("xyz250"))
    return tmp_path / "stage.toml"


@pytest.fixture
def context(chromium: Any) -> Iterator[Any]:
    """A browser of its own, in which no script may fail."""
    context = chromium.new_context(viewport=dict(zip(("width", "height"), SIZES["desktop"], strict=True)))
    context.set_default_timeout(90_000)
    wrong: list[str] = []
    context.on("weberror", lambda error: wrong.append(str(error.error)))
    context.on("console", lambda message: message.type == "error" and wrong.append(message.text))
    yield context
    context.close()
    assert [line for line in wrong if ENDED not in line] == []


def opened(context: Any, link: str) -> Any:
    page = context.new_page()
    page.goto(link)
    page.locator("#state[data-state=parked]").wait_for()
    return page


def play(page: Any, wave: str = "sine:40um@5Hz") -> None:
    page.get_by_label("waveform of x").fill(wave)
    page.get_by_role("button", name="Play").click()
    page.locator("#state[data-state=running]").wait_for()


def until_inked(page: Any, plot: str) -> None:
    """Waits until a plot has a trace: pixels that are not its ground. Of the traces over time grid and words are on
    another canvas."""
    page.wait_for_function(
        """(id) => {
          const canvas = document.querySelector(`#${id} canvas.bands`) ?? document.querySelector(`#${id} canvas`);
          const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
          let count = 0;
          for (let i = 3; i < data.length; i += 4) count += data[i] > 128;
          return count > 500;
        }""",
        arg=plot,
    )


def test_play_and_the_space_bar_stops(context, served):
    page = opened(context, served[0])
    play(page)
    sync_api.expect(page.locator(".readout b").first).to_have_text(re.compile("^3"))
    for plot in ("position", "error", "effort", "feedback", "spectrum", "loop"):
        until_inked(page, plot)
    page.keyboard.press("Space")
    page.locator("#state[data-state=parked]").wait_for()
    assert "STOP" in page.inner_text("#lines")


FAR = """(id) => {
  const canvas = document.querySelector(`#${id} canvas.bands`), { width, height } = canvas;
  const { data } = canvas.getContext("2d").getImageData(0, 0, width, height);
  const alpha = (x, y) => (x < 0 || y < 0 || x >= width || y >= height ? 0 : data[4 * (y * width + x) + 3]);
  if (!window.before) { window.before = { width, height, data }; return null; }
  const near = (x, y) => {
    for (let dx = -3; dx <= 3; dx++) for (let dy = -3; dy <= 3; dy++) if (alpha(x + dx, y + dy) > 40) return true;
    return false;
  };
  let inked = 0, far = 0;
  for (let y = 0; y < height; y++) for (let x = 4; x < width - 4; x++) {
    if (window.before.data[4 * (y * width + x) + 3] < 200) continue;
    inked++;
    far += !near(x, y);
  }
  return [inked, far];
}"""
"""Of two looks at a plot: pixels that were inked in the first, and those with no ink near them in the second."""


TWO_FRAMES = "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
"""Of the screen, after which everything that was known before them is drawn."""

COUNT_DRAWN = """() => {
  const send = WebSocket.prototype.send;
  window.drawn = 0;
  WebSocket.prototype.send = function (text) {
    window.drawn += text === '{"seen": true}';
    return send.call(this, text);
  };
}"""


def test_what_is_shifted_on_is_what_would_be_drawn_anew(context, served):
    """The traces are shifted by whole pixels as columns come, though a column is no whole pixel wide."""
    page = opened(context, served[0])
    page.select_option("#window", "0.5")
    play(page, "square:40um@3Hz")
    page.evaluate(COUNT_DRAWN)
    page.wait_for_function("() => window.drawn > 150")
    page.locator("#pause").click()
    page.evaluate(TWO_FRAMES)  # what had come before the pause is drawn with the next frame
    assert page.evaluate(FAR, "position") is None
    page.emulate_media(color_scheme="dark")  # draws everything anew
    page.evaluate(TWO_FRAMES)
    inked, far = page.evaluate(FAR, "position")
    assert inked > 1500
    assert far < inked / 100


def test_set_points_refusals_and_saving(context, served, tmp_path):
    page = opened(context, served[0])
    page.select_option("#mode", "pid")
    page.get_by_label("target of x, µm").fill("30")
    page.get_by_role("button", name="Move").click()
    page.get_by_text("on target").wait_for()
    page.get_by_label("target of x, µm").evaluate("(input) => { input.value = 900; input.form.noValidate = true; }")
    page.get_by_role("button", name="Move").click()
    page.locator("#alert:not([hidden])").wait_for()
    assert "sensor" in page.inner_text("#alert")
    page.locator("#saving [name=name]").fill("kept.h5")
    page.get_by_role("button", name="Save HDF5").click()
    page.get_by_role("link", name="kept.h5").wait_for()
    assert (tmp_path / "kept.h5").exists()


def test_a_reload_goes_on_and_a_second_tab_looks_on(context, served):
    page = opened(context, served[0])
    play(page)
    page.reload()
    page.locator("#state[data-state=running]").wait_for()
    page.locator("#park:enabled").wait_for()
    second = context.new_page()
    second.goto(page.url)
    second.locator("#who", has_text="looks on").wait_for()
    assert second.locator("#park").is_disabled()
    second.locator("#stop").click()
    page.locator("#state[data-state=parked]").wait_for()


def test_a_fault_is_said_and_stays_in_view(context, served):
    page = opened(context, served[0])
    for name, gain in (("Kp", "0.017"), ("Ki", "8.62"), ("Kd", "0")):
        page.get_by_label(f"{name} of x").fill(gain)
    page.get_by_label("waveform of x").fill("sine:60um@5Hz")
    page.get_by_role("button", name="Play").click()
    page.locator("#state[data-state=fault]").wait_for()
    page.locator("#alert").get_by_text("oscillation").wait_for()
    page.get_by_text("Cause: the loop runs away").wait_for()
    page.get_by_role("button", name="Go on").click()
    page.get_by_role("button", name="Park").click()
    page.locator("#state[data-state=parked]").wait_for()


def test_settings_are_changed_and_refused(context, served, stage_path):
    page = opened(context, served[0])
    page.locator("#model-path").fill(str(stage_path))
    page.get_by_role("button", name="Upload", exact=True).click()
    page.locator("#settings").get_by_text("Limits", exact=True).click()
    field = page.locator("[name='limits.u_max_V']")
    field.fill("8")
    page.get_by_role("button", name="Save and upload").click()
    page.get_by_text("limits.u_max_V changed and uploaded").wait_for()
    sync_api.expect(field).to_have_value("8")
    field.fill("-5")
    page.get_by_role("button", name="Save and upload").click()
    page.locator("#alert:not([hidden])").wait_for()
    assert "u_max_V" in page.inner_text("#alert")
    assert page.locator("#settings details[open]").count() == 1


def test_filters_and_effects_are_edited(context, served, stage_path, tmp_path):
    page = opened(context, served[0])
    page.locator("#model-path").fill(str(stage_path))
    page.get_by_role("button", name="Upload", exact=True).click()
    page.get_by_text("Filters of the loop", exact=True).click()
    page.get_by_label("kind of filter 1").select_option("notch")
    sync_api.expect(page.locator("[name='filters.0.zeros_Hz']")).to_have_value("200")
    assert page.locator("[name='filters.0.poles_Hz']").is_hidden()
    page.locator("[name='filters.0.zeros_Hz']").fill("190")
    page.get_by_text("Effect: Resonance", exact=True).click()
    page.locator("[name='effects.1.resonance.zeta']").fill("0.03")
    page.get_by_text("Effect: Creep", exact=True).click()
    page.locator("[name='effects.0.creep']").check()
    page.get_by_role("button", name="Save and upload").click()
    page.get_by_text("effects.0.creep changed and uploaded").wait_for()
    (kept,) = tmp_path.glob("settings-*.toml")
    axis = load_stage(kept).axis("x")
    assert [(one.zeros_Hz, one.poles_Hz) for one in axis.gains.filters] == [(190, 190)]
    assert [effect.name for effect in axis.effects if effect.name in ("creep", "resonance")] == ["resonance"]
    assert axis.effects[0].params["zeta"] == 0.03
    sync_api.expect(page.get_by_label("kind of filter 1")).to_have_value("notch")
    page.locator("[name='effects.0.resonance.zeta']").fill("3")
    page.get_by_role("button", name="Save and upload").click()
    page.locator("#alert:not([hidden])").wait_for()
    assert "resonance.zeta = 3: must be 0.002 to 0.5" in page.inner_text("#alert")


def test_the_scope_that_ends_is_said(context, served):
    page = opened(context, served[0])
    served[1].send_signal(signal.SIGINT)
    page.get_by_text("does not answer").wait_for()
    served[1].wait(90)


def test_it_fits_every_screen(context, served):
    """Nothing sticks out, and STOP is in view wherever the page is scrolled to."""
    page = opened(context, served[0])
    for scheme, size in itertools.product(["light", "dark"], SIZES):
        page.emulate_media(color_scheme=scheme)
        page.set_viewport_size(dict(zip(("width", "height"), SIZES[size], strict=True)))
        page.evaluate("scrollTo(0, document.body.scrollHeight)")
        assert page.evaluate("document.documentElement.scrollWidth") <= SIZES[size][0], (scheme, size)
        box = page.locator("#stop").bounding_box()
        assert box is not None
        assert 0 <= box["y"] <= SIZES[size][1] - box["height"], (scheme, size)
        assert box["height"] >= 44, (scheme, size)
