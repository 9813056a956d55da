"""Whole files or none: what is written appears under its name only once it is complete."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from phaselead.errors import BadInput

RUN_SUFFIXES = (".h5", ".hdf5")
EXISTS = "exists already; choose another name, or write over it with --overwrite (in Python overwrite=True)"


def is_special(path: str | os.PathLike[str]) -> bool:
    """Whether this is a pipe, a terminal or the like. Asked of the path as given: the link /dev/stdout leads to a
    pipe that has no name of its own."""
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def check_output(
    path: str | os.PathLike[str] | None,
    *,
    suffixes: Sequence[str] = (),
    inputs: Sequence[str | os.PathLike[str]] = (),
    overwrite: bool = True,
) -> None:
    """Refuses, before any work is done, an output that could not be written in the end or must not be.

    ``suffixes`` are those of the format that is written (none: any); ``inputs`` files that are read for it. None and
    "-" are no files and always good.

    Raises:
        BadInput: another suffix, one of the inputs, a directory, a folder that is missing or cannot be written to, or
            a file that exists though ``overwrite`` is False.
    """
    if path is None or path == "-" or is_special(path):
        return
    target = Path(path)
    if suffixes and target.suffix.lower() not in suffixes:
        wanted = " or ".join((", ".join(suffixes[:-1]), suffixes[-1]) if len(suffixes) > 1 else suffixes)
        raise BadInput(f"{path}: the name of this output must end in {wanted}")
    if "\0" in os.fspath(path):
        raise BadInput(f"{os.fspath(path)!r}: is no file name; give a writable place")
    if target.is_dir():
        raise BadInput(f"{path}: is a directory; give a file name")
    if any(_same_file(target, other) for other in inputs):
        raise BadInput(f"{path}: is one of the inputs and would be written over; choose another name")
    folder = Path(os.path.realpath(path)).parent
    if not folder.is_dir():
        raise BadInput(f"{path}: there is no folder {folder}; make it first")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise BadInput(f"{path}: the folder {folder} cannot be written to; give a writable place")
    if target.exists() and not overwrite:
        raise BadInput(f"{path}: {EXISTS}")


def _same_file(path: Path, other: str | os.PathLike[str]) -> bool:
    try:
        return os.path.samefile(path, other)
    except (OSError, ValueError):  # one of them does not exist
        return False


@contextmanager
def atomic_path(path: str | os.PathLike[str], *, overwrite: bool = True) -> Iterator[Path]:
    """A path beside ``path`` to write to; renamed to ``path`` on success, removed on any failure.

    Raises BadInput when ``path`` exists and ``overwrite`` is False, or when it cannot be written.
    """
    if is_special(path):  # nothing to rename
        yield Path(path)
        return
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise BadInput(f"{path}: is a directory; give a file name")
    if target.exists() and not overwrite:
        raise BadInput(f"{path}: {EXISTS}")
    temporary = target.with_name(f".{target.name[:80]}.{os.getpid()}.{os.urandom(4).hex()}.part")
    try:
        # Created here, so that a missing or read-only directory is told before any work is done.
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    except OSError as error:
        raise BadInput(f"{path}: cannot be written ({error.strerror}); give a writable place") from None
    try:
        yield temporary
        with open(temporary, "rb") as written:
            os.fsync(written.fileno())
        os.replace(temporary, target)
    except OSError as error:
        raise BadInput(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        with suppress(FileNotFoundError):
            temporary.unlink()


def write_text(path: str | os.PathLike[str], text: str, *, overwrite: bool = True) -> None:
    """Write ``text`` as UTF-8, whole or not at all."""
    with atomic_path(path, overwrite=overwrite) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def write_texts(texts: Mapping[str, str], *, overwrite: bool = True) -> None:
    """Write several texts as UTF-8: all of them or none, as far as a file system can promise it."""
    with ExitStack() as stack:
        for path, text in texts.items():
            temporary = stack.enter_context(atomic_path(path, overwrite=overwrite))
            try:
                temporary.write_text(text, encoding="utf-8", newline="\n")
            except OSError as error:  # here, for the files around this one would take it for theirs
                raise BadInput(f"{path}: cannot be written ({error.strerror or error})") from error
