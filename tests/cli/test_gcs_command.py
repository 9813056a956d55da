"""phaselead gcs: what it refuses before it opens anything."""

from __future__ import annotations


def test_the_command_says_what_is_wrong_in_one_line(run):
    for words, said in (
        (("--listen", "0.0.0.0:50000"), "only this computer"),
        (("--listen", "nowhere"), "no address and port"),
        (("--link", "./pi"), "--pty too"),
        (("--axis", "q"), "axes 'q'"),
    ):
        result = run("gcs", *words)
        assert result.status == 2
        assert said in result.err
        assert result.err.count("\n") == 1
