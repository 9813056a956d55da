"""Devices without a session: ports, stop, flash, replay, and serving a virtual one."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from phaselead.control import GainsLike, Run
    from phaselead.device import FaultPage
    from phaselead.gcs import Served
    from phaselead.model import StageLike
    from phaselead.result import Facts
    from phaselead.serial_ports import Ports
    from phaselead.sim import Replay


def ports() -> Ports:
    """Serial ports of this machine, without opening any. The virtual stage sim://xyz250 is always there.

    >>> import phaselead as pl
    >>> [port.url for port in pl.ports()]  # doctest: +ELLIPSIS
    [...]
    """
    from phaselead.serial_ports import list_ports

    return list_ports()


def stop(port: str | None = None) -> int:
    """Ramps every axis to its safe value at once, whoever armed the device. Returns the device's tick.

    It opens the port (default as for ``connect``); within a session use the controller's ``stop``. Raises LinkError
    when the port is in use, missing or silent.

    >>> import phaselead as pl
    >>> pl.stop("sim://xyz250")  # a virtual stage is a fresh one each time: its first tick
    0
    """
    from phaselead.device import Device
    from phaselead.serial_ports import default_port

    return Device.stop_now(port or default_port()).tick


def explain(fault: str) -> FaultPage:
    """What the manual says of a fault: why it stops the device, and what to do. Raises BadInput for a name of none.

    >>> import phaselead as pl
    >>> pl.explain("adc_rail").text[:30]
    'Cause: on an axis that follows'
    >>> pl.explain("rail")
    Traceback (most recent call last):
    phaselead.errors.BadInput: 'rail' is no fault of the device; did you mean adc_rail?
    """
    from phaselead.device import explain_fault

    return explain_fault(fault)


def replay(run: Run | str | os.PathLike[str]) -> Replay:
    """Executes a run again, from its converter codes, commands, model and first state, and compares every DAC code.

    ``run`` is a run or its file (.h5). The result is true when every code is the same. Raises BadInput when the run
    lacks what a replay needs: it is gapped, decimated, or was not taken from a device.

    >>> import phaselead as pl
    >>> with pl.connect() as dev:
    ...     run = dev.track("sine:60um@5Hz", mode="pid", duration=0.4)
    >>> bool(pl.replay(run))
    True
    """
    from phaselead.device import read_capture
    from phaselead.sim import Replay
    from phaselead.sim import replay as replay_capture

    if isinstance(run, str | os.PathLike):
        name, capture = os.fspath(run), read_capture(run)
    else:
        name, capture = run.recording.source, run.capture
    return Replay(name, len(capture.ticks), replay_capture(capture))


def sim(
    url: str = "sim://xyz250",
    *,
    link: str | os.PathLike[str] | None = None,
    say: Callable[[str], None] | None = None,
) -> None:
    """Serves a virtual stage on a pseudo-terminal, at real time, until Ctrl-C or SIGTERM; prints the terminal's path,
    or gives it to ``say``.

    ``url`` is sim://xyz250, sim://FILE.toml or a stage file; ``link`` a symbolic link to the terminal. In this process
    a virtual stage needs no server: ``connect("sim://xyz250")``. Raises BadInput for a stage that cannot be used.

    >>> import phaselead as pl
    >>> pl.sim("nowhere.toml")
    Traceback (most recent call last):
    phaselead.errors.BadInput: nowhere.toml: cannot be read (No such file or directory); give a stage file (.toml)
    """
    from phaselead.sim import serve

    serve(url if url.startswith("sim://") else f"sim://{url}", link_path=link, say=say)


def scope(
    port: str | None = None,
    *,
    axes: str = "xyz",
    model: StageLike | None = None,
    output: str | os.PathLike[str] = ".",
    park_after: float = 10.0,
    page_port: int = 0,
    say: Callable[[str], None] = print,
    say_link: Callable[[str], None] = print,
) -> None:
    """Serves a page on this computer that shows every tick of ``axes`` live and drives them, until Ctrl-C, which parks.

    ``say_link`` is given the link to open, which works once; nothing moves before somebody there says so. Set-points
    and waveforms use ``model``; what the page saves goes to the folder ``output``, which is made. When no page is open
    for ``park_after`` seconds the device is parked, and ``say`` is told; 0: never. ``page_port`` is of 127.0.0.1, 0 for
    any that is free. Raises BadInput for a folder that cannot be made or a page port that is taken; else as
    ``connect``.

    >>> import phaselead as pl
    >>> pl.scope("sim://nowhere")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    phaselead.errors.BadInput: there is no built-in stage 'nowhere'; use sim://FILE.toml, or one of ...
    """
    from phaselead.scope import serve

    serve(
        port,
        axes=axes,
        model=model,
        folder=Path(output),
        park_after_s=park_after,
        page_port=page_port,
        say=say,
        say_link=say_link,
    )


def gcs(
    port: str | None = None,
    *,
    listen: str | None = None,
    pty: bool = False,
    link: str | os.PathLike[str] | None = None,
    axes: str | None = None,
    model: StageLike | None = None,
    mode: str | None = None,
    gains: GainsLike | None = None,
    say: Callable[[str], None] = print,
    say_ready: Callable[[Served], None] = print,
) -> None:
    """Serves the device to programs that speak PI's General Command Set (PIPython, Micro-Manager), until Ctrl-C, which
    parks it.

    ``listen`` is an address and port of this computer, "127.0.0.1:50000" unless it is served on a pseudo-terminal
    (``pty``, and ``link`` to it) alone. Nothing moves before a program sends SVO 1, which arms and holds ``axes``:
    those of ``model``, else of the model that the device holds, else x; in ``mode`` and with ``gains`` as for ``move``.
    ``say`` is told what a person should know, ``say_ready`` where it is served. Raises BadInput for an address that is
    not of this computer or taken; else as ``connect``.

    >>> import phaselead as pl
    >>> pl.gcs(listen="0.0.0.0:50000")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    phaselead.errors.BadInput: 0.0.0.0:50000: only this computer may connect...
    """
    from phaselead.gcs import serve

    serve(
        port,
        listen=listen,
        pty=pty,
        link=link,
        axes=axes,
        model=model,
        mode=mode,
        gains=gains,
        say=say,
        say_ready=say_ready,
    )


def flash(
    port: str | None = None,
    *,
    env: str | None = None,
    check_only: bool = False,
    wire: bool = False,
    image: str | os.PathLike[str] | None = None,
) -> Facts:
    """Builds the firmware, uploads it, then checks over the wire that the board runs it; from the source tree.

    ``port`` is the board's serial line, ``env`` its name in platformio.ini, by default the first there. ``check_only``
    uploads nothing. Gives ``board``, ``build_id`` and ``runs_it``.
    With ``wire`` it is sent over that line, tried and confirmed, without a debugger; ``env`` is by default what the
    device is, and ``image`` an update.bin to send instead of building one. Gives ``replaced``, ``version`` and ``slot``
    as well.
    Raises BadInput outside a source tree or without a board, PhaseleadError when the build, the upload or the check
    fails.

    >>> import phaselead as pl
    >>> pl.flash("sim://xyz250")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    phaselead.errors.BadInput: sim://xyz250 is no board; ...
    """
    from phaselead.device import flash_board, flash_by_wire
    from phaselead.serial_ports import default_port

    if wire:
        return flash_by_wire(port or default_port(), env, image=None if image is None else Path(image))
    return flash_board(port or default_port(), env, check_only=check_only)
