"""HDF5 files of doubtful origin: HDF5's own library may run forever, or crash, on one that is broken.

A child process walks through the file first, all but its samples, with its processor time bounded; what it survives is
then read as usual. It costs milliseconds. A check of our own would have to know every structure of the format; a child
that reads the samples too would read them twice.
"""

from __future__ import annotations

import faulthandler
import os
import resource
import signal
import warnings
from typing import Any

from phaselead.errors import BadInput

LIMIT_CPU_S = 20
"""Thousands of times what a walk takes: never too short for a sound file, on a busy machine either."""


def require_walkable(path: str) -> None:
    """Refuse an HDF5 file that the library cannot even walk through. Raises BadInput, one line.

    Other errors of the library are left to whoever reads the file.
    """
    import h5py  # noqa: F401  slow to load, and needed before the fork

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # threads: the child touches nothing but the file
        child = os.fork()
    if child == 0:
        _walk_and_exit(path)
    try:
        _, status = os.waitpid(child, 0)
    except BaseException:  # Ctrl-C
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        raise
    if os.WIFSIGNALED(status):
        ended = os.WTERMSIG(status)
        what = "never comes to an end with it" if ended == signal.SIGXCPU else "crashes on it"
        raise BadInput(
            f"{path}: is a broken HDF5 file (HDF5's library {what}); give a whole copy, or recover it from its journal"
        )


def _walk_and_exit(path: str) -> None:
    """In the child, whose crash is the parent's to tell."""
    try:
        faulthandler.disable()
        _, most = resource.getrlimit(resource.RLIMIT_CPU)
        limit_s = LIMIT_CPU_S if most == resource.RLIM_INFINITY else min(LIMIT_CPU_S, most)
        resource.setrlimit(resource.RLIMIT_CPU, (limit_s, most))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        signal.signal(signal.SIGXCPU, signal.SIG_DFL)
        _walk(path)
    except BaseException:  # the reader will meet it too, and has the words for it
        pass
    finally:
        os._exit(0)


def _walk(path: str) -> None:
    import h5py

    def visit(name: str, item: Any) -> None:
        list(item.attrs.items())
        if isinstance(item, h5py.Dataset) and item.chunks:
            item.id.get_num_chunks()

    with h5py.File(path, "r", locking=False) as file:
        list(file.attrs.items())
        file.visititems(visit)
