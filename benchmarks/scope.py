"""How often the scope's page is drawn: three axes at 5 kHz in headless Chromium, counted by requestAnimationFrame.

    python benchmarks/scope.py [--seconds 10] [--port sim://xyz250]

Needs playwright and Chromium, as `make test-browser` installs them. Prints the frames a second that the browser gave
and those in which new samples were drawn; the processor time for each of these, which other work on the machine changes
less: that of the page's thread, the part of it that is the page's own script, that of every process of the browser, and
that of the scope with its virtual stage; and the machine's load.
"""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

COUNT = """() => {
  window.frames = window.drawn = 0;
  const send = WebSocket.prototype.send;
  WebSocket.prototype.send = function (text) {
    window.drawn += text === '{"seen": true}';
    return send.call(this, text);
  };
  const count = () => { window.frames++; requestAnimationFrame(count); };
  requestAnimationFrame(count);
}"""
WAVES = {"x": "sine:60um@5Hz", "y": "triangle:40um@3Hz", "z": "sine:20um@7Hz"}


def cpu_of_s(pid: int) -> float:
    """Processor time of a process."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


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
        whole = browser.new_browser_cdp_session()

        def worked_s() -> dict[str, float]:
            metrics = {one["name"]: one["value"] for one in inside.send("Performance.getMetrics")["metrics"]}
            processes = whole.send("SystemInfo.getProcessInfo")["processInfo"]
            kinds: dict[str, float] = {}
            for one in processes:
                kinds[one["type"]] = kinds.get(one["type"], 0.0) + one["cpuTime"]
            return {
                "page's thread": metrics["TaskDuration"],
                "its script": metrics["ScriptDuration"],
                **{f"process {kind}": cpu_s for kind, cpu_s in sorted(kinds.items())},
                "scope": cpu_of_s(scope.pid),
            }

        before_s = worked_s()
        page.evaluate(COUNT)
        page.wait_for_timeout(1000 * given.seconds)
        (frames, drawn), after_s = page.evaluate("[window.frames, window.drawn]"), worked_s()
        print(f"{frames / given.seconds:.1f} frames/s, {drawn / given.seconds:.1f} with new samples")
        each = (f"{name} {1e3 * (after_s[name] - before_s[name]) / drawn:.1f}" for name in after_s)
        print(f"ms of processor for each of these: {', '.join(each)}; {page.inner_text('#drops')}")
        print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, {platform.processor() or platform.machine()}")
        browser.close()
        scope.terminate()


if __name__ == "__main__":
    main()
