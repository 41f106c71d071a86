"""Access control: no requests of other web pages; a token beyond the loopback."""

from __future__ import annotations

import asyncio
import hmac
import secrets
import time
from collections import deque
from collections.abc import Awaitable, Callable
from ipaddress import ip_address
from urllib.parse import parse_qs, quote, urlencode, urlsplit

from starlette.datastructures import Headers
from starlette.requests import Request, cookie_parser
from starlette.responses import HTMLResponse, JSONResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.types import Message as ASGIMessage

from palpate.dashboard.panel_html import panel_html
from palpate.errors import InputError

COOKIE = "palpate-token"
MIN_TOKEN_LENGTH = 8
#: Where a stop is asked for, by the page and by machines.
STOP_PATHS = frozenset({"/stop", "/api/stop"})
#: Wrong tokens that a visitor may send within a minute; from then on tokens of that visitor are
#: checked one by one, in this time: guessing eight characters takes ages, seconds.
MAX_WRONG_TOKENS, _WRONG_TOKEN_WINDOW_S, CHECK_INTERVAL_S = 10, 60.0, 1.0
#: An order that waited longer than this for its turn would come as a surprise, seconds.
_MAX_WAIT_S = 4.0
#: Wrong visitors that are counted; more of them share one count.
_MAX_VISITORS = 1000
#: A form with the longest token that makes sense; nothing longer is read.
_MAX_FORM_BYTES = 4096
_LOOPBACK_NAMES = ("localhost",)
#: Of every answer. A frame of another site could lead a click to a button here; the address may
#: hold the token.
_HEADERS = (
    (b"x-frame-options", b"DENY"),
    (b"content-security-policy", b"frame-ancestors 'none'"),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"same-origin"),
)
#: No page is read there.
_API_PREFIX = "/api/"


def is_loopback(host: str) -> bool:
    """Return whether a host name or address is this machine's own loopback.

    Examples
    --------
    >>> is_loopback("127.0.0.1"), is_loopback("localhost"), is_loopback("0.0.0.0")
    (True, True, False)
    """
    if host in _LOOPBACK_NAMES:
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


def check_token(host: str, token: str | None) -> None:
    """Refuse to serve beyond the loopback without a token of sufficient length.

    Raises
    ------
    InputError
        If there is none, or it is too short.
    """
    if token is not None and len(token) < MIN_TOKEN_LENGTH:
        raise InputError(f"the token has {len(token)} characters; give at least {MIN_TOKEN_LENGTH}")
    if token is None and not is_loopback(host):
        raise InputError(
            f"--host {host} lets other machines move the gripper: give a --token (or "
            "PALPATE_TOKEN), or leave --host out"
        )


class AccessControl:
    """Passes requests on to the application, or answers them itself.

    A page of another site, open in the same browser, could otherwise press the buttons here: so a
    request that names an origin must name ours, and on the loopback the host must be the loopback's
    name (else a foreign name could be made to point at it).

    Parameters
    ----------
    app : ASGI application
        The application behind it; kept under the name by which servers look for it.
    token : str or None
        What a visitor must send once: then a cookie is enough, until this server ends. A machine
        sends it each time, in the header ``Authorization: Bearer TOKEN``.
    loopback : bool
        Whether it is served on the loopback alone.
    now_s, wait : callable
        A clock, and what waits for some seconds of it.
    """

    def __init__(
        self,
        app: ASGIApp,
        *,
        token: str | None,
        loopback: bool,
        now_s: Callable[[], float] = time.monotonic,
        wait: Callable[[float], Awaitable[None]] = asyncio.sleep,
    ) -> None:
        self.app, self._token, self._loopback, self._wait = app, token, loopback, wait
        self._wrong_tokens = WrongTokens(now_s)
        #: Drawn, so that no guess of the token shows in it.
        self._cookie = secrets.token_urlsafe(32)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request, or hand it on."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        send = _with_headers(send)
        headers = Headers(scope=scope)
        answer: Response | None = None
        if not self._is_same_origin(headers):
            answer = _token_page(403, "This address is not for other sites.")
        elif self._token is not None and not self._has_cookie(headers):
            if scope["path"].startswith(_API_PREFIX):
                answer = await self._check_machine(scope, headers, self._token)
            else:
                answer = await self._ask_for_token(scope, receive, self._token)
        if answer is None:
            await self.app(scope, receive, send)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            await answer(scope, receive, send)

    def _is_same_origin(self, headers: Headers) -> bool:
        try:
            host = urlsplit(f"//{headers.get('host', '')}").hostname or ""
            origin = headers.get("origin")
            foreign = origin is not None and urlsplit(origin).netloc != headers.get("host")
        except ValueError:  # "[::1" and the like
            return False
        return not foreign and (not self._loopback or is_loopback(host))

    def _has_cookie(self, headers: Headers) -> bool:
        # Every port of a host shares its cookies: those of others may be odd.
        return _is_same_token(
            cookie_parser(headers.get("cookie", "")).get(COOKIE, ""), self._cookie
        )

    async def _check_machine(self, scope: Scope, headers: Headers, token: str) -> Response | None:
        """Refuse a machine in one line, unless it sends the token."""
        scheme, _, sent = headers.get("authorization", "").partition(" ")
        if scheme.lower() != "bearer":
            return _error_response(401, "send the token in a header: Authorization: Bearer TOKEN")
        visitor = _client_address(scope)
        if scope["path"] in STOP_PATHS and self._wrong_tokens.has_too_many(visitor):
            # It may be the right one, and a stop waits for nothing. A check would answer guesses.
            return None
        found = await self._check_token(sent, token, visitor)
        if found is None:
            return _error_response(429, "too many wrong tokens from this address: wait a minute")
        return None if found else _error_response(403, "that is not the token")

    async def _check_token(self, sent: str, token: str, visitor: str) -> bool | None:
        """Check the token at this visitor's turn; None if the turn is too far away."""
        wait_s = self._wrong_tokens.reserve_slot(visitor)
        if wait_s > _MAX_WAIT_S:
            return None
        if wait_s > 0:
            await self._wait(wait_s)
        if _is_same_token(sent, token):
            self._wrong_tokens.release_slot(visitor)
            return True
        self._wrong_tokens.add(visitor)
        return False

    async def _ask_for_token(self, scope: Scope, receive: Receive, token: str) -> Response:
        """Take the token from the form or the address, or ask for it."""
        sent = _token_field(scope.get("query_string", b""))
        if scope["type"] == "http" and scope["method"] == "POST":
            form = await _read_form(Request(scope, receive))
            if form is None:
                return _token_page(413, "That is too long for a token.", form=True)
            sent = _token_field(form)
        if not sent:
            return _token_page(
                401, "The person who started this dashboard has its token.", form=True
            )
        found = await self._check_token(sent, token, _client_address(scope))
        if found is None:
            return _token_page(429, "Too many wrong tokens: wait a minute.", form=True)
        if not found:
            return _token_page(403, "That is not the token.", form=True)
        welcome = RedirectResponse(_without_token(scope), status_code=303)
        welcome.set_cookie(COOKIE, self._cookie, httponly=True, samesite="lax")
        return welcome


