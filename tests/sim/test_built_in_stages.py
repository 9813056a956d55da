"""Every built-in stage: at rest at zero, its travel fits its sensor, and `identify` gets its data sheet."""

from pathlib import Path

import numpy as np
import pytest

from phaselead.device.device import Device
from phaselead.identify.experiment import identify_device, is_assumed, plan_grid
from phaselead.model.sensor_lag import sensor_lag_s
from phaselead.sim import plant
from phaselead.sim.device import Plant
from phaselead.sim.plant import built_in, data_sheet, plant_parameters

NAMES = sorted(path.stem for path in Path(plant.__file__).parent.glob("*.toml"))


def settled(stage, level_V):
    """True positions of x, y, z after 2 s at a voltage."""
    virtual = Plant(plant_parameters(stage))
    virtual.trace(1)
    virtual.run(np.full((10_000, 3), round(32768 + 3200 * level_V), dtype=np.uint16))
    return virtual.take_trace()[1][-1]


def test_these_are_the_built_in_stages():
    assert NAMES == ["x100", "x500", "xy30", "xyz250", "xyz250-hard"]


@pytest.mark.parametrize("name", NAMES)
def test_it_rests_at_zero_and_its_travel_fits_its_sensor(name):
    stage = built_in(name)
    assert stage.name == name
    assert settled(stage, 0.0) == pytest.approx(np.zeros(3), abs=1e-3)
    highest = settled(stage, 10.0)
    for axis, model in stage.axes.items():
        span_um = model.sensor.x_max_um - model.sensor.x_min_um
        assert 0.85 * span_um < highest["xyz".index(axis)] < model.sensor.x_max_um
        assert sensor_lag_s(model) == pytest.approx(1 / (2 * np.pi * model.sensor.bandwidth_Hz))


def test_the_hard_one_is_xyz250_with_more():
    plain, hard = built_in("xyz250"), built_in("xyz250-hard")
    assert hard.cross_coupling == plain.cross_coupling
    for axis, model in plain.axes.items():
        assert hard.axes[axis].time == model.time
        assert hard.axes[axis].sensor == model.sensor
        assert {e.name for e in hard.axes[axis].effects} > {e.name for e in model.effects}


@pytest.mark.parametrize("name", NAMES)
def test_a_data_sheet_has_nothing_that_is_to_be_found_out(name):
    sheet = data_sheet(f"sim://{name}?seed=3")
    assert data_sheet(f"faulty://sim://{name}?seed=3#lose=0.01") == sheet
    assert data_sheet(f"qemu://nucleo_f446re?seed=3&stage={name}") == sheet
    for axis, model in sheet.axes.items():
        assert model.time is model.table is model.gains is None
        assert model.effects == ()
        assert model.sensor == built_in(name).axes[axis].sensor
    assert data_sheet("qemu://nucleo_f446re") == data_sheet("sim://xyz250")
    assert is_assumed(sheet) == (name == "xyz250")


@pytest.mark.parametrize(
    "url", ["/dev/ttyACM0", "sim:///tmp/stage.toml", "sim://stage.toml", "qemu://generic_f405?stage=a.toml"]
)
def test_other_ports_have_none(url):
    assert data_sheet(url) is None


def test_identify_knows_the_sensor_of_a_built_in_stage():
    plan = plan_grid(levels_V=(1.0, 2.0, 4.0), f_Hz=(5.0, 10.0, 20.0), held_out=((3.0, 15.0),), rest_s=0.1)
    with Device.open("sim://x100") as device:
        found = identify_device(device, ("x",), plan=plan, creep=False)
    assert found.stage.name == "identified"
    assert found.stage.axes["x"].sensor == built_in("x100").axes["x"].sensor
    assert 15 < found.held_out[0].axes["x"].x_um.max() < 25
