"""Who may use the page: one link, one browser, this origin."""

from __future__ import annotations

import pytest
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect


def test_the_link_works_once_and_the_browser_that_used_it_goes_on(rig):
    link = {"token": rig.access.new_token()}
    stranger = rig.stranger()
    first = stranger.get("/", params=link)
    assert first.status_code == 200
    assert "phaselead scope" in first.text
    assert str(first.url).endswith(":8123/")
    assert stranger.get("/").status_code == 200
    assert rig.stranger().get("/", params=link).status_code == 403


@pytest.mark.parametrize("path", ["/", "/?token=wrong", "/?token=", "/static/main.js", "/files/a.h5", "/ws"])
def test_without_the_link_there_is_nothing(rig, path):
    assert rig.stranger().get(path).status_code == 403


def test_a_forged_cookie_is_none(rig):
    stranger = rig.stranger()
    stranger.cookies.set(rig.access.cookie, "guess")
    assert stranger.get("/").status_code == 403


@pytest.mark.parametrize("host", ["evil.example:8123", "127.0.0.1:80", "127.0.0.1", "0.0.0.0:8123"])
def test_another_host_name_is_refused(rig, host):
    """A name that was made to point here (DNS rebinding)."""
    assert rig.browser.get("/", headers={"host": host}).status_code == 403


@pytest.mark.parametrize("origin", ["http://evil.example", "http://127.0.0.1:9999", "https://127.0.0.1:8123", "null"])
def test_pages_of_other_origins_are_refused(rig, origin):
    assert rig.browser.get("/", headers={"origin": origin}).status_code == 403
    assert rig.browser.post("/link", headers={"origin": origin}).status_code == 403
    with pytest.raises(WebSocketDisconnect):
        rig.open(origin=origin)


def test_a_websocket_without_origin_or_cookie_is_refused(rig):
    with pytest.raises(WebSocketDisconnect), rig.browser.websocket_connect("ws://127.0.0.1:8123/ws"):
        pass
    with (
        pytest.raises(WebSocketDisconnect),
        rig.stranger().websocket_connect("ws://127.0.0.1:8123/ws", headers={"origin": "http://127.0.0.1:8123"}),
    ):
        pass


def test_the_page_needs_no_network(rig):
    """Everything that it names is here, with its licence."""
    text = rig.browser.get("/").text
    assert "http" not in text.replace("http-equiv", "")
    for name in ("vendor/uPlot.iife.min.js", "vendor/uPlot.min.css", "vendor/uPlot-LICENSE.txt", "link.js", "panel.js"):
        assert rig.browser.get(f"/static/{name}").status_code == 200
    assert "MIT" in rig.browser.get("/static/vendor/uPlot-LICENSE.txt").text


def test_another_browser_gets_its_own_link(rig):
    link = rig.browser.post("/link", headers={"origin": "http://127.0.0.1:8123"}).text.strip()
    other = TestClient(rig.site.app(), base_url="http://127.0.0.1:8123")
    assert other.get(link).status_code == 200