class WrongTokens:
    """Counts recent wrong tokens by visitor.

    An address that sent too many is slowed down, not refused, as another visitor there may have
    the right one.
    """

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._times_s: dict[str, deque[float]] = {}
        #: When the next token of a visitor who sent too many is checked.
        self._next_checks_s: dict[str, float] = {}

    def has_too_many(self, visitor: str) -> bool:
        """Return whether this visitor sent too many."""
        return len(self._times_s.get(self._count_key(visitor), ())) >= MAX_WRONG_TOKENS

    def reserve_slot(self, visitor: str) -> float:
        """Return the delay before a token may be checked, and reserve that slot."""
        if not self.has_too_many(visitor):
            return 0.0
        now_s, name = self._now_s(), self._count_key(visitor)
        turn_s = max(self._next_checks_s.get(name, now_s), now_s)
        if turn_s - now_s <= _MAX_WAIT_S:
            self._next_checks_s[name] = turn_s + CHECK_INTERVAL_S
        return turn_s - now_s

    def release_slot(self, visitor: str) -> None:
        """Release the turn of a correct token."""
        name = self._count_key(visitor)
        if name in self._next_checks_s:
            self._next_checks_s[name] -= CHECK_INTERVAL_S

    def add(self, visitor: str) -> None:
        """Count a wrong token."""
        times_s = self._times_s.setdefault(self._count_key(visitor), deque(maxlen=MAX_WRONG_TOKENS))
        times_s.append(self._now_s())

    def _count_key(self, visitor: str) -> str:
        """Remove expired entries; return the key of a visitor."""
        now_s = self._now_s()
        for one, times_s in list(self._times_s.items()):
            while times_s and now_s - times_s[0] > _WRONG_TOKEN_WINDOW_S:
                times_s.popleft()
            if not times_s:
                del self._times_s[one]
                self._next_checks_s.pop(one, None)
        full = len(self._times_s) >= _MAX_VISITORS
        return "" if full and visitor not in self._times_s else visitor


def _without_token(scope: Scope) -> str:
    """Return the requested address without the token, always one of this site."""
    fields = _parse_form(scope.get("query_string", b""))
    kept = {name: values for name, values in fields.items() if name != "token"}
    query = urlencode(kept, doseq=True)
    return f"/{quote(scope['path'].lstrip('/'))}{'?' if query else ''}{query}"


def _client_address(scope: Scope) -> str:
    return str((scope.get("client") or ("",))[0])


def _error_response(status: int, text: str) -> Response:
    return JSONResponse({"detail": text}, status_code=status)


async def _read_form(request: Request) -> bytes | None:
    """Return the body of a form; None for one that is too long."""
    body = b""
    async for part in request.stream():
        body += part
        if len(body) > _MAX_FORM_BYTES:
            return None
    return body


def _token_field(form: bytes) -> str:
    return _parse_form(form).get("token", [""])[0]


def _parse_form(form: bytes) -> dict[str, list[str]]:
    try:
        return parse_qs(form.decode("latin-1"), max_num_fields=10, keep_blank_values=True)
    except ValueError:
        return {}


def _with_headers(send: Send) -> Send:
    """Return a `send` that forbids framing and a change of the content type."""

    async def send_with_headers(message: ASGIMessage) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", ()), *_HEADERS]}
        await send(message)

    return send_with_headers


def _is_same_token(sent: str, token: str) -> bool:
    return hmac.compare_digest(sent.encode(errors="replace"), token.encode(errors="replace"))


def _token_page(status: int, text: str, *, form: bool = False) -> Response:
    return HTMLResponse(panel_html("token_page", text=text, form=form), status_code=status)
