"""A copy of the working tree whose firmware library is built with flags of its own, and its tests run there."""

from __future__ import annotations

import os
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LIBRARY = "host/phaselead/sim/_firmware.so"
PARTS = ("firmware/core", "firmware/app", "firmware/port/host", "host/phaselead/sim/kernel")
INCLUDE = ("-Ifirmware", "-Ihost/phaselead/sim/kernel")


class FirmwareTree:
    """The files that git knows or would know, and the kernels as they were built, below ``folder``.

    ``flags`` go to every compilation of the firmware, those of the tests (through ``CC``) included.
    """

    def __init__(self, folder: Path, *flags: str) -> None:
        self.folder, self.flags = folder, flags
        self.objects = folder / "objects"
        shutil.rmtree(folder, ignore_errors=True)
        listed = subprocess.run(
            ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
            cwd=ROOT, check=True, capture_output=True, text=True,
        ).stdout.split("\0")  # fmt: skip
        built = (str(path.relative_to(ROOT)) for path in ROOT.glob("host/**/*.so"))
        self.names = [name for name in [*sorted(filter(None, listed)), *built] if (ROOT / name).is_file()]
        for name in self.names:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)
        self.objects.mkdir()
        self.build_id = runpy.run_path(str(ROOT / "firmware" / "build_id.py"))["build_id"](ROOT)
        self.compiler = folder / "cc"
        self.compiler.write_text(f'#!/bin/sh\nexec gcc "$@" {" ".join(flags)}\n')
        self.compiler.chmod(0o755)

    def _object(self, source: Path) -> Path:
        return self.objects / (str(source.relative_to(self.folder)).replace("/", "-") + ".o")

    def _is_stale(self, source: Path) -> bool:
        built = self._object(source)
        if not built.is_file():
            return True
        words = built.with_suffix(".d").read_text().replace("\\\n", " ").split()[1:]
        return any((self.folder / word).stat().st_mtime_ns > built.stat().st_mtime_ns for word in words)

    def build(self) -> bool:
        """Compiles what changed and links. False where it does not compile."""
        sources = [source for part in PARTS for source in sorted((self.folder / part).glob("*.c"))]
        common = [str(self.compiler), "-std=c11", "-O1", "-ffp-contract=off", "-fno-strict-aliasing", "-fPIC"]
        common += ["-fvisibility=hidden", *INCLUDE, f'-DPHASELEAD_BUILD_ID="{self.build_id}"']
        for source in filter(self._is_stale, sources):
            target = self._object(source)
            command = [*common, "-MMD", "-c", str(source.relative_to(self.folder)), "-o", str(target)]
            if subprocess.run(command, cwd=self.folder, capture_output=True, check=False).returncode:
                target.unlink(missing_ok=True)
                return False
        (self.folder / LIBRARY).unlink(missing_ok=True)
        command = [str(self.compiler), "-shared", *(str(self._object(source)) for source in sources), "-lm"]
        return subprocess.run([*command, "-o", LIBRARY], cwd=self.folder, check=False).returncode == 0

    def test(self, *arguments: str, cpu_s: int | None = None) -> subprocess.CompletedProcess[str]:
        """Runs pytest there; the result says what it printed. ``cpu_s`` bounds the processor time of each process."""
        environment = {**os.environ, "CC": str(self.compiler), "PYTHONDONTWRITEBYTECODE": "1"}
        environment["PYTHONPATH"] = f"{self.folder / 'host'}:{self.folder / 'tests'}"
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *arguments]
        if cpu_s is not None:
            command = ["prlimit", f"--cpu={cpu_s}", *command]
        return subprocess.run(command, cwd=self.folder, env=environment, capture_output=True, text=True, check=False)
