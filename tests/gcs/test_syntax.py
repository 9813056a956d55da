"""Bytes into commands and answers into lines: laws, then examples."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pipython.pidevice.common.gcscommands_helpers import getgcsheader
from pipython.pidevice.gcsmessages import eol

from phaselead.gcs.errors import Code, GcsError
from phaselead.gcs.syntax import LONGEST, Command, Reader, Unreadable, array, groups, lines, number, switch, whole

words = st.text(st.characters(min_codepoint=33, max_codepoint=126), min_size=1, max_size=8)


@given(st.binary(max_size=300), st.lists(st.integers(0, 300), max_size=6))
def test_the_pieces_in_which_bytes_come_do_not_matter(data, cuts):
    reader, at, found = Reader(), [0, *sorted(cuts), len(data)], []
    for low, high in pairwise(at):
        found += reader.feed(data[low:high])
    assert found == list(Reader().feed(data))


@given(st.lists(words, min_size=1, max_size=5), st.sampled_from(["\n", "\r\n", " \n", "\n\n"]))
def test_a_line_is_its_words(parts, end):
    name, *rest = parts
    assert list(Reader().feed((" ".join(parts) + end).encode())) == [Command(name.upper(), tuple(rest))]


@given(st.binary(max_size=50).filter(lambda data: not {10, 13} & set(data)))
def test_a_single_character_does_not_wait_for_the_end_of_a_line(before):
    assert list(Reader().feed(before + b"\x18"))[-1] == Command("#24")


def test_a_line_too_long_is_dropped_whole_and_the_next_is_read():
    found = list(Reader().feed(b"WAV " + b"1" * LONGEST + b"\nPOS?\n"))
    assert found == [Unreadable(Code.COMMAND_TOO_LONG), Command("POS?")]


def test_what_is_no_ascii_is_said_so():
    assert list(Reader().feed("MOV µ 1\n".encode())) == [Unreadable(Code.PARAM_SYNTAX)]
    assert list(Reader().feed(b"MOV\0x 1\n")) == [Unreadable(Code.PARAM_SYNTAX)]


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_numbers_are_read_as_they_are_written(value):
    assert number(repr(value)) == value
    assert math.isclose(number(f"{value:.12g}"), value, rel_tol=1e-11, abs_tol=1e-320)


@pytest.mark.parametrize("word", ["nan", "inf", "1e999", "1_0", "0x10", "", "1,5", "--1", "１"])
def test_what_is_no_number(word):
    with pytest.raises(GcsError, match="PARAM_SYNTAX"):
        number(word)


def test_whole_numbers_and_switches():
    assert (whole("0x0E000200"), whole("12"), whole("3.0")) == (0x0E000200, 12, 3)
    assert (switch("0"), switch("1")) == (False, True)
    for read, word in ((whole, "1.5"), (switch, "2"), (switch, "-1")):
        with pytest.raises(GcsError):
            read(word)


def test_words_in_groups():
    assert groups(["x", "1", "y", "2"], 2) == [("x", "1"), ("y", "2")]
    with pytest.raises(GcsError, match="MISSING_PARAM"):
        groups([], 2)
    with pytest.raises(GcsError, match="PARAM_NR"):
        groups(["x"], 2)


@given(st.lists(words, min_size=1, max_size=6))
def test_pipython_sees_where_an_answer_ends(parts):
    answer = lines(parts)
    assert [at for at in range(2, len(answer) + 1) if eol(answer[:at])] == [len(answer)]


@given(st.lists(st.floats(-1e6, 1e6, width=32), min_size=1, max_size=20))
def test_pipython_reads_an_array(values):
    text = array("rows", 0.0002, {"a": values, "b": values[::-1]})
    head, _, rows = text.partition("# END_HEADER \n")
    assert getgcsheader(head)["NDATA"] == len(values)
    read = np.array([[float(word) for word in row.split()] for row in rows.splitlines()])
    assert np.allclose(read, np.column_stack([values, values[::-1]]), rtol=1e-5)
