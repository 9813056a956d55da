"""Examples under the help of every command; tests/cli parses each of them."""

from __future__ import annotations

import click

EXAMPLES: dict[str, tuple[str, ...]] = {
    "demo": ("demo --out demo",),
    "identify": (
        "identify --port /dev/ttyACM0 -o stage.toml --save kept",
        "identify --port /dev/ttyACM0 -o stage.toml --u-max 5V --duration 120s",
    ),
    "tune": (
        "tune --port /dev/ttyACM0 --model stage.toml -o tuned.toml --report tuned.html",
        "tune --axis y --model tuned.toml -o both.toml --peak 1.7",
    ),
    "fit": (
        "fit kept/x-5V-5Hz.h5 kept/x-5V-10Hz.h5 -o stage.toml",
        "fit rig.csv@5:7 --map t_s=2,u_V=4,x_um=3 -o stage.toml",
    ),
    "verify": ("verify --model stage.toml other.csv",),
    "predict": ("predict --model stage.toml other.csv -o predicted.csv",),
    "upload": ("upload stage.toml --persist --port /dev/ttyACM0",),
    "track": (
        "track sine:60um@5Hz --model stage.toml -o run.h5",
        "track triangle:100um@20Hz --model stage.toml --mode inverse+pid",
        "track x=sine:60um@5Hz,y=sine:30um@5Hz --mode pid",
        "track sine:5V@5Hz --mode open",
    ),
    "learn": ("learn sine:30um@50Hz --model stage.toml -o learned.h5 --report learned.html",),
    "move": (
        "move x=50um --model stage.toml --port /dev/ttyACM0",
        "move x=+5um,y=20um --speed 500 --port /dev/ttyACM0",
    ),
    "hold": ("hold --port /dev/ttyACM0",),
    "where": ("where --port /dev/ttyACM0",),
    "limits": ("limits --port /dev/ttyACM0", "limits --axis x --u-min 0V --u-max 8V --x-max 90um --port /dev/ttyACM0"),
    "scope": ("scope", "scope --port /dev/ttyACM0 --model stage.toml --out kept"),
    "gcs": ("gcs --model stage.toml --port /dev/ttyACM0", "gcs --axis x,y,z --pty --link ./pi"),
    "arm": ("arm --port /dev/ttyACM0",),
    "park": ("park --port /dev/ttyACM0",),
    "stop": ("stop --port /dev/ttyACM0",),
    "status": ("status --port /dev/ttyACM0",),
    "info": ("info --port /dev/ttyACM0 --json -",),
    "doctor": ("doctor --port /dev/ttyACM0",),
    "explain": ("explain adc_rail", "explain"),
    "ports": ("ports",),
    "sim": ("sim --pty --link ./stage",),
    "flash": ("flash --port /dev/ttyACM0", "flash --wire --port /dev/ttyACM0"),
    "selftest": ("selftest --port /dev/ttyACM0 --axis x",),
    "completion": ("completion bash >> ~/.bashrc",),
    "plot": (
        "plot run.h5 -o run.png",
        "plot before.h5 after.h5 --of error -o both.svg",
        "plot run.h5 --of spectrum -o noise.png",
    ),
    "log record": ("log record --drive sine:5V@5Hz -o open.h5",),
    "log trigger": ("log trigger --on threshold --axis x --above 30 --port /dev/ttyACM0",),
    "log pull": ("log pull -o before-the-fault.h5 --port /dev/ttyACM0",),
    "log faults": ("log faults --port /dev/ttyACM0",),
    "log info": ("log info run.h5",),
    "log export": ("log export run.h5 run.csv",),
    "log import": ("log import rig.mat --map u_V=drive,x_um=sensor*1e-3 --rate 10kHz -o rig.h5",),
    "log recover": ("log recover run.h5.journal -o run.h5",),
    "replay": ("replay run.h5",),
    "gap": ("gap --model stage.toml --train a.csv --holdout b.csv -o next.toml --report gap.html",),
    "gap next": ("gap next gap.json --port /dev/ttyACM0 --model stage.toml -o more.h5",),
    "gap campaign": ("gap campaign --truth tests/gap/truth --limit 20 -o trial",),
}
"""By command, without the program's name."""


def _text(lines: tuple[str, ...]) -> str:
    return "\b\nExamples:\n" + "\n".join(f"  phaselead {line}" for line in lines)


START = _text(("demo", "doctor --port /dev/ttyACM0", *EXAMPLES["identify"][:1], *EXAMPLES["track"][:1], "track --help"))


def show_examples(name: str, command: click.Command) -> None:
    """Puts the examples of a command, and of those below it, under its help."""
    if name in EXAMPLES and command.epilog is None:
        command.epilog = _text(EXAMPLES[name])
    for below, one in getattr(command, "commands", {}).items():
        show_examples(f"{name} {below}", one)
