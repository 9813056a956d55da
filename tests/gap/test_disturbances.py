"""Laws of what no voltage predicts: vibration, jitter and hum are found where they are new, and only there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from phaselead.gap.bounds import largest_disturbances
from phaselead.gap.disturbances.disturbance_search import find_disturbances
from phaselead.gap.disturbances.jitter import find_jitter
from phaselead.gap.disturbances.vibration import find_vibration, louder_at_rest
from phaselead.gap.records import GapRun
from phaselead.gap.residual import RunResidual
from trials import in_trials

STEP_s = 1e-3


def run_of(u_V: np.ndarray, x_um: np.ndarray, role: str = "train") -> GapRun:
    t = np.arange(len(u_V)) * STEP_s
    return GapRun("x", role, t, u_V, x_um, None, 0, len(u_V), "made.csv", {}, {})  # type: ignore[arg-type]


def ringing(rng: np.random.Generator, n: int, f_Hz: float, zeta: float) -> np.ndarray:
    """White noise through a mode, as surroundings keep one ringing."""
    r, turn = np.exp(-2 * np.pi * f_Hz * zeta * STEP_s), 2 * np.pi * f_Hz * STEP_s
    x = lfilter([1.0], [1, -2 * r * np.cos(turn), r * r], rng.normal(size=n + 2000))[2000:]
    return np.asarray(0.01 * x / x.std())


def left(error_um: np.ndarray) -> RunResidual:
    return RunResidual(run_of(np.zeros(len(error_um)), error_um), error_um)


def test_a_mode_that_always_rings_is_no_new_vibration():
    found = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        parts = [[left(ringing(rng, n, 190.0, 0.01) + 0.005 * rng.normal(size=n))] for n in (1500, 1000, 1500)]
        found += find_vibration("vibration", *parts) is not None
    assert found == 0


def test_a_new_vibration_is_found_where_it_is():
    rng = np.random.default_rng(2)
    quiet = [0.01 * rng.normal(size=n) for n in (4000, 3000, 4000)]
    shaken = [quiet[0] + ringing(rng, 4000, 120.0, 0.05), quiet[1] + ringing(rng, 3000, 120.0, 0.05), quiet[2]]
    found = find_vibration("vibration", *([left(e)] for e in shaken))
    assert found is not None
    assert abs(found.params["f_Hz"][0] - 120) < 10
    assert 0.005 < found.params["rms_um"][0] < 0.015


@pytest.mark.parametrize(
    ("f_Hz", "zeta", "n"), [(38.0, 0.02, 1500), *in_trials((120.0, 0.05, 6000), (30.0, 0.05, 6000))]
)
def test_the_intervals_of_a_vibration_hold_what_was_put_in(f_Hz, zeta, n):
    """The bandwidth as well: it had been that of the band in which the peak was seen."""
    truth, inside = {"rms_um": 0.01, "f_Hz": f_Hz, "bandwidth_Hz": 2 * zeta * f_Hz}, []
    finer = 16  # at which the shaken mode is as good as continuous
    for seed in range(20):
        rng = np.random.default_rng(seed)

        def still(um: float, rng=rng) -> RunResidual:
            shaken = ringing(rng, finer * n, f_Hz / finer, zeta)[::finer]
            return left(um * shaken + 0.005 * rng.normal(size=n))

        parts = [[still(um), still(um)] for um in (1.0, 1.0, 0.0)]
        found = find_vibration("vibration", *parts)
        assert found is not None
        inside += [low <= truth[name] <= high for name, (_, _, (low, high)) in found.params.items()]
    assert np.mean(inside) >= 0.85


def wandering(rng: np.random.Generator, n: int) -> np.ndarray:
    """Noise that grows towards low frequencies, as that of a sensor does."""
    return coloured(rng, n, 0.5) + 0.02 * coloured(rng, n, 100.0)


def test_a_slow_vibration_is_found_beside_noise_that_is_slower_still():
    """What a sensor's zero wanders about hid a vibration of ten times the power that was usual there."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        parts = [[left(0.02 * wandering(rng, 1500) + um * ringing(rng, 1500, 17.0, 0.05))] for um in (1, 1, 0)]
        found = find_vibration("vibration", *parts)
        assert found is not None
        assert abs(found.params["f_Hz"][0] - 17) < 4


