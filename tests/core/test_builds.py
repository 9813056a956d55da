"""What must hold for the source as such: no float, no division or loop in the tick, no undefined behaviour,
the same bits from every compiler."""

import hashlib
import re
import subprocess

import numpy as np
import pytest
from core_bindings import (
    AT_COMMIT,
    CORE,
    COUNTED,
    FIRMWARE,
    HARNESS,
    IN_TICK,
    INT32_MAX,
    STRAIGHT,
    AxisConfig,
    Biquad,
    Compensation,
    CompensationState,
    FeedforwardModel,
    Kind,
    compile_core,
)
from test_feedforward import POWERS_OF_TWO, model_of

SOURCES = sorted(CORE.glob("*.[ch]"))
SHIFTING = {"floor_shift_i32", "floor_shift_i64", "static assertion"}
"""Where fixed.h does it, and asserts what C leaves open about it."""
SCENARIOS, TICKS = 400, 300
CORTEX_M4 = ["--target=thumbv7em-none-eabi", "-mcpu=cortex-m4", "-mfloat-abi=soft", "-ffreestanding"]


def code_without_comments(source):
    return re.sub(r"/\*.*?\*/|//[^\n]*", " ", source.read_text(), flags=re.S)


@pytest.mark.parametrize("source", SOURCES, ids=lambda p: p.name)
def test_no_float(source):
    code = code_without_comments(source)
    assert not re.search(r"\b(float|double|math\.h|_Complex)\b|\b\d+\.\d|\b\d+[eE][-+]\d", code)


@pytest.mark.parametrize("source", sorted(CORE.glob("*.c")), ids=lambda p: p.name)
def test_signed_values_are_shifted_right_only_in_fixed_h(compiler, source):
    command = [compiler("clang"), "-std=c11", f"-I{FIRMWARE}", "-fsyntax-only", "-fno-color-diagnostics"]
    command += ["-Xclang", "-ast-dump", str(source)]
    tree = subprocess.run(command, check=True, capture_output=True, text=True)
    function = ""
    for line in tree.stdout.splitlines():
        if top := re.match(r"[|`]-\w+ 0x.*?(?:(\w+) '|$)", line):
            function = "static assertion" if "StaticAssertDecl" in line else top[1] or ""
        if shift := re.search(r"(?:Binary|CompoundAssign)Operator.*?> ('[^']*'(?::'[^']*')?) '>>=?'", line):
            assert "uint" in shift[1] or "unsigned" in shift[1] or function in SHIFTING, f"{function}: {line}"


@pytest.mark.parametrize("source", [*SOURCES, *sorted((FIRMWARE / "app").glob("*.[ch]"))], ids=lambda p: p.name)
def test_no_word_that_only_one_compiler_knows(source):
    """Nothing beyond C11, but for the one builtin that fixed.h asks for and has a plain twin of."""
    found = re.findall(r"__(?!VA_ARGS__)\w+|\b(?:asm|typeof)\b", code_without_comments(source))
    assert set(found) <= {"fixed.h": {"__GNUC__", "__builtin_clz"}}.get(source.name, set())


