"""Programs in C beside their tests, compiled with the firmware's sources."""

import os
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[2]
SOURCES = [*ROOT.glob("firmware/core/*.c"), *ROOT.glob("firmware/app/*.c"), ROOT / "firmware/port/host/flash.c"]
FLAGS = ["-std=c11", "-Wall", "-Wextra", "-Werror", f"-I{ROOT / 'firmware'}"]


def build(folder, name, *flags):
    """The program of NAME.c in this folder. Raises subprocess.CalledProcessError."""
    path = folder / name
    source = Path(__file__).with_name(f"{name}.c")
    subprocess.run([os.environ.get("CC", "cc"), *FLAGS, *flags, source, *SOURCES, "-o", path], check=True)
    return path


def numbers(path, *arguments):
    """What it prints: one row of integers a line."""
    said = subprocess.run([path, *map(str, arguments)], capture_output=True, text=True, check=True).stdout
    return [tuple(map(int, line.split())) for line in said.splitlines()]
