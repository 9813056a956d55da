"""When a recording was taken: told, read again, and never made up."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from phaselead.record import began, t0_facts, t0_unix_s

UNIX_S = st.floats(0, 4e9)
SESSION = 0xA1


@given(UNIX_S, st.floats(0, 1e6))
def test_what_is_told_is_read_again_to_the_microsecond(unix_s, later_s):
    assert t0_unix_s(t0_facts(unix_s, later_s, SESSION)) == pytest.approx(unix_s + later_s, abs=2e-6)


@given(UNIX_S, st.floats(0, 1e6))
def test_the_date_counts_for_more_than_what_the_device_counted(unix_s, later_s):
    assert began(t0_facts(unix_s, later_s, SESSION)) == (pytest.approx(unix_s + later_s, abs=2e-6), True, None)


@given(st.floats(0, 1e6))
def test_without_a_clock_the_device_alone_counts(later_s):
    assert began(t0_facts(None, later_s, SESSION)) == (later_s, False, "00000000000000a1")
    assert began({"t0_device_s": later_s}) == (later_s, False, None)
    assert t0_unix_s(t0_facts(None, later_s, SESSION)) is None
    assert began({}) is None


@pytest.mark.parametrize("unix_s", [1e300, -1e300, float("nan"), float("inf")])
def test_a_clock_that_says_no_date_tells_nothing(unix_s):
    assert t0_facts(unix_s, 3.0, SESSION) == {"t0_device_s": 3.0, "device_session": "00000000000000a1"}


@pytest.mark.parametrize(
    "said", ["", "soon", "3", None, [1.0], True, -1.0, 1j, 10**400, 1e300, float("nan"), float("inf")]
)
def test_what_is_no_number_of_seconds_is_not_believed(said):
    assert began({"t0_device_s": said}) is None


@pytest.mark.parametrize("said", ["", "yesterday", "2026-11-29", "2026-11-29T10:00:00", 17, None, "9999-99-99T00:00Z"])
def test_what_is_no_time_in_a_zone_is_not_believed(said):
    assert t0_unix_s({"t0_utc": said}) is None


def test_another_zone_is_taken_for_what_it_is():
    assert t0_unix_s({"t0_utc": "1970-01-01T02:00:01+02:00"}) == 1.0