@pytest.mark.parametrize("compiler_name", ["gcc", "clang"])
def test_the_device_compiles_without_warnings(compiler, compiler_name):
    warnings = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror"]
    command = [compiler(compiler_name), "-std=c11", "-O1", *warnings, f"-I{FIRMWARE}", '-DPHASELEAD_BUILD_ID="0"']
    sources = [str(source) for source in sorted((FIRMWARE / "app").glob("*.c"))]
    done = subprocess.run([*command, "-fsyntax-only", *sources], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("compiler_name", ["gcc", "clang"])
@pytest.mark.parametrize("level", ["-O0", "-O2"])
def test_no_warnings(compiler, compiler_name, level, tmp_path):
    compile_core(tmp_path / "libcore.so", compiler(compiler_name), level, "-shared", "-fPIC")


# ---------------------------------------------------------------- what the tick is made of
@pytest.fixture(scope="module")
def cortex_m4(compiler):
    """Assembly of each source, as clang makes it for the board's core."""
    command = [compiler("clang"), *CORTEX_M4, "-std=c11", "-O2", f"-I{FIRMWARE}", "-S", "-o", "-"]
    return {
        source.stem: subprocess.run([*command, str(source)], check=True, capture_output=True, text=True).stdout
        for source in CORE.glob("*.c")
    }


@pytest.mark.parametrize("name", IN_TICK)
def test_tick_never_divides_nor_calls_the_compilers_library(cortex_m4, name):
    assert not re.search(r"\b[su]div\b|__aeabi_(?!mem)", cortex_m4[name])


def flow(listing):
    """Which basic block leads to which, of all functions of an assembly listing."""
    edges, block = {}, "file"
    leaves = False
    for line in listing.splitlines():
        if label := re.match(r"(\.LBB\w+|\w+):", line):
            if not leaves:
                edges.setdefault(block, set()).add(label[1])
            block, leaves = label[1], False
        elif re.match(r"\s+[a-z]", line) or ".LBB" in line:
            edges.setdefault(block, set()).update(re.findall(r"\.LBB\w+", line))
            leaves = leaves or bool(re.match(r"\s+(b(\.w|\.n)?\s|bx\s+lr|pop(\.w)?\s.*pc|tb[bh]\s)", line))
    return edges


def has_cycle(edges):
    done, path = set(), []

    def visit(block):
        if block in path:
            return True
        if block in done:
            return False
        path.append(block)
        found = any(visit(following) for following in sorted(edges.get(block, ())))
        path.pop()
        done.add(block)
        return found

    return any(visit(block) for block in edges)


@pytest.mark.parametrize("name", STRAIGHT)
def test_tick_has_no_loop(cortex_m4, name):
    """The flow graph has no cycle: whatever the data, an instruction runs at most once per call."""
    assert not has_cycle(flow(cortex_m4[name]))


COUNTED_LOOP = re.compile(r"for \(unsigned (\w+) = 0; \1 < ([A-Z][A-Z0-9_]*|\d+); \1\+\+\)")


def loops(code):
    return re.findall(r"\b(?:for|while|do|goto|break|continue)\b", code)


@pytest.mark.parametrize("source", [*(f"{name}.c" for name in COUNTED), "fixed.h"])
def test_loops_of_the_tick_are_counted_by_a_constant(source):
    """Every loop goes from 0 to a constant, and nothing leaves it early or changes its counter."""
    code = code_without_comments(CORE / source)
    counted = COUNTED_LOOP.findall(code)
    assert counted
    assert len(loops(code)) == len(counted)
    for counter, _ in counted:
        assert not re.search(rf"(?<![\w.>]){counter}\s*(=[^=]|[-+*/]=|--)", re.sub(COUNTED_LOOP, "", code)), counter
    assert not re.search(r"for \(.*return", code)


@pytest.mark.parametrize("loop", ["while (x) f();", "for (unsigned i = 0; i < n; i++) f();", "again: f(); goto again;"])
def test_other_loops_would_be_seen(loop):
    assert len(loops(loop)) != len(COUNTED_LOOP.findall(loop))


def test_loops_and_divisions_would_be_seen(cortex_m4):
    """feedforward_tables.c, which never runs in a tick, has both."""
    assert has_cycle(flow(cortex_m4["feedforward_tables"]))
    assert re.search(r"__aeabi_u?ldivmod", cortex_m4["feedforward_tables"])


@pytest.mark.parametrize("name", IN_TICK)
def test_tick_uses_no_floating_point_instruction(cortex_m4, name):
    assert not re.search(r"^\s+v(mov|add|mul|ldr|str|cvt|push|pop)", cortex_m4[name], flags=re.M)


# ---------------------------------------------------------------- scenarios
def random_bits(rng, struct):
    return struct.from_buffer_copy(rng.bytes(len(bytes(struct()))))


def plausible_config(rng):
    config = random_bits(rng, AxisConfig)
    config.mode = rng.integers(0, 8)
    config.ramp_q24 = rng.integers(1, 2**20)
    config.pid.kp_q24, config.pid.ki_ts_q32 = (int(v) for v in rng.integers(-(2**22), 2**25, 2))
    config.pid.kd_over_ts_q24 = rng.integers(-(2**20), 2**22)
    config.pid.d_alpha_q31 = rng.choice([INT32_MAX, rng.integers(0, 2**31)])
    config.path.kind = rng.choice([int(kind) for kind in Kind])
    config.path.swing, config.path.offset = (int(v) for v in rng.integers(-(2**22), 2**24, 2))
    config.path.step_turn64 = int(rng.integers(2**50, 2**60))
    config.path.ticks = int(rng.integers(0, 200))
    config.output.u_min_q24, config.output.u_max_q24, config.output.slew_q24 = -2 << 24, 10 << 24, 3355443
    config.filter.in_use = int(rng.integers(0, 4))
    config.filter.section = tuple(Biquad(*section(rng)) for _ in range(2))
    converter = config.converter
    converter.dac_zero_code, converter.dac_codes_per_V_q16 = 32768, 3200 * 65536
    converter.adc_zero_q8, converter.adc_um_per_code_q32 = 599186, 280 * 65536
    return config


def section(rng, one=1 << 26):
    """A stable section with a static gain of 1."""
    radius, angle, zero = rng.uniform(0, 0.99), rng.uniform(0, np.pi), rng.uniform(-0.9, 0.9)
    a1, a2 = round(-2 * radius * np.cos(angle) * one), round(radius**2 * one)
    b0 = round((1 - 2 * radius * np.cos(angle) + radius**2) / (1 - zero) * one)
    return b0, one + a1 + a2 - b0, 0, a1, a2


def compensation(rng):
    """What a device could have been given, or bits that no validation has seen; and the weights of its plays."""
    if rng.random() < 0.2:
        return random_bits(rng, Compensation), rng.bytes(4 * 32)
    made = Compensation(int(rng.integers(0, 20 << 16)), int(rng.integers(-(2**20), 2**20)))
    made.shape = tuple(Biquad(*section(rng)) for _ in range(6))
    made.drive = Biquad(*section(rng))
    made.creep.k_q30 = tuple(int(v) for v in rng.integers(-(2**26), 2**26, 8))
    made.creep.alpha_q64 = tuple(int(v) for v in rng.integers(0, 2**62, 8) >> rng.integers(0, 40, 8))
    inverse = made.inverse
    inverse.u_min_q24, inverse.u_max_q24, inverse.gain_q20 = -2 << 24, 10 << 24, int(rng.integers(1 << 20, 20 << 20))
    inverse.offset_q16 = int(rng.integers(-(2**20), 2**20))
    inverse.rest_fraction_q30 = int(rng.integers(-(2**30), 2**30))
    for play, r_q24 in zip(inverse.play, np.sort(rng.integers(0, 5 << 24, 32)), strict=False):
        play.r_q24 = int(r_q24)
    inverse.knot_d_q24 = tuple(int(v) for v in np.sort(rng.integers(-2 << 24, 11 << 24, 24)))
    inverse.knot_s_q20 = tuple(int(v) for v in rng.integers(0, 2 << 20, 24))
    return made, rng.integers(0, 2 << 20, 32).astype("<i4").tobytes()


def scenario(rng, n):
    """One run for the harness: config, model, waveform, range and frequency, ticks. Half of them are
    plausible, the others are bits that no validation has seen."""
    plausible = rng.random() < 0.5
    config = plausible_config(rng) if plausible else random_bits(rng, AxisConfig)
    if not plausible:
        config.mode, config.path.kind = rng.integers(0, 8), rng.integers(0, 5)
    scale = rng.uniform(0.5, 2)
    tame = model_of(a=(15.2536 * scale, 1.9619, -0.1013), swing_V=(rng.uniform(0, 2), rng.uniform(4, 12)))
    model = tame if rng.random() < 0.8 else random_bits(rng, FeedforwardModel)
    if rng.random() < 0.2:
        model.b_q40 = random_bits(rng, FeedforwardModel).b_q40
    wave = rng.integers(0, 2**30, 1024, endpoint=True) if plausible else rng.integers(-(2**31), 2**31, 1024)
    range_f = rng.integers([2**21, 2**16], [2**23, 20 * 2**16]).astype("<i4")
    if rng.random() < 0.05:  # the far edge: a row that is none would be read, just behind the tables
        model, range_f = POWERS_OF_TWO, np.array([0, 16 << 16], dtype="<i4")
    ticks = np.empty((n, 2), dtype="<u2")
    steps = rng.integers(-300, 300, n)
    ticks[:, 0] = np.where(rng.random(n) < 0.05, rng.choice([0, 65535], n), 30000 + np.cumsum(steps))
    ticks[:, 1] = rng.choice([4, 4, 4, 4, 4, 4, 4, 4, 3, 1, 0, 2], n)
    ticks[0, 1] = 3
    memory = CompensationState() if plausible else random_bits(rng, CompensationState)
    made, weights = compensation(rng)
    parts = [bytes(config), bytes(model), bytes(made), weights, wave.astype("<i4").tobytes(), range_f.tobytes()]
    parts.append(bytes(memory))
    return b"".join([*parts, np.uint32(n).tobytes(), ticks.tobytes()])


@pytest.fixture(scope="module")
def scenarios():
    rng = np.random.default_rng(20100)
    return np.uint32(SCENARIOS).tobytes() + b"".join(scenario(rng, TICKS) for _ in range(SCENARIOS))


def run_harness(program, scenarios):
    return subprocess.run([str(program)], input=scenarios, capture_output=True)


@pytest.fixture(scope="module")
def reference_output(compiler, scenarios, tmp_path_factory):
    program = tmp_path_factory.mktemp("o0") / "harness"
    compile_core(program, compiler("gcc"), "-O0", "-DHARNESS_MAIN")
    done = run_harness(program, scenarios)
    assert done.returncode == 0
    return done.stdout


def test_scenarios_reach_every_part(reference_output):
    """The comparison below means nothing if the runs are dull."""
    lines = reference_output.splitlines()
    judged = [int(line) for line in lines[:: 1 + 11 * TICKS]]
    assert len(judged) == SCENARIOS
    assert sum(verdict // 2 == 1 for verdict in judged) > SCENARIOS / 4  # model accepted, point looked up
    assert sum(verdict // 4 > 0 for verdict in judged) > SCENARIOS / 20  # model refused
    assert sum(verdict % 2 for verdict in judged) > SCENARIOS / 2  # an inverse exists
    assert sum(verdict % 2 == 0 for verdict in judged) > SCENARIOS / 20  # none does
    assert len(set(lines)) > 30_000


BUILDS = [("gcc", "-O2"), ("gcc", "-O3", "-fwrapv"), ("clang", "-O2"), ("clang", "-O0")]


@pytest.mark.parametrize("flags", BUILDS, ids=" ".join)
def test_every_build_gives_the_same_bits(compiler, scenarios, reference_output, tmp_path, flags):
    program = compile_core(tmp_path / "harness", compiler(flags[0]), *flags[1:], "-DHARNESS_MAIN")
    done = run_harness(program, scenarios)
    assert done.returncode == 0
    assert hashlib.sha256(done.stdout).hexdigest() == hashlib.sha256(reference_output).hexdigest()


def test_no_undefined_behaviour(compiler, scenarios, reference_output, tmp_path):
    """Aborts at the first signed overflow, bad shift, misaligned or out-of-bounds access."""
    sanitize = "-fsanitize=undefined,address,float-cast-overflow"
    flags = ["-O1", "-g", sanitize, "-fno-sanitize-recover=all", "-DHARNESS_MAIN"]
    program = compile_core(tmp_path / "harness", compiler("gcc"), *flags)
    done = run_harness(program, scenarios)
    assert done.returncode == 0, done.stderr.decode()[-2000:]
    assert done.stdout == reference_output


def test_harness_is_compiled_with_the_core():
    assert HARNESS.exists()
    assert {path.stem for path in CORE.glob("*.c")} == {*IN_TICK, *AT_COMMIT}
