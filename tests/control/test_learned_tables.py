"""A table of what was learned is for one path, mode, model and position only."""

from dataclasses import replace

import numpy as np
import pytest
from learned_paths import GAINS, SINE
from one_mode_model import STAGE

from phaselead.control.learning.learned import Learned, LearnedPath, Trial, load_learned, one_period
from phaselead.errors import BadInput
from phaselead.model.axis import Gains
from phaselead.waveforms.catalogue import parse_wave

TABLE = Learned(
    STAGE.sha256, "inverse+pid", "true",
    {"x": LearnedPath(SINE.f_Hz, one_period(SINE), one_period(SINE) + 0.01, 0.0, 1.0, GAINS["x"])},
    (Trial(0, True, {"x": 0}, {"x": 0}, {"x": 1.0}, {"x": 0.5}),), "as asked",
)  # fmt: skip
OTHER_GAINS = {"x": Gains(kp_V_per_um=0.0, ki_V_per_um_s=1.0, kd_V_s_per_um=0.0)}


@pytest.mark.parametrize(
    ("wave", "stage", "mode", "gains", "said"),
    [
        ("sine:30.001um@20Hz", STAGE, "inverse+pid", GAINS, "another path .30 um at 20 Hz"),
        ("sine:30um@20.001Hz", STAGE, "inverse+pid", GAINS, "another path"),
        ("triangle:30um@20Hz", STAGE, "inverse+pid", GAINS, "another path"),
        ("goto:30um", STAGE, "inverse+pid", GAINS, "another path"),
        ("sine:30um@20Hz", STAGE.model_copy(update={"name": "other"}), "inverse+pid", GAINS, "another model"),
        ("sine:30um@20Hz", None, "inverse+pid", GAINS, "needs the model"),
        ("sine:30um@20Hz", STAGE, "inverse", {}, "for mode inverse.pid"),
        ("sine:30um@20Hz", STAGE, "inverse+pid", OTHER_GAINS, "for the gains"),
    ],
)
def test_a_table_is_refused_for_what_it_is_not(wave, stage, mode, gains, said):
    with pytest.raises(BadInput, match=said) as caught:
        TABLE.waveforms({"x": parse_wave(wave)}, stage and stage.sha256, mode, gains)
    assert "\n" not in str(caught.value)


def test_a_table_is_refused_for_the_other_position():
    """It was played as if it had been learned for that."""
    as_learned = TABLE.waveforms({"x": SINE}, STAGE.sha256, "inverse+pid", GAINS, "true")
    assert set(as_learned) == {"x"}
    with pytest.raises(BadInput, match="for the true position, not the measured one"):
        TABLE.waveforms({"x": SINE}, STAGE.sha256, "inverse+pid", GAINS, "measured")


def test_a_table_is_refused_for_other_axes():
    with pytest.raises(BadInput, match="is for x, the path for xy"):
        TABLE.waveforms({"x": SINE, "y": SINE}, STAGE.sha256, "inverse+pid", GAINS)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is no HDF5 file"),
        (b"not HDF5", "is no HDF5 file"),
        (None, "cannot be read (No such file or directory)"),
        ("folder", "cannot be read (Is a directory)"),
    ],
)
def test_another_file_is_refused(content, said, tmp_path):
    """Without the words of h5py about its own calls."""
    path = tmp_path / "learned.h5"
    if content == "folder":
        path.mkdir()
    elif content is not None:
        path.write_bytes(content)
    with pytest.raises(BadInput) as refusal:
        load_learned(path)
    assert str(refusal.value) == f"{path}: {said}; give a table that phaselead learn wrote"


def test_a_damaged_table_is_refused(tmp_path):
    import h5py

    TABLE.save(tmp_path / "learned.h5", overwrite=True)
    with h5py.File(tmp_path / "learned.h5", "r+") as file:
        file["x"].attrs["f_Hz"] = np.nan
    with pytest.raises(BadInput, match="no table of this version"):
        load_learned(tmp_path / "learned.h5")


def test_a_table_without_gain_or_from_before_says_so():
    first, *_ = TABLE.trials
    shown = {
        judged: str(replace(TABLE, trials=(replace(first, judged_pct=judged, number=0),))) for judged in (0.1, None)
    }
    assert "no trial was better than the first" in shown[0.1]
    assert "trial was better" not in shown[None]