def test_a_short_record_beside_long_ones_hides_no_slow_vibration():
    """Its lines are 10 Hz apart, and the lowest are left out."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        parts = [
            [left(um * ringing(rng, n, 17.0, 0.05) + 0.003 * rng.normal(size=n)) for n in (6000, 400)]
            for um in (1, 1, 0)
        ]
        found = find_vibration("vibration", *parts)
        assert found is not None
        assert abs(found.params["f_Hz"][0] - 17) < 4


def test_what_wanders_more_than_it_did_is_no_vibration():
    """It has become louder at one end of the spectrum: it was named a vibration in each of these."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        parts = [[left(um * coloured(rng, 6000, 40.0) + 0.003 * rng.normal(size=6000))] for um in (0.02, 0.02, 0)]
        assert find_vibration("vibration", *parts) is None
        assert louder_at_rest(*parts)


@pytest.mark.parametrize(("one_Hz", "other_Hz"), [(75.0, 90.0), *in_trials((75.0, 200.0), (75.0, 130.0))])
def test_of_two_vibrations_one_is_named_and_none_between_them(one_Hz, other_Hz):
    for seed in range(4):
        rng = np.random.default_rng(seed)
        parts = []
        for um in (1, 1, 0):
            shaken = ringing(rng, 6000, one_Hz, 0.02) + ringing(rng, 6000, other_Hz, 0.02)
            parts.append([left(um * shaken + 0.003 * rng.normal(size=6000))])
        found = find_vibration("vibration", *parts)
        assert found is None or min(abs(found.params["f_Hz"][0] - f_Hz) for f_Hz in (one_Hz, other_Hz)) < 5


@pytest.mark.parametrize("f_Hz", [2.0, 3.0])
def test_a_vibration_below_what_is_looked_at_is_not_named_where_that_begins(f_Hz):
    rng = np.random.default_rng(0)
    parts = [[left(2 * um * ringing(rng, 6000, f_Hz, 0.05) + 0.003 * rng.normal(size=6000))] for um in (1, 1, 0)]
    found = find_vibration("vibration", *parts)
    assert found is None or abs(found.params["f_Hz"][0] - f_Hz) < 0.5


def test_a_vibration_is_found_where_the_held_out_records_are_noisier():
    for seed in range(5):
        rng = np.random.default_rng(seed)
        levels = ((1.0, 0.005), (1.0, 0.02), (0.0, 0.005))
        parts = [[left(um * ringing(rng, 6000, 120.0, 0.05) + noise * rng.normal(size=6000))] for um, noise in levels]
        found = find_vibration("vibration", *parts)
        assert found is not None
        assert abs(found.params["f_Hz"][0] - 120) < 3


def test_references_without_any_noise_are_no_end_of_the_search():
    """A sensor whose noise is below half a step."""
    rng = np.random.default_rng(0)
    shaken = [[left(ringing(rng, 1500, 75.0, 0.02))] for _ in "ab"]
    assert find_vibration("vibration", *shaken, [left(np.zeros(1500))]) is not None
    silent = [[left(np.zeros(1500))] for _ in "abc"]
    assert find_vibration("vibration", *silent) is None


def coloured(rng: np.random.Generator, n: int, corner_Hz: float) -> np.ndarray:
    """Noise that is flat below its corner and falls above, as of a sensor's electronics."""
    pole = np.exp(-2 * np.pi * corner_Hz * STEP_s)
    return np.asarray(lfilter([np.sqrt(1 - pole**2)], [1, -pole], rng.normal(size=n + 2000))[2000:])


@pytest.mark.parametrize("corner_Hz", [12.0, *in_trials(0.6, 3.0, 60.0)])
def test_noise_that_falls_with_the_frequency_is_no_vibration_without_references(corner_Hz):
    found = 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        parts = [
            [left(0.01 * coloured(rng, n, corner_Hz) + rng.choice([0.002, 0.01]) * rng.normal(size=n))]
            for n in (7500, 6000)
        ]
        found += find_vibration("vibration", *parts, []) is not None
    assert found == 0


