"""A path, and how it is learned in the tests."""

from one_mode_model import AXIS, STAGE

from phaselead.control.gains import design_gains
from phaselead.control.learning.trials import learn
from phaselead.device.device import Device
from phaselead.waveforms.catalogue import parse_wave

GAINS = {"x": design_gains("x", AXIS)}
SINE = parse_wave("sine:30um@20Hz")


def learned_with(unlike_model, folder, trials=4, **options):
    path = folder / "stage.toml"
    unlike_model.save(path, overwrite=True)
    with Device.open(f"sim://{path}") as device:
        return learn(device, {"x": SINE}, stage=STAGE, gains=GAINS, trials=trials, turn_down=True, **options)
