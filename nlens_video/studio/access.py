"""Who may speak to the server: whoever holds the token, from the page that it served.

The token is a part of every address, so that nothing a browser sends by itself (a cookie) admits a
request of another site. The names of host and origin are checked as well: a site whose name is made
to lead to this machine (DNS rebinding) is refused even if it knew the token.
"""

from __future__ import annotations

import secrets
from collections.abc import Iterable
from urllib.parse import parse_qs

from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

_REFUSED = 403
_POLICY_CLOSED = 1008  # WebSocket: the message or its sender breaks a rule
_HEADERS = (
    (
        b"content-security-policy",
        b"default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; "
        b"media-src 'self'; connect-src 'self'; base-uri 'self'; form-action 'none'; "
        b"frame-ancestors 'none'",
    ),
    (b"referrer-policy", b"no-referrer"),
    (b"x-content-type-options", b"nosniff"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
)


def new_token() -> str:
    """A token that cannot be guessed."""
    return secrets.token_urlsafe(24)


class Guard:
    """Lets only requests with the token through, and takes it off their path.

    A request carries it as `/?token=T`, which is the page, or as the first part of its path.

    Args:
        app: what is guarded.
        token: the token.
        names: of the host, by which a browser may ask for it.
        port: the server listens on it.
    """

    def __init__(self, app: ASGIApp, token: str, names: Iterable[str], port: int) -> None:
        self._app = app
        self._token = token
        self._hosts = {f"{name}:{port}" for name in names}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """As ASGI calls it."""
        inner = self._admitted(scope)
        if inner is None and scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": _POLICY_CLOSED})
            return
        if inner is None:
            words = "This page needs the address that nlens-video studio has printed.\n"
            await PlainTextResponse(words, _REFUSED)(scope, receive, send)
            return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], *_HEADERS]
            await send(message)

        await self._app(inner, receive, with_headers)

    def _admitted(self, scope: Scope) -> Scope | None:
        """The request without its token, None where it must be refused."""
        headers = _by_name(scope["headers"])
        hosts = headers.get("host", [])
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            return None
        if not all(self._is_ours(origin) for origin in headers.get("origin", [])):
            return None
        path = scope["path"]
        if path == "/":
            given = parse_qs(scope["query_string"].decode("ascii", "replace")).get("token", [""])
            rest = "/"
        else:
            first, _, after = path[1:].partition("/")
            given, rest = [first], f"/{after}"
            if rest == "/":
                return None
        if len(given) != 1 or not secrets.compare_digest(given[0].encode(), self._token.encode()):
            return None
        return {**scope, "path": rest, "raw_path": rest.encode(), "root_path": ""}

    def _is_ours(self, origin: str) -> bool:
        scheme, _, host = origin.partition("://")
        return scheme == "http" and host in self._hosts


def _by_name(headers: Iterable[tuple[bytes, bytes]]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for name, value in headers:
        found.setdefault(name.decode("latin-1").lower(), []).append(value.decode("latin-1"))
    return found