@pytest.mark.parametrize("referenced", [True, False])
@pytest.mark.parametrize("rows", [256, 500, 1500])
def test_white_noise_is_no_vibration_however_short_the_records(rows, referenced):
    for seed in range(10):
        rng = np.random.default_rng(seed)
        train, holdout, reference = ([left(rng.normal(size=rows))] for _ in range(3))
        assert find_vibration("vibration", train, holdout, reference if referenced else []) is None


@pytest.mark.parametrize("f_Hz", [38.0, 120.0, 310.0])
def test_a_vibration_stands_above_both_of_its_sides_without_references(f_Hz):
    rng = np.random.default_rng(4)
    quiet = [0.01 * coloured(rng, n, 12.0) + 0.003 * rng.normal(size=n) for n in (7500, 6000)]
    found = find_vibration("vibration", *([left(e + ringing(rng, len(e), f_Hz, 0.02))] for e in quiet), [])
    assert found is not None
    assert found.params["f_Hz"][0] == pytest.approx(f_Hz, abs=4)
    assert found.params["rms_um"][0] == pytest.approx(0.01, rel=0.4)


def humming(rng, n, rate_Hz, size_um, f_Hz=50.03):
    t = np.arange(n) / rate_Hz
    return size_um * sum(np.sin(2 * np.pi * f_Hz * k * t + rng.uniform(0, 6)) / k for k in (1, 2, 3))


def at_rate(error_um, rate_Hz):
    """A record at rest at another rate."""
    made = left(error_um)
    return replace(made, run=replace(made.run, t_s=np.arange(len(error_um)) / rate_Hz))


def found_at_rest(parts):
    named, _, _ = find_disturbances(*parts, [], {"mains_hum", "vibration"})
    return {one.name: one for one in named}


@pytest.mark.parametrize("rate_Hz", [5000.0, *in_trials(1000.0)])
@pytest.mark.parametrize("f_Hz", [70.0, 85.0, *in_trials(38.0, 175.0, 310.0)])
def test_hum_as_strong_hides_no_vibration_without_references(f_Hz, rate_Hz):
    found = 0
    for seed in range(5):
        rng, parts = np.random.default_rng(seed), []
        for n in (7500, 6000):
            shaken = 2 * ringing(rng, n, f_Hz / (rate_Hz * STEP_s), 0.01)
            error_um = humming(rng, n, rate_Hz, 0.02) + shaken + 0.005 * rng.normal(size=n)
            parts.append([at_rate(error_um, rate_Hz)])
        one = found_at_rest(parts).get("vibration")
        found += one is not None and abs(one.params["f_Hz"][0] - f_Hz) < 6
        assert one is None or 0.008 < one.params["rms_um"][0] < 0.04
    assert found >= 4


@pytest.mark.parametrize("rate_Hz", [1000.0, 5000.0])
@pytest.mark.parametrize("size_um", [0.02, 0.2])
@pytest.mark.parametrize("f_Hz", [50.03, *in_trials(49.9, 60.1)])
def test_hum_with_its_multiples_is_no_vibration_without_references(f_Hz, size_um, rate_Hz):
    for seed in range(3):
        rng = np.random.default_rng(seed)
        parts = [
            [at_rate(humming(rng, n, rate_Hz, size_um, f_Hz) + 0.005 * rng.normal(size=n), rate_Hz)]
            for n in (10_000, 8_000)
        ]
        assert set(found_at_rest(parts)) == {"mains_hum"}


def test_a_line_at_the_mains_is_no_vibration():
    rng = np.random.default_rng(3)
    t = STEP_s * np.arange(4000)
    hum = 0.1 * np.sin(2 * np.pi * 50.02 * t)  # so strong that it is seen beside the lines that are left out
    parts = [[left(0.002 * rng.normal(size=4000) + share * hum)] for share in (1.0, 1.0, 0.0)]
    assert find_vibration("vibration", *parts) is None


