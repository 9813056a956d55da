"""The axis law: composed of its blocks as written, in every mode and drive, and behaving as a loop should."""

import ctypes as ct
import math

import numpy as np
import pytest
from compensations import any_compensation, any_filter, memory_of
from core_bindings import (
    INT32_MAX,
    AxisConfig,
    AxisState,
    AxisTarget,
    AxisTrace,
    Command,
    Compensation,
    CompensationState,
    ConverterConfig,
    Decoupling,
    FeedforwardModel,
    FeedforwardTables,
    Kind,
    LoopFilterConfig,
    LoopFilterState,
    Mode,
    OutputConfig,
    PathConfig,
    PathState,
    PidConfig,
    PidState,
    Point,
    WatchConfig,
    WatchState,
    WatchTick,
    any_i32,
    any_u64,
    real,
    saturate,
    whole,
    wrap_turn64,
)
from hypothesis import given
from hypothesis import strategies as st
from test_feedforward import model_of

V, UM = 2**24, 2**16
code = st.one_of(whole(0, 65535), st.sampled_from([0, 65535]))
any_tick = st.tuples(code, st.sampled_from(Command))
DRIVES = (Command.HOLD, Command.PATH, Command.RAMP)
CONVERTER = ConverterConfig(32768, 3200 * 65536, 2341 << 8, 280 * 65536)
OUTPUT = OutputConfig(-2 * V, 10 * V, round(0.2 * V))
PAPER_GAINS = PidConfig(round(0.017 * V), round(8.62 / 5000 * 2**32), round(2.33e-5 * 5000 * V), INT32_MAX)


@pytest.fixture(scope="module")
def tables(core):
    tables = FeedforwardTables()
    assert core.feedforward_expand(model_of(), tables) == 0
    return tables


