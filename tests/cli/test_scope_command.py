"""phaselead scope: what it refuses before it opens anything."""

from __future__ import annotations


def test_the_command_says_what_is_wrong_before_it_opens_anything(run, tmp_path):
    assert "is no folder" in run("scope", "--out", str(tmp_path / "nowhere"), "--no-browser").err
    assert run("scope", "--park-after", "-1", "--no-browser").status == 2