@pytest.mark.parametrize("f_Hz", [50.0, 120.0])
def test_what_is_new_at_rest_is_noticed_whatever_it_is(f_Hz):
    rng = np.random.default_rng(3)
    line = 0.02 * np.sin(2 * np.pi * f_Hz * STEP_s * np.arange(4000))
    noises = [0.01 * rng.normal(size=4000) for _ in range(3)]
    new = [[left(noise + share * line)] for noise, share in zip(noises, (1.0, 1.0, 0.0), strict=True)]
    old = [[left(noise + line)] for noise in noises]
    assert louder_at_rest(*new)
    assert not louder_at_rest(*old)
    assert not louder_at_rest(new[0], new[1], [])  # nobody knows what was there before


def jittery(rng: np.random.Generator, f_Hz: float, rms_s: float, role: str) -> RunResidual:
    """A sine read at times that are off at random."""
    t = np.arange(6000) * STEP_s
    late = rms_s * rng.normal(size=len(t))
    ideal, speed = 20 * np.sin(2 * np.pi * f_Hz * t), 40 * np.pi * f_Hz * np.cos(2 * np.pi * f_Hz * t)
    error = 0.01 * rng.normal(size=len(t)) + late * speed
    return RunResidual(run_of(ideal / 10, ideal + error, role), error)


def test_a_clock_that_is_off_shows_on_all_records_alike():
    rng = np.random.default_rng(4)
    parts = [[jittery(rng, f, rms, role) for f in (5.0, 11.0)]
             for rms, role in ((2e-5, "train"), (2e-5, "holdout"), (0.0, "reference"))]  # fmt: skip
    found = find_jitter("sampling_jitter", *parts)
    assert found is not None
    assert found.params["rms_s"][0] == pytest.approx(2e-5, rel=0.1)
    assert find_jitter("sampling_jitter", parts[2], parts[2], parts[2]) is None


def test_fast_noise_on_one_record_alone_is_no_clock():
    rng = np.random.default_rng(5)
    odd = [[jittery(rng, 5.0, 0.0, role), jittery(rng, 11.0, 3e-5, role)] for role in ("train", "holdout")]
    still = [jittery(rng, f, 0.0, "reference") for f in (5.0, 11.0)]
    slow = [[jittery(rng, 5.0, 2e-4, role), jittery(rng, 11.0, 0.0, role)] for role in ("train", "holdout")]
    assert find_jitter("sampling_jitter", *slow, still) is None
    assert find_jitter("sampling_jitter", *odd, still) is None


def fast(rng: np.random.Generator, rms_s: float, role: str, missed_um: float = 0.0) -> RunResidual:
    """A sine of a fifth of the sampling rate whose amplitude swells, read by that clock, and a harmonic missed."""
    t = np.arange(6000) * STEP_s
    swell, w = 1 + np.sin(2 * np.pi * 0.7 * t), 2 * np.pi * 0.2 / STEP_s
    ideal, speed = 2 * swell * np.sin(w * t), 2 * swell * w * np.cos(w * t)
    error = 0.01 * rng.normal(size=len(t)) + rms_s * rng.normal(size=len(t)) * speed
    error += missed_um * swell * np.sin(w * t + 1)
    return RunResidual(run_of(ideal / 10, ideal + error, role), error)


@pytest.mark.parametrize("seed", range(4))
def test_the_size_of_a_jitter_is_right_however_fast_the_motion(seed):
    rng = np.random.default_rng(seed)
    parts = [[fast(rng, rms, role)] for rms, role in ((1e-5, "train"), (1e-5, "holdout"), (0.0, "reference"))]
    found = find_jitter("sampling_jitter", *parts)
    assert found is not None
    assert found.params["rms_s"][0] == pytest.approx(1e-5, rel=0.1)


@pytest.mark.parametrize("seed", range(4))
def test_what_a_model_misses_of_fast_motion_is_no_clock(seed):
    rng = np.random.default_rng(seed)
    parts = [[fast(rng, 0.0, role, missed_um=0.05)] for role in ("train", "holdout")]
    assert find_jitter("sampling_jitter", *parts, [fast(rng, 0.0, "reference")]) is None


