"""Recordings: read, make, export, recover."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

    from phaselead.record import Imported, MapLike, Recording, Recordings, RecordLike, RecordsLike
    from phaselead.report import Shown


def read(records: RecordsLike, *, map: MapLike | None = None, rate: str | float | None = None) -> Recordings:
    """Reads recordings, CSV or HDF5, any uniform sampling rate. Gives a list, also of a single file.

    ``records`` is a file's name, a pattern ("kept/\\*.h5"), or a list of these. A name may carry a window in absolute
    seconds, half-open: "rec.csv@5:7"; rows before it warm the model's memory and are not scored. For files without our
    header ``map`` gives the columns, counted from 1 ("u_V=1,x_um=3*1e6" or ``{"u_V": 1, "x_um": (3, 1e6)}``), and
    ``rate`` stands in for times ("200Hz", or a number in Hz).

    Raises BadInput, one line with the file and the row, for what cannot be used.

    >>> import phaselead as pl
    >>> rows = [f"{i / 1000},{i / 100:.3f},{i / 10:.3f}" for i in range(100)]
    >>> with open("rig.csv", "w") as file:
    ...     _ = file.write("\\n".join(["t_s,u_V,x_um", *rows]))
    >>> records = pl.read("rig.csv")
    >>> len(records), records[0].rate_Hz
    (1, 1000.0)
    >>> pl.read("r*.csv@0.02:0.05")[0].scored
    slice(20, 50, None)
    """
    from phaselead.record import gather

    return gather(records, map, rate)


def recording(*, source: str = "arrays", **columns: ArrayLike) -> Recording:
    """A recording made of arrays, shape (n,) each, named like the columns of a CSV file.

    One axis: ``t_s``, ``u_V``, ``x_um``, ``r_um``; several: ``t_s``, ``ux_V``, ``uy_V``, ``x_um``, ``y_um`` ... Times
    in s, uniform within 1 %; voltages in V, positions in um. ``source`` is its name in tables and messages. Raises
    BadInput for another name, shapes that differ, and values or times that cannot be used.

    >>> import numpy as np
    >>> import phaselead as pl
    >>> t_s = np.arange(1000) / 500
    >>> u_V = 2.5 - 2.5 * np.cos(2 * np.pi * 5 * t_s)
    >>> made = pl.recording(t_s=t_s, u_V=u_V, x_um=20 * u_V, source="made")
    >>> made
    <Recording made: 1000 samples, axes x>
    """
    from phaselead.record import from_columns

    return from_columns(columns, source)


def import_recordings(
    files: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    *,
    map: str | None = None,
    rate: str | float | None = None,
    flip: bool = False,
) -> Imported:
    """Recordings from files of other programs: text of any delimiter and decimal sign, .npy, .npz, .mat, HDF5.

    Columns are guessed from labels, units and numbers; the result prints a preview with every assumption, and has the
    ``recordings``. ``map`` names them instead, by label or number: "u_V=drive,x_um=sensor*1e6". Several files stand
    side by side (voltages in one, positions in another). ``rate`` stands in for times ("200Hz", or a number in Hz),
    ``flip`` turns the sign of positions. Raises BadInput where no recording can be made.

    >>> import numpy as np
    >>> import phaselead as pl
    >>> u_V = 2.5 - 2.5 * np.cos(np.arange(400) / 20)
    >>> np.save("rig.npy", np.column_stack([u_V, 2e-5 * u_V + 1e-6 * np.sin(np.arange(400) ** 2)]))
    >>> found = pl.import_recordings("rig.npy", rate="200Hz")
    >>> print(found.mapped[1].name, found.mapped[1].scale, found.mapped[1].why)
    x_um 1000000.0 it moves, and is rougher than the voltage; so small that it must be in metres
    """
    from phaselead.record import import_files, parse_rate

    paths = [files] if isinstance(files, str | os.PathLike) else files
    rate_Hz = parse_rate(rate) if isinstance(rate, str) else rate
    return import_files([os.fspath(path) for path in paths], map, rate_Hz, flip=flip)


def plot(records: RecordsLike, *, of: Shown = "position") -> Figure:
    """Runs and recordings in one figure: their "position", "error" or "spectrum" (of the error, else of the position).

    Long records are drawn by the extremes of each stretch, so that a spike of one sample shows. Raises BadInput where
    none has what is asked for.

    >>> import phaselead as pl
    >>> with pl.connect() as dev:
    ...     runs = [dev.track("sine:20um@5Hz", mode="pid", gains=gains, duration=0.4) for gains in ("paper", (0, 2, 0))]
    >>> pl.plot(runs, of="error").savefig("error.png")
    """
    from phaselead.record import gather
    from phaselead.report import runs_figure

    return runs_figure(gather(records), of)


def export(
    record: RecordLike,
    path: str | os.PathLike[str],
    *,
    map: MapLike | None = None,
    rate: str | float | None = None,
    overwrite: bool = False,
) -> None:
    """Writes a recording as the suffix says: .csv, .h5, .mat or .parquet. ``record``: a recording, a run or a file;
    ``map`` and ``rate`` as for ``read``. Of a file with a window, ``"rec.csv@5:7"``, its rows are written alone.

    Raises BadInput for another suffix, for several recordings, and where the file exists and ``overwrite`` is False.

    >>> import phaselead as pl
    >>> with pl.connect() as dev:
    ...     pl.export(dev.record("sine:5V@5Hz", duration=0.4), "open.csv")
    >>> with open("open.csv") as file:
    ...     print(file.readline())
    t_s,u_V,x_um
    <BLANKLINE>
    """
    from phaselead.record import export as export_recording
    from phaselead.record import gather_one, scored_alone

    recording = gather_one(record, map, rate)
    if isinstance(record, (str, os.PathLike)):
        recording = scored_alone(recording)
    export_recording(recording, path, overwrite=overwrite)


def recover(journal: str | os.PathLike[str], output: str | os.PathLike[str], *, overwrite: bool = False) -> Recording:
    """Finishes a run whose program was killed: turns its journal into a recording, written to ``output`` (.h5).

    Its ``meta`` says what was lost: ``torn_bytes`` at the journal's end, ``damaged_frames`` within. The journal is
    removed once the recording is written. Raises BadInput for a file that is no journal, of another version, or
    without samples, and for an output that exists unless ``overwrite``.

    >>> import phaselead as pl
    >>> pl.recover("run.h5.journal", "run.h5")
    Traceback (most recent call last):
    phaselead.errors.BadInput: run.h5.journal: cannot be read (No such file or directory); give a journal
    """
    from phaselead.control import recover_run
    from phaselead.record import RUN_SUFFIXES, check_output, gather_one

    check_output(output, suffixes=RUN_SUFFIXES, inputs=[journal], overwrite=overwrite)
    facts = recover_run(os.fspath(journal), os.fspath(output))
    found = gather_one(output)
    return replace(found, meta=found.meta | {name: facts[name] for name in ("torn_bytes", "damaged_frames")})
