"""Who may see the page: this computer alone, whoever has the link that was printed, and no other site's scripts."""

from __future__ import annotations

import secrets
from http.cookies import CookieError, SimpleCookie

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocketClose

HOSTS = ("127.0.0.1", "localhost")


class Access:
    """One link that works once, and a cookie for the browser that used it."""

    def __init__(self, port: int) -> None:
        """For a page on this port."""
        self.hosts = {f"{name}:{port}" for name in HOSTS}
        self.cookie = f"phaselead-scope-{port}"
        """Cookies are shared by all ports of a computer: each page has its own name."""
        self._secret = secrets.token_urlsafe(32)
        self._links: set[str] = set()

    def new_token(self) -> str:
        """Of another link, which works once."""
        token = secrets.token_urlsafe(24)
        self._links.add(token)
        return token

    def use(self, token: str) -> str | None:
        """The value of the cookie for a token that has not been used; None for any other."""
        found = next((one for one in self._links if secrets.compare_digest(one.encode(), token.encode())), None)
        if found is None:
            return None
        self._links.discard(found)
        return self._secret

    def refusal(self, headers: Headers, *, to_enter: bool, changes: bool) -> str | None:
        """Why a request is refused; None when it is not. ``to_enter``: it brings a token in place of the cookie."""
        host, origin = headers.get("host", ""), headers.get("origin")
        if host not in self.hosts:
            return f"this page is served to {' and '.join(sorted(self.hosts))} alone"
        if origin != f"http://{host}" if changes else origin not in (None, f"http://{host}"):
            return "a page of another origin may not use the scope"
        if not to_enter and not self._has_cookie(headers):
            return "open the link that `phaselead scope` printed; it works once, in one browser"
        return None

    def _has_cookie(self, headers: Headers) -> bool:
        try:
            found = SimpleCookie(headers.get("cookie", "")).get(self.cookie)
        except CookieError:
            return False
        return found is not None and secrets.compare_digest(found.value.encode(), self._secret.encode())


class Guard:
    """Middleware: every request and every websocket passes ``Access`` first."""

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self.app, self.access = app, access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        socket = scope["type"] == "websocket"
        to_enter = not socket and scope["path"] == "/" and b"token=" in scope["query_string"]
        changes = socket or scope["method"] not in ("GET", "HEAD")
        said = self.access.refusal(Headers(scope=scope), to_enter=to_enter, changes=changes)
        if said is None:
            await self.app(scope, receive, send)
        elif socket:
            await WebSocketClose(4403, said)(scope, receive, send)
        else:
            await PlainTextResponse(said + "\n", 403)(scope, receive, send)