def test_noise_that_is_new_and_of_no_effect_allowed_is_said():
    rng = np.random.default_rng(6)
    parts = [[fast(rng, rms, role)] for rms, role in ((1e-5, "train"), (1e-5, "holdout"), (0.0, "reference"))]
    named, _, left_out = find_disturbances(*parts, {"sampling_jitter"})
    assert [f.name for f in named] == ["sampling_jitter"]
    assert not left_out
    named, untestable, left_out = find_disturbances(*parts, {"vibration"})
    assert not named
    assert list(untestable) == ["vibration"]
    assert "times the speed" in left_out[0]


def test_steps_of_a_sensor_cannot_be_told_without_references():
    """It may always have had them; no record of this session says otherwise."""
    rng = np.random.default_rng(8)
    stepped = []
    for role in ("train", "holdout"):
        one = fast(rng, 0.0, role)
        x_um = 0.02 * np.round(one.run.x_um / 0.02)
        stepped.append([replace(one, run=replace(one.run, x_um=x_um))])
    named, untestable, _ = find_disturbances(*stepped, [], {"quantisation"})
    assert not named
    assert "--reference" in untestable["quantisation"]
    named, untestable, _ = find_disturbances(*stepped, [fast(rng, 0.0, "reference")], {"quantisation"})
    assert [one.name for one in named] == ["quantisation"]
    assert not untestable


@pytest.mark.parametrize("seed", range(4))
def test_a_narrow_vibration_in_a_short_record_is_found(seed):
    rng = np.random.default_rng(seed)
    b, a = [1.0], np.poly(np.exp([(-0.05 + 1j) * 2 * np.pi * 17 * STEP_s, (-0.05 - 1j) * 2 * np.pi * 17 * STEP_s]))

    def still(rms_um: float, role: str) -> RunResidual:
        shaken = lfilter(b, np.real(a), rng.normal(size=6500))[5000:]
        error = 0.01 * rng.normal(size=1500) + rms_um * shaken / shaken.std()
        return RunResidual(run_of(np.zeros(1500), error, role), error - error.mean())

    shaking = [[still(0.015, role)] for role in ("train", "holdout")]
    calm = [still(0.0, "reference")]
    found = find_vibration("vibration", *shaking, calm)
    assert found is not None
    assert abs(found.params["f_Hz"][0] - 17) < 6
    assert find_vibration("vibration", [still(0.0, "train")], [still(0.0, "holdout")], calm) is None


def moving(rng, n, noise_um):
    """A record that moves, and what a model without an error leaves of it."""
    u = np.cumsum(rng.normal(size=n)) * 0.02
    return RunResidual(run_of(u, 10 * u), noise_um * rng.normal(size=n))


@pytest.mark.parametrize("noise_um", [0.0, 0.003])
@pytest.mark.parametrize("seed", range(5))
def test_a_disturbance_is_no_larger_than_all_that_is_left(seed, noise_um):
    rng, n, t = np.random.default_rng(seed), 4000, STEP_s * np.arange(4000)

    def rest(error_um):
        return [left(error_um + noise_um * rng.normal(size=n)) for _ in range(2)]

    shaken, humming = rest(ringing(rng, n, 60.0, 0.02)), rest(0.02 * np.sin(2 * np.pi * 50 * t))
    assert largest_disturbances(shaken[:1], shaken[1:])["band"] >= 0.0099
    assert largest_disturbances(humming[:1], humming[1:])["lines"] >= 0.0199
    assert set(largest_disturbances(shaken[:1], shaken[1:])) == {"lines", "band"}
    parts = [moving(rng, n, noise_um) for _ in range(2)]
    grid = [RunResidual(r.run, r.error_um + 0.05 * np.round(r.run.x_um / 0.05) - r.run.x_um) for r in parts]
    assert largest_disturbances(grid[:1], grid[1:])["grid"] >= 0.049
    late = [RunResidual(r.run, r.error_um + 1e-5 * rng.normal(size=n) * r.speed_um_per_s) for r in parts]
    assert largest_disturbances(late[:1], late[1:])["speed"] >= 0.97e-5
    assert set(largest_disturbances(late[:1], late[1:])) == {"grid", "speed"}


