"""The page of the gap workflow and its words on the terminal, from results made by hand."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from phaselead.cli.gap_run import printed
from phaselead.gap.findings import (
    NOT_NAMED,
    Adopted,
    Bound,
    Candidate,
    Cell,
    Detectable,
    GapSize,
    NamedEffect,
    NextExperiment,
    Spectrum,
    Trace,
)
from phaselead.gap.result import GapResult
from phaselead.gap.unexplained import Unexplained
from phaselead.model import catalogue
from phaselead.model.axis import AdoptedEffect, AxisModel, TimeView
from phaselead.model.stage_file import Stage
from phaselead.record import Source
from phaselead.report.gap import gap_page, headline, next_command, remains, sizes_of, standing_out, verdict_card

STAGE = Stage(name="s", axes={"x": AxisModel(time=TimeView(gain_um_per_V=10, u_range_V=(0, 5), rate_Hz=1000))})

PAIR = ("delay", "amplifier_lowpass")
EXPERIMENT = NextExperiment("multisine", 2.0, (5.0, 1000.0), 3.0, 2.0, 120.0, 0.99, tells_apart=PAIR)


def result() -> GapResult:
    """A resonance named, a tie, and everything else that a page can show."""
    t = np.arange(3000) / 1000
    x = 10 * np.sin(2 * np.pi * 2 * t)
    rng = np.random.default_rng(0)
    before, after = x + 0.3 * np.sin(2 * np.pi * 80 * t), x + 0.01 * rng.normal(size=len(t))
    return GapResult(
        stage=STAGE,
        verdicts=("named", "tie"),
        effects=(
            NamedEffect("resonance", {"f_Hz": (200.0, "Hz", (199.0, 201.0))}, 0.9, "beats no effect by 50", 0.97),
        ),
        ties=(PAIR,),
        excluded=(Bound("creep", 0.002, "per decade"), Bound("softening", 0.2, "1", "y")),
        untestable=("vibration",),
        where=(
            Cell("frequency", "64..128 Hz", 0.8, "80 % of the unexplained power lies between 64 and 128 Hz", 0.002),
            Cell("direction", "rising", 0.5, "50 % is left while the voltage rises", 0.6),
            Cell("frequency", "0..32 Hz", 0.1, "10 % lies between 0 and 32 Hz", 0.002),
        ),
        gap=GapSize(0.3, 0.02, 0.015, "um", "what the model leaves of the reference records"),
        next_experiment=EXPERIMENT,
        holdout_sha256=("ab" * 32,),
        candidates=(
            Candidate(1, "resonance", 50.0, "named"),
            Candidate(2, "creep + delay", 9.0, "named"),
            Candidate(2, "resonance + creep", 8.0, "named"),
        ),
        traces=(Trace("rec.csv", "x", t, x / 10, x, before, after),),
        untestable_why={"vibration": "needs idle records"},
        seconds=1.5,
        adopted=(Adopted("resonance", "named"), Adopted("delay", "provisional")),
        unexplained=Unexplained(0.42, 0.05),
    )


def text(page: str) -> str:
    """What a reader sees."""
    return " ".join(re.sub(r"<[^>]*>", " ", re.sub(r"<(style|svg).*?</\1>", " ", page, flags=re.DOTALL)).split())


def test_the_page_says_what_where_and_what_remains():
    page = gap_page(result(), "model.toml", json_name="tie.json")
    said = text(page)
    for words in (
        "The model lacks: resonance.",
        "These records cannot tell apart: delay or amplifier low-pass.",
        "80 % of the unexplained power lies between 64 and 128 Hz.",
        "It accounts for 90 % of the unexplained power; its probability is 0.97. Evidence: beats no effect by 50.",
        "Tie: delay or amplifier low-pass",
        "Adopted provisionally: delay",
        "From the voltage a generic model predicts 42 % of what the names leave (chance alone: up to 5 %). Chance",
        "of the power above the floor remains on the held-out records",
        "Each of these effects is, with a probability of 95 %, no larger than its bound; the next column says from",
        "These are not present at their typical size. effect bound (95 %) expected to be named from typical size unit",
        "creep 0.002 0.015 per decade These may be present at their typical size",
        "could be one of them. effect bound (95 %) expected to be named from typical size unit",
        "softening (y) 0.2 0.15",
        "creep + delay 9.0 most probable; delay in a tie",
        "resonance + creep 8.0 most probable; resonance named",
        "phaselead gap next tie.json --model model.toml --port P",
        "Vibration : needs idle records",
        "A multisine of 2 V peak-to-peak about 3 V, 5 to 1000 Hz, for 2 s. It is to tell apart delay and amplifier "
        "low-pass. It is expected to bring log odds of 120 for the true one, and names it 99 times in 100.",
    ):
        assert words in said
    assert page.count("<svg") == 3
    assert "<script" not in page
    assert "http" not in re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL)


def test_none_with_more_than_the_floor_left_says_why_effects_were_not_tested():
    of_nothing = {"verdicts": ("none",), "effects": (), "ties": (), "adopted": (), "unexplained": None}
    for gap, more in (((0.3, 0.3, 0.1), True), ((0.3, 0.15, 0.1), False), ((0.0, 0.0, 0.0), False)):
        found = replace(result(), **of_nothing, gap=GapSize(*gap))
        assert ("what they cannot show may be there" in str(found)) is more
        assert ("needs idle records" in str(found)) is more
        assert ("what they cannot show may be there" in text(gap_page(found, "model.toml"))) is more
    assert "cannot show may be there" not in str(replace(result(), gap=GapSize(0.3, 0.3, 0.1)))


def test_what_no_voltage_predicts_is_said_to_stay_in_the_gap():
    hum = NamedEffect("mains_hum", {"sin1_um": (0.05, "um", (0.04, 0.06))}, 0.0, "lines at 50 Hz", 0.99)
    drift = NamedEffect("thermal_drift", {"ramp_um_per_s": (0.05, "um/s", (0.04, 0.06))}, 0.0, "goes on", 0.99)
    assert "no voltage predicts mains_hum: that stays in the gap" in str(replace(result(), effects=(hum, drift)))
    assert "stays in the gap" not in str(result())


def test_a_page_of_nothing():
    still = replace(
        result(), verdicts=("none",), effects=(), ties=(), excluded=(), untestable=(), where=(), next_experiment=None,
        candidates=(), traces=(), gap=GapSize(0.01, 0.01, 0.01), adopted=(), unexplained=None,
    )  # fmt: skip
    said = text(gap_page(still, "model.toml"))
    assert "Nothing was found that is not among the known errors of the base model." in said
    assert "There is no residual to locate." in said
    assert "The data call for no effect of the catalogue." in said
    assert "Nothing was adopted: the gap is as it was." in said


def test_a_page_of_the_unknown_does_not_say_that_nothing_is_there():
    lost = replace(result(), verdicts=("unknown",), effects=(), ties=(), next_experiment=None)
    said = text(gap_page(lost, "model.toml"))
    assert "Something remains that no name is sure to explain." in said
    assert "No effect of the catalogue is sure to be what is missing." in said
    assert "The data call for no effect" not in said


HELP = "records of the unchanged stage, given as --reference, would help"


def test_where_nothing_is_named_it_is_the_model_that_leaves_a_rest():
    for verdicts in (("unknown",), ("tie", "unknown"), ("tie",)):
        found = replace(result(), verdicts=verdicts, effects=())
        for said in (str(found), text(gap_page(found, "model.toml")).replace(HELP.capitalize(), HELP)):
            assert "generic model predicts 42 % of what the model leaves" in said
            assert "what the names leave" not in said
            assert (HELP in said) is ("unknown" in verdicts)


def test_references_are_not_asked_for_where_they_are_or_something_is_named():
    source = Source("before.h5", "ab" * 32)
    given = replace(result(), verdicts=("unknown",), effects=(), sources={"reference": (source,)})
    assert HELP not in str(given)
    assert HELP not in str(replace(result(), verdicts=("named", "unknown")))


@pytest.mark.parametrize(
    ("effects", "words"),
    [
        (True, ("the names leave", "their equations may miss of the power that they explain")),
        (False, ("the model leaves", "its equations may miss of the power that the tie explains")),
    ],
)
def test_a_rest_that_is_put_down_to_equations_says_so(effects, words):
    found = replace(result(), unexplained=Unexplained(0.42, 0.05, of_equations=True))
    found = found if effects else replace(found, effects=())
    for said in (str(found), text(gap_page(found, "model.toml"))):
        assert " (chance alone: up to 5 %); that is no more than ".join(words) in " ".join(said.split())
    assert "may miss" not in str(result())


def test_only_the_largest_sure_cell_of_a_kind_is_a_bullet():
    assert [c.cell for c in standing_out(result().where)] == ["64..128 Hz"]


@pytest.mark.parametrize(("after", "words"), [(0.3, "100.0 %"), (0.015, "0.0 %"), (0.01, "0.0 %")])
def test_what_remains_is_counted_above_the_floor(after, words):
    assert words in remains(replace(result(), gap=GapSize(0.3, after, 0.015)))


def test_a_floor_that_is_the_rest_itself_is_no_measure_of_it():
    own = replace(result(), gap=GapSize.below(0.2, 0.1, 0.15, "what the modes leave of the training records"))
    said = text(gap_page(own, "model.toml"))
    assert "25.0 % of the unexplained power remains on the held-out records. How much of that is noise is not" in said
    for wrong in ("other records set", "power above the floor", "no larger than the floor"):
        assert wrong not in said


def test_a_bound_and_the_size_that_would_be_named_are_two_things():
    bounds = (Bound("creep", 0.002, "per decade"), Bound("delay", 5e-5, "s"))
    found = replace(result(), adopted=(), excluded=bounds, detectable=(Detectable("delay", 1.3e-3, "s"),))
    said = text(gap_page(found, "model.toml"))
    assert "creep 0.002 beyond 10 typical sizes, if at all 0.015 per decade" in said
    assert "delay 0.05 1.3 " in said
    assert "the records would have shown it" not in said


def test_the_runners_up_say_that_their_log_odds_count_a_prior():
    said = text(gap_page(result(), "model.toml"))
    assert "The log odds in the last column are not the difference of two scores: they also count the prior" in said


def test_the_page_calls_an_effect_by_its_title_wherever_a_person_reads_it():
    """Names of stage files stand where these are meant alone."""
    codes = sorted(name for name in catalogue() if "_" in name)
    lowest = {n: {p.name: (p.low, p.unit, (p.low, p.high)) for p in catalogue()[n].parameters} for n in codes}
    found = replace(
        result(),
        effects=tuple(NamedEffect(n, lowest[n], 0.1) for n in codes),
        candidates=(Candidate(2, " + ".join(codes), 9.0, NOT_NAMED),),
        untestable=("load_change",),
        untestable_why={"load_change": "one axis cannot tell it from sensor_nonlinearity, which stands for both"},
        messages=("thermal_drift or gain_change would be named.",),
        spectra=(Spectrum("mains_hum", "x", np.arange(3.0), np.ones(3), None),),
        adopted=(Adopted("dead_band", "provisional"),),
    )
    page = gap_page(found, "model.toml")
    said = text(re.sub(r"<code>.*?</code>", "", page))
    assert [name for name in codes if re.search(rf"{name}(?!\.\w)", said)] == []
    for words in (
        "Load change : one axis cannot tell it from sensor nonlinearity, which",
        "amplifier low-pass + asymmetric hysteresis",
        "DAC nonlinearity It accounts",
        "Thermal drift or gain change would be named",
        "Mains hum Spectrum",
    ):
        assert words.lower() in said.lower()
    assert "dac" not in said.replace("dac_nonlinearity.predistorted", "")
    assert "<code>amplifier_lowpass</code>" in page


def test_the_page_says_whose_floor_a_gap_has_come_down_to():
    near = text(gap_page(replace(result(), gap=replace(result().gap, after=0.016)), "model.toml"))
    assert "0.0 % of the power above the floor remains on the held-out records. The floor is what the model" in near
    assert "The floor is" not in text(gap_page(result(), "model.toml"))


def test_the_terminal_says_the_same():
    said = "\n".join(map(str, printed(result(), ["next.toml"])))
    for words in (
        "verdict: named, tie",
        "these records cannot tell apart: delay, amplifier_lowpass",
        "adopted provisionally, for the prediction; not vouched for: delay",
        "from the voltage a generic model predicts 42 % of what the names leave (chance alone: up to 5 %)",
        "80 % of the unexplained power lies between 64 and 128 Hz",
        "held-out gap 0.3 -> 0.02 um rms, each record about its own mean; floor 0.015",
        "creep < 0.002 per decade",
        "next, to tell delay, amplifier_lowpass apart: multisine, 2 V peak-to-peak about 3 V, 5..1000 Hz, 2 s",
        "names the true one 99 times in 100",
        "wrote next.toml",
    ):
        assert words in said


def test_gap_json_says_what_the_experiment_tells_apart_and_how_often_it_names_the_true_one():
    proposed = result().as_json()["next_experiment"]
    assert proposed["chance"] == 0.99
    assert proposed["tells_apart"] == list(PAIR)
    page = (Path(__file__).parents[2] / "docs" / "gap.md").read_text("utf-8")
    assert [key for key in proposed if f"`{key}`" not in page] == []


def test_of_two_ties_both_are_in_the_headline_and_the_experiment_says_which_it_decides():
    two = replace(result(), verdicts=("tie",), effects=(), ties=(("creep", "thermal_drift"), PAIR))
    said = text(gap_page(two, "model.toml"))
    assert "Creep or thermal drift; delay or amplifier low-pass verdict: tie" in said
    assert "It is to tell apart delay and amplifier low-pass." in said
    assert "to tell delay, amplifier_lowpass apart: " in str(two)


@pytest.mark.parametrize(("tied", "first"), [(0.1, "Resonance"), (0.95, "Delay or amplifier low-pass")])
def test_what_is_tied_comes_first_where_it_explains_more_than_what_is_named(tied, first):
    held = AdoptedEffect(name=PAIR[0], status="provisional", params={}, share=tied)
    axes = {"x": STAGE.axes["x"].model_copy(update={"effects": (held,)})}
    found = replace(result(), ties=(PAIR,), stage=STAGE.model_copy(update={"axes": axes}))
    card = verdict_card(found)
    assert card["value"] == first
    assert ("beside them resonance" in card["label"]) == (tied > 0.5)
    said = headline(found)
    assert (said.index("cannot tell apart") < said.index("The model lacks")) == (tied > 0.5)


def test_the_command_for_the_next_experiment_can_be_pasted():
    assert next_command("my gap.json", "stage.toml") == (
        "phaselead gap next 'my gap.json' --model stage.toml --port P -o more.h5"
    )
    assert "--model" not in next_command("gap.json", "xyz250")


def test_without_a_tie_the_experiment_is_for_the_power_of_the_level():
    alone = replace(result(), ties=(), next_experiment=replace(EXPERIMENT, axis="x,y", tells_apart=()))
    assert "next, to tell which power of the level softening grows by: multisine, on x, y at once" in str(alone)
    said = text(gap_page(alone, "model.toml"))
    assert "on x,y at once, each with other phases. It is to tell apart the powers of the level" in said


def test_an_experiment_of_one_frequency_says_it_once():
    sine = replace(result(), next_experiment=replace(EXPERIMENT, waveform="sine", band=(1000.0, 1000.0)))
    assert "about 3 V, 1000 Hz, 2 s; predicted log odds" in str(sine)
    assert "about 3 V, 1000 Hz, for 2 s." in text(gap_page(sine, "model.toml"))


def test_that_nothing_was_found_says_nothing_of_what_could_not_be_tested():
    nothing = replace(result(), verdicts=("none",), effects=(), ties=(), where=(), next_experiment=None)
    six = replace(nothing, untestable=("thermal_drift", "vibration", "creep", "offset", "quantisation", "mains_hum"))
    assert headline(six).endswith("These records say nothing of thermal drift, vibration, creep, offset and 2 more.")
    assert verdict_card(six)["label"] == "verdict: none; 6 effects could not be tested"
    assert "say nothing of" not in headline(replace(nothing, untestable=()))


def test_where_something_unknown_remains_the_terminal_says_which_record_would_show_what_is_untestable():
    def said(*verdicts):
        return "\n".join(map(str, printed(replace(result(), verdicts=verdicts), [])))

    assert "vibration" in said("named")
    assert catalogue()["vibration"].reveals not in said("named")
    assert catalogue()["vibration"].reveals in said("named", "unknown")


def test_a_bound_of_a_single_axis_names_none():
    found = result()
    assert [b["axis"] for b in found.as_json()["excluded"]] == [None, "y"]
    assert "creep < 0.002" in str(found)
    assert "softening (y) < 0.2" in str(found)


def test_the_page_has_what_parameters_come_to():
    bow = NamedEffect("sensor_nonlinearity", {"quadratic": (0.002, "of range", (0.001, 0.003))}, 0.5)
    said = text(gap_page(replace(result(), effects=(bow,)), "model.toml"))
    assert re.search(r"\bpeak +[\d.]+", said)  # not the peak-to-peak of an experiment
    assert "peak_um" in str(replace(result(), effects=(bow,)))


def test_cells_of_several_axes_say_which_is_theirs():
    one = Cell("frequency", "8..16 Hz", 0.4, "40 % of it", axis="y")
    where = replace(result(), where=(one, replace(one, axis=None))).as_json()["where"]
    assert where == [
        {"by": "frequency", "cell": "8..16 Hz", "share": 0.4, "axis": "y"},
        {"by": "frequency", "cell": "8..16 Hz", "share": 0.4},
    ]


def test_sizes_that_have_a_unit_in_common_are_named():
    """Two plain numbers told nobody which of a sensor's curve was the bow."""
    rails = {"top": (0.05, "of voltage range", (0.04, 0.06)), "bottom": (0.03, "of voltage range", (0.02, 0.04))}
    said = ["top 0.05 of voltage range", "bottom 0.03 of voltage range"]
    assert sizes_of(NamedEffect("saturation", rails, 0.5)) == said
    assert sizes_of(NamedEffect("delay", {"delay_s": (2e-4, "s", (1e-4, 3e-4))}, 0.5)) == ["0.2 ms"]
