"""How often the scope's page is drawn: three axes at 5 kHz in headless Chromium, counted by requestAnimationFrame.

    python benchmarks/scope.py [--seconds 10] [--port sim://xyz250]

Needs playwright and Chromium, as `make test-browser` installs them. Prints the frames a second that the browser gave
and those in which new samples were drawn, the processor time of the page's thread for each, and the machine's load.
"""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys

from playwright.sync_api import sync_playwright

COUNT = """() => {
  window.frames = 0;
  const count = () => { window.frames++; requestAnimationFrame(count); };
  requestAnimationFrame(count);
}"""
WAVES = {"x": "sine:60um@5Hz", "y": "triangle:40um@3Hz", "z": "sine:20um@7Hz"}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--port", default="sim://xyz250")
    given = parser.parse_args()
    command = [sys.executable, "-m", "phaselead", "scope", "--port", given.port, "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as scope, sync_playwright() as browsers:
        assert scope.stdout is not None
        link = next(line for line in scope.stdout if line.startswith("http")).strip()
        browser = browsers.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1440, "height": 1100})
        page.goto(link)
        for axis, wave in WAVES.items():
            page.get_by_label(f"waveform of {axis}").fill(wave)
        page.get_by_role("button", name="Play").click()
        page.locator("#state", has_text="running").wait_for()
        page.wait_for_timeout(2500)
        inside = page.context.new_cdp_session(page)
        inside.send("Performance.enable", {"timeDomain": "threadTicks"})

        def worked_s() -> float:
            metrics = inside.send("Performance.getMetrics")["metrics"]
            return next(one["value"] for one in metrics if one["name"] == "TaskDuration")

        before_s = worked_s()
        page.evaluate(COUNT)
        page.wait_for_timeout(1000 * given.seconds)
        frames, after_s = page.evaluate("window.frames"), worked_s()
        print(f"{frames / given.seconds:.1f} frames/s; {page.inner_text('#rate')} with new samples")
        print(
            f"{1e3 * (after_s - before_s) / frames:.1f} ms of the page's thread for each; {page.inner_text('#drops')}"
        )
        print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, {platform.processor() or platform.machine()}")
        browser.close()
        scope.terminate()


if __name__ == "__main__":
    main()
