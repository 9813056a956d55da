"""The model transaction: whole and valid, or not at all."""

from dataclasses import fields, replace
from zlib import crc32

import pytest
from device_bench import AXIS_MODEL, MODEL_CHUNK, PASS, RAMP_CODES, UM, Bench, V, model, step_of
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.device import wire

FIELDS = [field.name for field in fields(wire.AxisModel)]
"""In the order of the schema; the device counts them from 1."""
MAGIC = 1000

BAD_FIELDS = [
    ("flags", 4),
    ("flags", 1 << 23),
    ("u_min_q24", -11 * V),
    ("u_min_q24", 1),
    ("u_max_q24", -2 * V),
    ("u_max_q24", -1),
    ("u_max_q24", 11 * V),
    ("u_park_q24", -3 * V),
    ("u_park_q24", 11 * V),
    ("slew_q24", 0),
    ("slew_q24", -1),
    ("ramp_q24", 0),
    ("ramp_q24", V // 5 + 1),
    ("dac_zero_code", -1),
    ("dac_zero_code", 65536),
    ("dac_codes_per_V_q16", 0),
    ("dac_codes_per_V_q16", -1),
    ("adc_zero_code", -65536),
    ("adc_zero_code", 131_071),
    ("adc_um_per_code_q32", 0),
    ("adc_um_per_code_q32", -1),
    ("swing_min_q24", 0),
    ("swing_min_q24", -V),
    ("swing_max_q24", V // 2),
    ("f_min_q16", 0),
    ("f_max_q16", 1 << 16),
    ("f_max_q16", 2501 << 16),
    ("a_q32", (0, 0, 0)),
    ("a_q32", (2**62, 2**62, 2**62)),
    ("a_q32", (AXIS_MODEL.a_q32[0], AXIS_MODEL.a_q32[1], -2 * AXIS_MODEL.a_q32[1])),
    ("b_q40", (2**62,) * 6),
    ("c_q32", (0, 0, 0, 0, 0, 2**60)),
    ("preview_ticks_q16", (1024 << 16) + 1),
    ("shape", (*[PASS] * 5, wire.Biquad(0, 0, 0, 0, 0))),
    ("shape", (wire.Biquad(1 << 26, 0, 0, 0, 1), *[PASS] * 5)),
    ("drive", (wire.Biquad(2 << 26, 0, 0, 1 << 26, 0),)),
    ("creep_k_q30", (1 << 29, 1, 0, 0, 0, 0, 0, 0)),
    ("creep_alpha_q48", (-1, 0, 0, 0, 0, 0, 0, 0)),
    ("creep_alpha_q48", (0, 0, 0, 0, 0, 0, 0, (1 << 48) + 1)),
    ("gain_q20", 1 << 30),
    ("offset_q16", (1 << 30) + 1),
    ("offset_q16", -(1 << 30) - 1),
    ("rest_fraction_q30", (1 << 30) + 1),
    ("play_r_q24", (V, *[V - 1] * 31)),
    ("play_r_q24", (-1, *[V] * 31)),
    ("play_w_q20", (*[0] * 31, -1)),
    ("knot_d_q24", (V, *[V - 1] * 23)),
    ("knot_s_q20", (-(15 << 20), *[0] * 23)),
    ("coupling_q28", (2 << 28, 0, 0)),
    ("coupling_q28", (1 << 28, -(2 << 28), 1 << 29)),
    ("error_limit_q16", -1),
    ("error_ticks", 0),
    ("oscillation_limit_q16", -1),
]


def test_what_is_uploaded_is_read_back(bench):
    blob = model().pack()
    assert bench.status_of(wire.ModelReadRequest(0, 10)) == wire.Status.NO_MODEL
    assert bench.upload(blob).status == wire.Status.OK
    pieces = [bench.ok(wire.ModelReadRequest(at, 100)) for at in range(0, len(blob), 100)]
    assert b"".join(piece.data for piece in pieces) == blob
    assert {(piece.size, piece.crc) for piece in pieces} == {(len(blob), crc32(blob))}
    assert bench.status().model_crc == crc32(blob)


@pytest.mark.parametrize(("field", "value"), BAD_FIELDS)
@pytest.mark.parametrize("axis", [0, 2])
def test_a_bad_field_is_named_and_the_old_model_stays(bench, axis, field, value):
    old = model(hash_byte=1)
    assert bench.upload(old).status == wire.Status.OK
    axes = list(old.axes)
    axes[axis] = replace(axes[axis], **{field: value})
    reply = bench.upload(replace(old, axes=tuple(axes)))
    assert reply.status == wire.Status.MODEL_INVALID
    assert reply.invalid_field == 100 * axis + FIELDS.index(field) + 1
    assert bench.model() == old.pack()
    assert bench.set_axis(0, wire.Mode.FF) == wire.Status.OK  # its tables too
    assert bench.set_path(0, swing=60 * UM) == wire.Status.OK


def test_every_field_that_can_be_wrong_is_in_the_list():
    assert {field for field, _ in BAD_FIELDS} == set(FIELDS)


@pytest.mark.parametrize("offset", [-(1 << 30), 1 << 30])
def test_an_offset_may_be_16384_um_either_way(bench, offset):
    assert bench.upload(model(offset_q16=offset)).status == wire.Status.OK


@pytest.mark.parametrize("code", [-65_535, 131_070])
def test_the_code_of_0_um_may_be_as_far_outside_the_converter_as_that_is_wide(bench, code):
    assert bench.upload(model(adc_zero_code=code)).status == wire.Status.OK


def test_positions_must_fit_their_format(bench):
    reply = bench.upload(model(adc_zero_code=-65535, adc_um_per_code_q32=2**31 - 1))
    assert reply.invalid_field == FIELDS.index("adc_um_per_code_q32") + 1


def test_a_position_may_be_the_largest_of_its_format(bench):
    """65536 codes of 2^-16 x (2^31 - 1) LSB each, and not one code more."""
    assert bench.upload(model(adc_zero_code=-1, adc_um_per_code_q32=2**31 - 1)).status == wire.Status.OK
    reply = bench.upload(model(adc_zero_code=-2, adc_um_per_code_q32=2**31 - 1))
    assert reply.invalid_field == FIELDS.index("adc_um_per_code_q32") + 1


def test_a_wrong_magic_is_no_model(bench):
    reply = bench.upload(replace(model(), magic=1))
    assert (reply.status, reply.invalid_field) == (wire.Status.MODEL_INVALID, MAGIC)


def test_an_axis_without_a_table_view_runs_but_not_on_tables(bench):
    assert bench.upload(model(flags=0, a_q32=(0, 0, 0))).status == wire.Status.OK
    assert bench.set_axis(0, wire.Mode.FF) == wire.Status.NO_MODEL
    assert bench.set_axis(1, wire.Mode.FF) == wire.Status.OK
    assert bench.set_axis(0, wire.Mode.PID) == wire.Status.OK


def test_an_axis_whose_model_has_no_inverse_runs_but_not_on_it(bench):
    assert bench.set_axis(0, wire.Mode.INVERSE) == wire.Status.NO_MODEL
    assert bench.upload(model(flags=1, gain_q20=0)).status == wire.Status.OK
    for mode in (wire.Mode.INVERSE, wire.Mode.INVERSE_PID):
        assert bench.set_axis(0, mode) == wire.Status.NO_MODEL
        assert bench.set_axis(1, mode) == wire.Status.OK
    assert bench.set_axis(0, wire.Mode.FF) == wire.Status.OK


def test_axes_that_cannot_be_told_apart_are_refused(bench):
    """x and y move together whatever is done: a matrix without an inverse."""
    one = 1 << 28
    reply = bench.upload(
        replace(
            model(),
            axes=tuple(replace(AXIS_MODEL, coupling_q28=row) for row in ((one, one, 0), (one, one, 0), (0, 0, one))),
        )
    )
    assert (reply.status, reply.invalid_field) == (wire.Status.MODEL_INVALID, FIELDS.index("coupling_q28") + 1)


def test_a_damaged_upload_changes_nothing(bench):
    blob = model().pack()
    bench.ok(wire.ModelBeginRequest(len(blob), crc32(blob) ^ 1))
    for at in range(0, len(blob), MODEL_CHUNK):
        bench.ok(wire.ModelChunkRequest(at, blob[at : at + MODEL_CHUNK]))
    assert bench.status_of(wire.ModelCommitRequest()) == wire.Status.CRC_MISMATCH
    assert bench.status_of(wire.ModelCommitRequest()) == wire.Status.WRONG_STATE  # the transaction is over
    assert bench.status().model_crc == 0


def test_chunks_stay_inside_the_blob_and_inside_a_transaction(bench):
    assert bench.status_of(wire.ModelChunkRequest(0, b"1234")) == wire.Status.WRONG_STATE
    end = wire.Model.SIZE
    assert bench.status_of(wire.ModelBeginRequest(end - 1, 0)) == wire.Status.BAD_VALUE
    assert bench.status_of(wire.ModelChunkRequest(0, b"1234")) == wire.Status.WRONG_STATE
    bench.ok(wire.ModelBeginRequest(end, 0))
    for offset, size in ((end, 1), (end - 1, 2), (2**32 - 1, 2), (end - 999, 1000), (0, 0)):
        assert bench.status_of(wire.ModelChunkRequest(offset, bytes(size))) == wire.Status.BAD_VALUE
    bench.ok(wire.ModelChunkRequest(end - 4, b"1234"))


@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_chunks_may_come_in_any_order_and_twice(data):
    bench = Bench()
    blob = model().pack()
    cuts = sorted(data.draw(st.sets(st.integers(1, len(blob) - 1), max_size=6)) | {1000, 2000})
    pieces = [(a, blob[a:b]) for a, b in zip([0, *cuts], [*cuts, len(blob)], strict=True)]
    bench.ok(wire.ModelBeginRequest(len(blob), crc32(blob)))
    for at, piece in data.draw(st.permutations(pieces)) + pieces[:1]:
        bench.ok(wire.ModelChunkRequest(at, piece))
    bench.ok(wire.ModelCommitRequest())
    assert bench.status().model_crc == crc32(blob)


def test_a_model_is_only_changed_while_parked(bench):
    bench.drive()
    for command in (
        wire.ModelBeginRequest(wire.Model.SIZE, 0),
        wire.ModelChunkRequest(0, b"1234"),
        wire.ModelCommitRequest(),
        wire.ModelPersistRequest(),
    ):
        assert bench.status_of(command) == wire.Status.WRONG_STATE


def test_a_new_model_takes_the_old_ones_settings_away(bench):
    bench.set_axis(0, wire.Mode.PID)
    bench.set_path(0, swing=60 * UM)
    bench.upload(model())
    assert bench.status().modes == (0, 0, 0)


def test_limits_of_the_model_hold_at_once(bench):
    bench.upload(model(u_max_q24=3 * V, slew_q24=V // 50))
    assert bench.set_axis() == wire.Status.OK
    assert bench.set_path(swing=3 * V + 1, step=step_of(1)) == wire.Status.OUTSIDE_LIMITS
    assert bench.set_path(swing=3 * V, step=step_of(1250)) == wire.Status.OK
    bench.ok(wire.ArmRequest(0))
    bench.ok(wire.StartRequest(1))
    codes = bench.run(3000)[:, 0].astype(int)
    assert abs(codes[1:] - codes[:-1]).max() <= 64
    assert codes.max() <= 32768 + 9600


def park_at_5V(bench):
    bench.upload(model(u_park_q24=5 * V))
    bench.ok(wire.ArmRequest(0))
    bench.run(1000)
    bench.park()


def test_limits_the_output_lies_outside_of_are_refused(bench):
    """Taking them would make the output jump."""
    park_at_5V(bench)
    tight = model(u_max_q24=4 * V)
    assert bench.upload(tight).status == wire.Status.OUTSIDE_LIMITS
    bench.upload(model())
    bench.ok(wire.ArmRequest(0))
    bench.run(1000)
    bench.park()
    assert bench.upload(tight).status == wire.Status.OK


def test_a_calibration_that_contradicts_the_code_at_power_on_is_refused(bench):
    """-2.048..12 V: the same 0 V would be 7.3 V further down, in one tick."""
    codes_per_V_q16 = round(65536 / 14.048 * 65536)
    reply = bench.upload(model(dac_zero_code=9554, dac_codes_per_V_q16=codes_per_V_q16))
    assert reply.status == wire.Status.MODEL_INVALID
    assert reply.invalid_field == FIELDS.index("dac_zero_code") + 1
    assert (bench.run(10) == 32768).all()
    assert bench.status().model_crc == 0


def test_a_scale_that_moves_a_parked_output_is_refused(bench):
    park_at_5V(bench)
    reply = bench.upload(model(u_park_q24=5 * V, dac_codes_per_V_q16=3000 << 16))
    assert reply.status == wire.Status.MODEL_INVALID
    assert reply.invalid_field == FIELDS.index("dac_codes_per_V_q16") + 1


@settings(max_examples=40, deadline=None)
@given(zero=st.integers(32768 - 100, 32768 + 100), scale=st.integers(3000, 3200), park=st.sampled_from([-V, 0, V]))
def test_an_upload_never_moves_the_output_by_more_than_the_ramp_does(zero, scale, park):
    bench = Bench()
    bench.upload(model(dac_zero_code=zero, dac_codes_per_V_q16=scale << 16, u_park_q24=park))
    codes = bench.run(50)[:, 0].astype(int)
    assert abs(codes - 32768).max() <= RAMP_CODES + 1
    assert (codes == codes[0]).all()
    assert (bench.status().model_crc != 0) == (abs(zero - 32768) <= RAMP_CODES)


def test_arming_may_name_the_model(bench):
    assert bench.status_of(wire.ArmRequest(5)) == wire.Status.NO_MODEL
    bench.upload(model())
    assert bench.status_of(wire.ArmRequest(5)) == wire.Status.MUST_NAME_MODEL
    bench.ok(wire.ArmRequest(crc32(model().pack())))
