"""PlatformIO, before the build: the build id, as the host library is given it."""

# ruff: noqa: F821
import runpy
from pathlib import Path

Import("env")
project = Path(env.subst("$PROJECT_DIR"))
build_id = runpy.run_path(str(project / "firmware" / "build_id.py"))["build_id"](project)
env.Append(CPPDEFINES=[("PHASELEAD_BUILD_ID", f'\\"{build_id}\\"')])