@pytest.fixture(scope="module")
def wave():
    return (np.abs(np.arange(1024) - 512) * (2**30 // 512)).astype(np.int32)


any_gains = st.builds(PidConfig, any_i32, any_i32, any_i32, st.one_of(st.just(INT32_MAX), whole(0, INT32_MAX)))
small = whole(-(2**26), 2**26)
sane_gains = st.builds(PidConfig, small, small, small, st.just(INT32_MAX))
any_path = st.builds(PathConfig, st.sampled_from(Kind), any_i32, any_i32, st.just(0), any_u64, st.integers(0, 20))
sane_path = st.builds(
    PathConfig,
    st.sampled_from(Kind),
    whole(-200 * UM, 200 * UM),
    whole(0, 50 * UM),
    st.just(0),
    whole(0, 2**58),
    st.integers(0, 20),
)


@st.composite
def configs(draw, modes=tuple(Mode)):
    low, high = sorted((draw(any_i32), draw(any_i32)))
    config = AxisConfig(
        draw(st.sampled_from(modes)),
        draw(any_i32),
        draw(whole(0, INT32_MAX)),
        0,
        draw(st.one_of(any_gains, sane_gains)),
        draw(st.one_of(any_path, sane_path)),
        Point(draw(any_i32), draw(any_i32)),
        draw(st.sampled_from([OUTPUT, OutputConfig(low, high, draw(whole(0, INT32_MAX)))])),
        draw(st.sampled_from([CONVERTER, ConverterConfig(draw(any_i32), draw(any_i32), draw(any_i32), draw(any_i32))])),
    )
    config.filter = draw(any_filter)
    return config


INVERSE = (Mode.INVERSE, Mode.INVERSE_PID)
TABLE = (Mode.FF, Mode.FF_PID)
CLOSED = (Mode.PID, Mode.FF_PID, Mode.INVERSE_PID)


def composed_step(core, config, tables, wave, compensation, state, adc_code):
    """The law in words: its blocks, which have their own proofs, in order. Returns the trace as a tuple."""
    flags = []

    def block(name, *arguments):
        result, flag = core.flagged(name, *arguments)
        flags.append(flag)
        return result

    def limited(value):
        result, flag = saturate(value)
        flags.append(flag)
        return result

    periodic = config.path.kind in (Kind.SINE, Kind.WAVE)
    runs = config.mode in (Mode.OPEN, Mode.PID) or (config.mode in TABLE and (periodic or tables is not None))
    follows = state.drive == Command.PATH and (runs or (config.mode in INVERSE and compensation is not None))
    if state.drive == Command.PATH:
        state.target.reference = block("path_now", config.path, state.path, wave)
    reference = state.target.reference
    ff = fb = error = 0
    slewed = False
    asked = state.u_q24
    if follows and config.mode in INVERSE:
        lead = config.point.lead_turn32, compensation.preview_ticks_q16
        ahead = block("path_ahead", config.path, state.path, wave, *lead)
        state.target.ahead_q16 = limited(ahead - compensation.rest_q16)
        ahead = limited(state.target.ahead_q16 + compensation.rest_q16)
        beyond = flags[-1]
    if follows and config.mode in CLOSED:
        error = limited(reference - block("converter_position_q16", config.converter, adc_code))
    if follows:
        if config.mode == Mode.OPEN:
            ff = reference
        elif config.mode in TABLE and periodic:
            ahead = block("path_ahead", config.path, state.path, wave, config.point.lead_turn32, 0)
            ff = block("feedforward_step_q24", config.point, ahead)
        elif config.mode in TABLE:
            ff = core.feedforward_static_q24(tables, reference)
        elif config.mode in INVERSE:
            before_q24 = state.compensation.inverse.v_q24
            ff = block("compensation_step_q24", compensation, state.compensation, ahead, config.output.slew_q24)
            way_q24 = abs(state.compensation.inverse.v_q24 - before_q24)
            slewed = (beyond or flags[-1]) and way_q24 >= config.output.slew_q24
        if config.mode in CLOSED:
            if not state.pid.primed:
                core.pid_preset(config.pid, state.pid, error, state.u_q24, ff)
            fb = block("pid_step_q24", config.pid, state.pid, error)
            fb = block("loop_filter_step_q24", config.filter, state.filter, fb)
        asked = ff + fb
    else:
        flags.clear()  # nothing came of it
    if state.drive == Command.PATH:
        state.target.feedforward_q24 = ff
    if state.drive == Command.RAMP:
        asked += max(-config.ramp_q24, min(config.ramp_q24, config.u_park_q24 - state.u_q24))
    before = len(flags)
    state.u_q24 = block("output_limit_q24", config.output, state.u_q24, limited(asked))
    cut = follows and (any(flags[before:]) or slewed)
    done = False
    if follows:
        core.pid_unwind(state.pid, state.u_q24 - asked)
        done = core.path_advance(config.path, state.path)
    if compensation is not None and not (follows and config.mode in INVERSE):
        core.compensation_follow(compensation, state.compensation, state.u_q24)
    dac = block("converter_dac_code", config.converter, state.u_q24)
    state.saturations += any(flags)
    return reference, ff, fb, dac, done, follows and config.mode in INVERSE, cut


@pytest.mark.parametrize("mode", Mode, ids=lambda mode: mode.name)
@given(data=st.data(), ticks=st.lists(st.tuples(code, st.sampled_from(Command)), max_size=20), with_model=st.booleans())
def test_axis_is_its_blocks(core, tables, wave, mode, data, ticks, with_model):
    """Bit for bit, states included, for any configuration, and at most one saturation is counted per tick."""
    config = data.draw(configs((mode,)))
    ticks = [(30000, Command.START), (31000, Command.NOTHING), *ticks]
    state, expected = AxisState(), AxisState()
    used, compensation = (tables, data.draw(any_compensation)) if with_model else (None, None)
    if compensation is not None:
        state.compensation, expected.compensation = (memory_of(core, compensation) for _ in range(2))
    for adc_code, command in ticks:
        (trace,) = core.run(config, state, [(adc_code, command)], tables=used, wave=wave, compensation=compensation)
        if command in DRIVES:
            expected.drive = command
        elif command == Command.START:
            core.axis_start(expected)
        wanted = composed_step(core, config, used, wave.ctypes.data, compensation, expected, adc_code)
        assert bytes(state) == bytes(expected)
        assert wanted == tuple(getattr(trace, name) for name, _ in AxisTrace._fields_)


def test_struct_sizes_are_those_of_the_bindings(core):
    structs = [AxisConfig, AxisState, AxisTrace, FeedforwardModel, FeedforwardTables]
    structs += [PathConfig, PathState, PidState, Compensation, CompensationState, Decoupling, AxisTarget]
    structs += [WatchState, WatchConfig, WatchTick, LoopFilterConfig, LoopFilterState]
    assert [core.h_sizeof(i) for i in range(len(structs))] == [ct.sizeof(s) for s in structs]


def test_start_sets_the_whole_state(core):
    state = AxisState(
        PathState(1, 2, 0, 4), AxisTarget(1, 2, 3, 4), PidState(1, 2, 3, 4, 5), CompensationState(primed=1)
    )
    state.u_q24, state.drive, state.saturations = 777, Command.RAMP, 8
    state.watch.rail_ticks, state.watch.primed, state.filter.primed = 9, 1, 3
    state.compensation.inverse.v_q24 = 5
    core.axis_start(state)
    assert bytes(state.path) == bytes(PathState(0, 0, 1, 0))
    assert bytes(state.pid) == bytes(PidState())
    assert (state.u_q24, state.drive, state.saturations) == (777, Command.PATH, 8)
    assert bytes(state.watch) == bytes(WatchState())
    assert (state.target.flags, state.filter.primed) == (0, 0)
    assert (state.compensation.primed, state.compensation.inverse.v_q24) == (0, 5)


# ---------------------------------------------------------------- drives
@given(configs(), code)
def test_hold_holds_within_the_clamp(core, config, adc_code):
    state = AxisState(u_q24=max(config.output.u_min_q24, min(config.output.u_max_q24, 12345)))
    held = state.u_q24
    core.run(config, state, [(adc_code, Command.HOLD)] * 3)
    assert state.u_q24 == held


@given(whole(-2 * V, 10 * V), whole(-2 * V, 10 * V), whole(V // 100, V // 5))
def test_ramp_parks_in_equal_steps_and_stays(core, start, park, ramp):
    config = AxisConfig(Mode.FF_PID, park, ramp, output=OUTPUT, converter=CONVERTER)
    state = AxisState(u_q24=start, drive=Command.RAMP)
    for _ in range(-(-abs(park - start) // ramp)):
        before = state.u_q24
        core.run(config, state, [(30000, Command.NOTHING)])
        assert state.u_q24 - before == max(-ramp, min(ramp, park - before))
    core.run(config, state, [(30000, Command.NOTHING)] * 3)
    assert state.u_q24 == park
    assert state.saturations == 0


@pytest.mark.parametrize("mode", [Mode.IDLE, Mode.INVERSE, Mode.INVERSE_PID, 7, 2**32 - 1])
def test_modes_it_cannot_run_hold(core, mode):
    config = AxisConfig(mode, output=OUTPUT, converter=CONVERTER)
    config.path = PathConfig(Kind.SINE, 60 * UM, 0, 0, 2**60, 3)
    state = AxisState(u_q24=V)
    traces = core.run(config, state, [(30000, Command.START)] + [(30000, Command.NOTHING)] * 5)
    assert state.u_q24 == V
    assert not any(t.path_done for t in traces)


def test_feedforward_without_tables_holds_on_a_move(core):
    config = AxisConfig(Mode.FF, output=OUTPUT, converter=CONVERTER, path=PathConfig(Kind.HOLD, 0, 50 * UM))
    state = AxisState(u_q24=V)
    core.run(config, state, [(30000, Command.START)] * 3)
    assert state.u_q24 == V


def test_open_is_the_path_in_volts(core):
    path = PathConfig(Kind.SINE, 5 * V, 0, 0, wrap_turn64(5 / 5000), 1000)
    config = AxisConfig(Mode.OPEN, path=path, output=OUTPUT, converter=CONVERTER)
    state = AxisState()
    traces = core.run(config, state, [(0, Command.START)] + [(0, Command.NOTHING)] * 999)
    u_V = np.array([t.feedforward_q24 for t in traces]) / V
    exact = 2.5 * (1 - np.cos(2 * np.pi * 5 / 5000 * np.arange(1000)))
    assert np.abs(u_V - exact).max() < 1e-7
    assert [t.path_done for t in traces] == [False] * 999 + [True]
    assert [t.dac_code for t in traces] == [math.floor(32768 + 3200 * u + 0.5) for u in u_V]


# ---------------------------------------------------------------- closed loop
class Stage:
    """A first-order lag of 0.6 ms behind a gain: tame enough that what is seen is the controller's doing."""

    def __init__(self, gain_um_per_V=20.0, x_um=0.0):
        self.gain, self.x_um = gain_um_per_V, x_um

    def code(self):
        return max(0, min(65535, round(2341 + self.x_um / 280 * 65536)))

    def drive(self, u_q24):
        self.x_um += 0.3 * (self.gain * u_q24 / V - self.x_um)


def close_loop(core, config, state, stage, n, *, tables=None, wave=None):
    """Reference, position and voltage of n ticks."""
    rows = []
    for i in range(n):
        y_um = stage.x_um
        command = Command.START if i == 0 else Command.NOTHING
        (trace,) = core.run(config, state, [(stage.code(), command)], tables=tables, wave=wave)
        stage.drive(state.u_q24)
        rows.append((trace.reference / UM, y_um, state.u_q24 / V))
    return np.array(rows).T


def sine_config(core, tables, mode, range_um=60, f_Hz=5, **path):
    point = Point()
    assert core.feedforward_lookup(tables, range_um * UM, f_Hz * 65536, point)
    path = PathConfig(Kind.SINE, range_um * UM, 0, 0, wrap_turn64(f_Hz / 5000), **path)
    return AxisConfig(mode, pid=PAPER_GAINS, path=path, point=point, output=OUTPUT, converter=CONVERTER)


def test_feedforward_leads_and_scales(core, tables):
    """Eq. 11 with Table I's gain and lead at 60 um and 5 Hz, from the first tick to 1e-4 of the swing."""
    config = sine_config(core, tables, Mode.FF)
    config.output.slew_q24 = INT32_MAX
    _, _, u_V = close_loop(core, config, AxisState(), Stage(), 2000)
    t = np.arange(2000) / 5000
    exact = 2.971856 / 2 * (1 - np.cos(2 * np.pi * 5 * t + np.radians(4.039627)))
    assert np.abs(u_V - exact).max() < 3e-4


def test_feedback_and_feedforward_help(core, tables):
    worst = {}
    for mode in (Mode.PID, Mode.FF_PID):
        r, y, _ = close_loop(core, sine_config(core, tables, mode), AxisState(), Stage(20.19), 5000)
        worst[mode] = np.abs(r - y)[-1000:].max()
    assert worst[Mode.FF_PID] < 0.2 * worst[Mode.PID] < 3


@pytest.mark.parametrize("mode", [Mode.PID, Mode.FF_PID])
@given(u=whole(0, 9 * V), x_um=real(0, 200), reference_um=st.integers(0, 200))
def test_start_is_bumpless(core, tables, mode, u, x_um, reference_um):
    """The first output differs from the last by one tick of integration, within slew and clamp."""
    config = AxisConfig(mode, pid=PAPER_GAINS, output=OUTPUT, converter=CONVERTER)
    config.path = PathConfig(Kind.HOLD, 0, reference_um * UM)
    state = AxisState(u_q24=u)
    core.run(config, state, [(Stage(x_um=x_um).code(), Command.START)], tables=tables)
    one_tick = max(-0.2, min(0.2, 8.62 / 5000 * (reference_um - x_um)))
    assert state.u_q24 / V == pytest.approx(max(-2, min(10, u / V + one_tick)), abs=1e-5)


def test_closed_loop_goes_on_after_the_path(core, tables):
    """The path ends, the value is held, and a push on the stage is still taken out."""
    config = sine_config(core, tables, Mode.FF_PID, range_um=60, f_Hz=5, ticks=1500)
    state, stage = AxisState(), Stage(20.19)
    close_loop(core, config, state, stage, 1500)
    assert state.path.running == 0
    stage.gain *= 1.1
    traces = []
    for _ in range(3000):
        traces += core.run(config, state, [(stage.code(), Command.NOTHING)])
        stage.drive(state.u_q24)
    assert {t.reference for t in traces} == {60 * UM}
    assert not any(t.path_done for t in traces)
    assert stage.x_um == pytest.approx(60, abs=0.01)


def square_wave():
    """High for half the period, then low."""
    return np.where(np.arange(1024) < 512, 2**30, 0).astype(np.int32)


def step_down_from(core, high_um):
    """Half a second at `high_um`, then 20 um: voltage and integrator at the end of the half second, ticks until within
    1 um of 20 um, and the lowest position afterwards."""
    config = AxisConfig(Mode.PID, pid=PAPER_GAINS, output=OUTPUT, converter=CONVERTER)
    config.path = PathConfig(Kind.WAVE, (high_um - 20) * UM, 20 * UM, 0, wrap_turn64(1 / 5000))
    state, stage, wave = AxisState(), Stage(20.0), square_wave()
    _, _, u_V = close_loop(core, config, state, stage, 2490, wave=wave)
    integral_V = state.pid.integral_q48 / 2**48
    y_um = []
    for _ in range(2000):
        y_um.append(stage.x_um)
        core.run(config, state, [(stage.code(), Command.NOTHING)], wave=wave)
        stage.drive(state.u_q24)
    settled = np.nonzero(np.abs(np.array(y_um) - 20) > 1)[0].max()
    return u_V[-1], integral_V, settled, min(y_um)


def test_windup_does_not_delay_the_return(core):
    """Beyond what 10 V can reach, the integrator stays within the clamp and the way back is that from a reachable place
    but for the longer slew. Without unwinding it would stand at the 128 V it may hold."""
    _, _, plain_ticks, plain_least = step_down_from(core, 190)
    u_V, integral_V, ticks, least_um = step_down_from(core, 250)
    assert u_V == 10
    assert 0 < integral_V < 10
    assert ticks <= plain_ticks + 10
    assert least_um > plain_least - 0.1 > 19.8


def test_integral_is_bounded_by_what_the_output_can_be(core):
    """Ten seconds against a wall: the integrator stops where the clamp does."""
    config = AxisConfig(Mode.PID, pid=PAPER_GAINS, output=OUTPUT, converter=CONVERTER)
    config.path = PathConfig(Kind.HOLD, 0, 250 * UM)
    state = AxisState()
    core.run(config, state, [(2341, Command.START)] + [(2341, Command.NOTHING)] * 49999)
    assert state.u_q24 == 10 * V
    assert 0 < state.pid.integral_q48 <= 10 * 2**48


@given(configs(), st.lists(any_tick, min_size=1, max_size=40))
def test_output_never_leaves_the_clamp(core, tables, wave, config, ticks):
    state = AxisState()
    core.run(config, state, ticks, tables=tables, wave=wave)
    assert config.output.u_min_q24 <= state.u_q24 <= config.output.u_max_q24


@given(configs(), st.lists(any_tick, min_size=1, max_size=40))
def test_output_never_moves_faster_than_the_slew_limit(core, tables, wave, config, ticks):
    """Once inside the clamp, whatever the path, the gains and the supervisor do."""
    state = AxisState(u_q24=config.output.u_min_q24)
    for tick in ticks:
        before = state.u_q24
        core.run(config, state, [tick], tables=tables, wave=wave)
        assert abs(state.u_q24 - before) <= config.output.slew_q24