def test_a_clock_is_not_tested_without_references():
    parts = [[moving(np.random.default_rng(seed), 4000, 0.003)] for seed in (0, 1)]
    assert "--reference" in find_disturbances(*parts, [], {"sampling_jitter"})[1]["sampling_jitter"]


@pytest.mark.parametrize("corner_Hz", [20.0, 100.0, None])
@pytest.mark.parametrize("louder", [(2.0, 2.0), *in_trials(((3.75, 3.75),), ((1.6, 4.0),), ((4.0, 1.6),))])
@pytest.mark.parametrize("rows", [(6000, 4000, 6000), (400, 300, 400)])
def test_noise_that_is_louder_as_a_whole_is_no_vibration(louder, corner_Hz, rows):
    """A sensor in another range, say: no name of the catalogue is right."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        parts = []
        for n, size in zip(rows, (*louder, 1.0), strict=True):
            noise = 0.008 * rng.normal(size=n) if corner_Hz is None else 0.8 * coloured(rng, n, corner_Hz)
            parts.append([left(size * noise)])
        assert find_vibration("vibration", *parts) is None
        assert louder_at_rest(*parts) or rows[0] < 1000


@pytest.mark.parametrize("zeta", [0.02, *in_trials(0.083, 0.15)])
def test_a_vibration_in_louder_noise_is_found(zeta):
    for seed in range(10):
        rng = np.random.default_rng(seed)
        quiet = [0.008 * rng.normal(size=n) for n in (6000, 4000, 6000)]
        shaken = [3 * noise + 2 * ringing(rng, len(noise), 120.0, zeta) for noise in quiet[:2]]
        found = find_vibration("vibration", *([left(e)] for e in (*shaken, quiet[2])))
        assert found is not None
        assert abs(found.params["f_Hz"][0] - 120) < 10 + 120 * zeta


def stepped(rng: np.random.Generator, n: int, step_um: float, moved_um: float, shaken_um: float = 0.0) -> RunResidual:
    """A record of a sensor whose noise is 3 nm, with steps unless ``step_um`` is 0, at rest where it moves by 0."""
    path = rng.uniform(0, 1) + moved_um * np.sin(2 * np.pi * np.arange(n) / n)
    noise = 0.003 * rng.normal(size=n) + 100 * shaken_um * ringing(rng, n, 120.0, 0.02)
    x = np.round((path + noise) / step_um) * step_um if step_um else path + noise
    u = path - path[0]
    return RunResidual(run_of(u, x), x - path - (x - path).mean())


@pytest.mark.parametrize("shaken_um", [0.0, *in_trials(0.004)])
def test_what_steps_of_a_sensor_round_off_is_no_vibration(shaken_um):
    """It is noise at all frequencies: where the reference happens to be quiet it stands out."""
    found = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        now = [[stepped(rng, 1500, 0.015, moved, shaken_um) for moved in (0.0, 1.0)] for _ in ("train", "holdout")]
        before = [stepped(rng, 1500, 0.0, moved) for moved in (0.0, 1.0)]
        named = {one.name for one in find_disturbances(*now, before, {"vibration", "quantisation"})[0]}
        assert "quantisation" in named
        found += "vibration" in named
    assert found >= 95 if shaken_um else found == 0


@pytest.mark.parametrize("moved_um", [(0.0,), (0.0, 0.0), (0.0, 1.0)])
def test_steps_that_a_sensor_always_had_are_not_new(moved_um):
    """Of a reference at rest one or two are seen."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        now = [[stepped(rng, 1500, 0.015, moved) for moved in (0.0, 1.0)] for _ in ("train", "holdout")]
        before = [stepped(rng, 1500, 0.015, moved) for moved in moved_um]
        named = {one.name for one in find_disturbances(*now, before, {"vibration", "quantisation"})[0]}
        assert "quantisation" not in named
