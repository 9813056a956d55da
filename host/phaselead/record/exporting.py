"""Writing recordings: CSV, and the export to what other programs read.

pyarrow and scipy are imported where they are used: they are slow to load, and most commands write no such file.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from phaselead.errors import BadInput
from phaselead.record.atomic import atomic_path
from phaselead.record.columns import UNITS, columns_of
from phaselead.record.hdf5 import write_hdf5
from phaselead.record.recording import Recording

if TYPE_CHECKING:
    import pyarrow

SUFFIXES = (".csv", ".h5", ".hdf5", ".mat", ".parquet")


def write_csv(path: str | os.PathLike[str], recording: Recording, *, overwrite: bool = True) -> None:
    """Write ``t_s,u_V,x_um[,r_um][,trigger]`` (or the three-axis form), whole or not at all; floats keep every bit."""
    from pyarrow import csv

    table = _table(recording)
    options = csv.WriteOptions(include_header=False)
    with atomic_path(path, overwrite=overwrite) as temporary, open(temporary, "wb") as file:
        file.write((",".join(table.column_names) + "\n").encode())
        csv.write_csv(table, file, options)


def write_mat(path: str | os.PathLike[str], recording: Recording, *, overwrite: bool = True) -> None:
    """Write a MATLAB 5 file: one column vector per column of the recording."""
    import scipy.io

    columns = columns_of(recording.t_s, recording.axes) | _trigger_of(recording)
    vectors = {name: values[:, np.newaxis] for name, values in columns.items()}
    with atomic_path(path, overwrite=overwrite) as temporary, open(temporary, "wb") as file:
        scipy.io.savemat(file, vectors, do_compression=True)


def write_parquet(path: str | os.PathLike[str], recording: Recording, *, overwrite: bool = True) -> None:
    """Write an Apache Parquet file; the units are in the fields' metadata."""
    from pyarrow import parquet

    with atomic_path(path, overwrite=overwrite) as temporary:
        parquet.write_table(_table(recording), temporary)


def _table(recording: Recording) -> pyarrow.Table:
    import pyarrow

    columns = columns_of(recording.t_s, recording.axes)
    fields = [pyarrow.field(name, pyarrow.float64(), metadata={"units": UNITS[name]}) for name in columns]
    trigger = _trigger_of(recording)
    fields += [pyarrow.field(name, pyarrow.uint8(), metadata={"units": "bits"}) for name in trigger]
    return pyarrow.table([*columns.values(), *trigger.values()], schema=pyarrow.schema(fields))


def _trigger_of(recording: Recording) -> dict[str, NDArray[np.uint8]]:
    """The column of the device's triggers, last; none where they were not recorded."""
    return {} if recording.trigger is None else {"trigger": recording.trigger}


def export(recording: Recording, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Write ``recording`` in the format its suffix names: .csv, .h5, .mat or .parquet.

    Raises BadInput for another suffix, and for a file that exists unless ``overwrite``.
    """
    suffix = Path(path).suffix.lower()
    if suffix == ".csv":
        write_csv(path, recording, overwrite=overwrite)
    elif suffix in (".h5", ".hdf5"):
        write_hdf5(path, recording, overwrite=overwrite)
    elif suffix == ".mat":
        write_mat(path, recording, overwrite=overwrite)
    elif suffix == ".parquet":
        write_parquet(path, recording, overwrite=overwrite)
    else:
        raise BadInput(f"{path}: its suffix names no format; use .csv, .h5, .mat or .parquet")
