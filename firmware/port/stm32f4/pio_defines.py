"""PlatformIO, before the build: version and build id, the latter as the host library is given it, and the board,
by its section's name."""

# ruff: noqa: F821
import re
import runpy
from pathlib import Path

Import("env")
project = Path(env.subst("$PROJECT_DIR"))
build_id = runpy.run_path(str(project / "firmware" / "build_id.py"))["build_id"](project)
texts = {
    "PHASELEAD_BUILD_ID": build_id,
    "BOARD_NAME": env["PIOENV"],
    "BOARD_FILE": f"port/stm32f4/boards/{env['PIOENV']}.h",
}
version = runpy.run_path(str(project / "host" / "phaselead" / "version.py"))["VERSION"]
major, minor, patch = (int(part) for part in re.findall(r"\d+", version)[:3])
env.Append(CPPDEFINES=[("PHASELEAD_VERSION", f"{major << 16 | minor << 8 | patch}u")])
env.Append(CPPDEFINES=[(name, f'\\"{text}\\"') for name, text in texts.items()])
