"""The transition table, judged row by row against the words of its documentation."""

import itertools

import pytest

from phaselead.device import wire
from phaselead.sim.device import load_library

STATES = ["parked", "armed", "running", "stopping", "fault"]
EVENTS = [
    *("arm", "start", "park", "stop", "at_rest", "clear", "clear_early"),
    *("fault_hold", "fault_ramp", "core_lost"),
]
REFUSED = "refuse"

# (state, event) -> state, action; whatever is not here is refused and changes nothing.
EXPECTED = {
    ("parked", "arm"): ("armed", "ramp"),
    ("parked", "park"): ("parked", "ramp"),
    ("parked", "stop"): ("parked", "hold"),
    ("armed", "start"): ("running", "start"),
    ("armed", "park"): ("stopping", "ramp"),
    ("armed", "stop"): ("stopping", "ramp"),
    ("running", "park"): ("stopping", "ramp"),
    ("running", "stop"): ("stopping", "ramp"),
    ("stopping", "park"): ("stopping", "ramp"),
    ("stopping", "stop"): ("stopping", "ramp"),
    ("stopping", "at_rest"): ("parked", "none"),
    ("stopping", "fault_hold"): ("fault", "ramp"),
    ("fault", "arm"): ("fault", "refuse_fault"),
    ("fault", "start"): ("fault", "refuse_fault"),
    ("fault", "park"): ("fault", "ramp"),
    ("fault", "stop"): ("fault", "ramp"),
    ("fault", "clear"): ("parked", "ramp"),
    ("fault", "fault_hold"): ("fault", "none"),
    **{(state, "at_rest"): (state, "none") for state in ("parked", "armed", "running", "fault")},
    **{(state, "fault_hold"): ("fault", "hold") for state in ("parked", "armed", "running")},
    **{(state, "fault_ramp"): ("fault", "ramp") for state in STATES},
    **{(state, "core_lost"): ("fault", "ramp") for state in STATES},
}


def names_of(function, most=100):
    found = itertools.takewhile(lambda name: name is not None, map(function, range(most)))
    return [name.decode() for name in found]


@pytest.fixture(scope="module")
def library():
    return load_library()


def test_every_state_and_event_has_the_name_of_its_number(library):
    assert names_of(library.host_state_name) == STATES == [state.name.lower() for state in wire.State]
    assert names_of(library.host_event_name) == EVENTS


@pytest.mark.parametrize("event", EVENTS)
@pytest.mark.parametrize("state", STATES)
def test_the_table_says_what_the_words_say(library, state, event):
    actions = names_of(library.host_action_name)
    entry = library.host_transition(STATES.index(state), EVENTS.index(event))
    assert (STATES[entry & 0xFF], actions[entry >> 8]) == EXPECTED.get((state, event), (state, REFUSED))


def test_every_fault_names_its_reaction(library):
    reactions = names_of(library.host_fault_reaction)
    assert len(reactions) == len(wire.Fault)
    assert set(reactions) == {"hold", "ramp", "core-lost"}
