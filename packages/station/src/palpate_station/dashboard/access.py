"""Access control: refuse cross-site requests, and require a token beyond the loopback."""

from __future__ import annotations

import hmac
import secrets
import time
from collections import deque
from collections.abc import Callable, Sequence
from ipaddress import ip_address
from urllib.parse import parse_qs, quote, urlencode, urlsplit

from starlette.datastructures import Headers
from starlette.requests import Request, cookie_parser
from starlette.responses import HTMLResponse, JSONResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.types import Message as ASGIMessage

from palpate.errors import InputError
from palpate_station.dashboard.audit import record_refusal
from palpate_station.dashboard.panel_html import panel_html
from palpate_station.dashboard.users import User

COOKIE = "palpate-token"
#: Path that ends the login of a browser, such as at the change of a shift.
LOGOUT = "/logout"
MIN_TOKEN_LENGTH = 8
#: After this many wrong tokens from a client address within the window (seconds), the answer to
#: further wrong ones is 429.
MAX_WRONG_TOKENS, _WRONG_TOKEN_WINDOW_S = 10, 60.0
#: Maximum number of client addresses counted separately; further addresses share one count.
_MAX_VISITORS = 1000
#: Maximum size of the token form, bytes; longer bodies are refused.
_MAX_FORM_BYTES = 4096
#: Headers of every response. Framing is denied because another site could redirect clicks to the
#: buttons. Referrers are restricted because the URL may contain the token.
_HEADERS = (
    (b"x-frame-options", b"DENY"),
    (b"content-security-policy", b"frame-ancestors 'none'"),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"same-origin"),
)
#: Requests below these paths get JSON errors instead of the token page.
_API_PREFIXES = ("/api/", "/metrics")


def is_loopback(host: str) -> bool:
    """Return whether a host name or address is the loopback of this machine.

    Examples
    --------
    >>> is_loopback("127.0.0.1"), is_loopback("localhost"), is_loopback("0.0.0.0")
    (True, True, False)
    """
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


def check_token(host: str, token: str | None, *, users: Sequence[User] = ()) -> None:
    """Check that serving beyond the loopback uses users, or a sufficiently long token.

    Raises
    ------
    InputError
        If the token is missing or too short.
    """
    if token is not None and len(token) < MIN_TOKEN_LENGTH:
        raise InputError(f"the token has {len(token)} characters; use at least {MIN_TOKEN_LENGTH}")
    if token is None and not users and not is_loopback(host):
        raise InputError(
            f"--host {host} allows other machines to move the gripper: set --token (or "
            "PALPATE_TOKEN) or --users, or omit --host"
        )


class AccessControl:
    """ASGI middleware that forwards authorized requests and answers all others itself.

    A page of another site in the same browser could otherwise press the buttons of this page. A
    request with an origin header must therefore have this server's origin. On the loopback, the
    host header must be a loopback name, which prevents DNS rebinding.

    Parameters
    ----------
    app : ASGI application
        The wrapped application.
    token : str or None
        A browser sends the token once and then uses a cookie, valid until the server ends. An API
        client sends it with every request in the header ``Authorization: Bearer TOKEN``.
    loopback : bool
        Whether the server listens on the loopback only.
    users : sequence of User
        Users with tokens of their own. A request that passes has its user in the ASGI scope as
        ``palpate_user``; a user who may only watch gets no other API requests through than stops.
    now_s : callable
        A clock.
    """

    def __init__(
        self,
        app: ASGIApp,
        *,
        token: str | None,
        loopback: bool,
        users: Sequence[User] = (),
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self.app, self._loopback = app, loopback
        self._users = (*users, *([] if token is None else [User(token=token)]))
        self._wrong_tokens = WrongTokens(now_s)
        #: Random and independent of the token, so the cookie can't be used to verify guesses.
        self._cookies = [(secrets.token_urlsafe(32), user) for user in self._users]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Forward or answer one request."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        send = _with_headers(send)
        headers = Headers(scope=scope)
        answer: Response | None = None
        if not self._is_same_origin(headers):
            answer = _token_page(403, "Requests from other sites are refused.")
        elif self._users:
            user = self._user_of_cookie(headers)
            is_api = scope["path"].startswith(_API_PREFIXES)
            if user is None and is_api:
                found = self._check_api_client(scope, headers)
                user, answer = (found, None) if isinstance(found, User) else (None, found)
            elif user is None:
                answer = await self._ask_for_token(scope, receive)
            scope["palpate_user"] = user
            if is_api and user is not None and not _may_send(user, scope):
                record_refusal(
                    user.name, f"{scope.get('method')} {scope['path'][:80]!r}, role view"
                )
                answer = _error_response(403, f"{user.name} may only watch and stop")
            if user is not None and scope["path"] == LOGOUT:
                answer = RedirectResponse("/operate", status_code=303)
                answer.delete_cookie(COOKIE)
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
        except ValueError:  # such as "[::1"
            return False
        return not foreign and (not self._loopback or is_loopback(host))

    def _user_of_cookie(self, headers: Headers) -> User | None:
        # All ports of a host share cookies, so cookies of other servers may be malformed.
        sent = cookie_parser(headers.get("cookie", "")).get(COOKIE, "")
        return _find_user(sent, self._cookies)

    def _check_api_client(self, scope: Scope, headers: Headers) -> User | Response:
        """Return the user of an API request, or a one-line refusal."""
        scheme, _, sent = headers.get("authorization", "").partition(" ")
        if scheme.lower() != "bearer":
            return _error_response(
                401, "token missing: send the header Authorization: Bearer TOKEN"
            )
        user, is_throttled = self._check_token(sent, _client_address(scope))
        if user is not None:
            return user
        if is_throttled:
            return _error_response(429, "too many wrong tokens from this address: wait a minute")
        return _error_response(403, "wrong token")

    def _check_token(self, sent: str, client: str) -> tuple[User | None, bool]:
        """Return the user of a token, and whether it is one of too many wrong tokens."""
        # Checked before the count, because the user with the correct token may share an address
        # with a client that sends wrong ones, and must never wait for a STOP.
        user = _find_user(sent, [(one.token, one) for one in self._users])
        if user is not None:
            return user, False
        record_refusal(f"HTTP {client}", "wrong token")
        if self._wrong_tokens.is_throttled(client):
            return None, True
        self._wrong_tokens.add(client)
        return None, False

    async def _ask_for_token(self, scope: Scope, receive: Receive) -> Response:
        """Check the token of the form or URL; without a token, return the token page."""
        sent = _token_field(scope.get("query_string", b""))
        if scope["type"] == "http" and scope["method"] == "POST":
            form = await _read_form(Request(scope, receive))
            if form is None:
                return _token_page(413, "The token is too long.", form=True)
            sent = _token_field(form)
        if not sent:
            return _token_page(
                401, "Enter the token that was set when this dashboard was started.", form=True
            )
        user, is_throttled = self._check_token(sent, _client_address(scope))
        if is_throttled:
            return _token_page(429, "Too many wrong tokens: wait a minute.", form=True)
        if user is None:
            return _token_page(403, "Wrong token.", form=True)
        redirect = RedirectResponse(_without_token(scope), status_code=303)
        cookie = next(cookie for cookie, one in self._cookies if one is user)
        is_secure = scope.get("scheme") in ("https", "wss")
        redirect.set_cookie(COOKIE, cookie, httponly=True, samesite="lax", secure=is_secure)
        return redirect


def _find_user(sent: str, known: Sequence[tuple[str, User]]) -> User | None:
    """Return the user of a token or cookie, in a time that does not reveal it."""
    found = [user for secret, user in known if _is_same_token(sent, secret)]
    return found[0] if found else None


def _may_send(user: User, scope: Scope) -> bool:
    """Return whether a user may send an API request: everybody may read and stop."""
    is_read = scope["type"] == "http" and scope["method"] in ("GET", "HEAD")
    return user.role.may_drive or is_read or scope["path"].endswith("/stop")


class WrongTokens:
    """Counts recent wrong tokens of each client address.

    The correct token is never refused, because another user at the same address may have it.
    """

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._times_s: dict[str, deque[float]] = {}

    def is_throttled(self, client: str) -> bool:
        """Return whether a client address has sent too many wrong tokens."""
        return len(self._times_s.get(self._count_key(client), ())) >= MAX_WRONG_TOKENS

    def add(self, client: str) -> None:
        """Count a wrong token of a client address."""
        times_s = self._times_s.setdefault(self._count_key(client), deque(maxlen=MAX_WRONG_TOKENS))
        times_s.append(self._now_s())

    def _count_key(self, client: str) -> str:
        """Remove expired entries; return the key under which a client address is counted."""
        now_s = self._now_s()
        for address, times_s in list(self._times_s.items()):
            while times_s and now_s - times_s[0] > _WRONG_TOKEN_WINDOW_S:
                times_s.popleft()
            if not times_s:
                del self._times_s[address]
        full = len(self._times_s) >= _MAX_VISITORS
        return "" if full and client not in self._times_s else client


def _without_token(scope: Scope) -> str:
    """Return the requested URL without the token, always on this site."""
    fields = _parse_form(scope.get("query_string", b""))
    remaining = {name: values for name, values in fields.items() if name != "token"}
    query = urlencode(remaining, doseq=True)
    return f"/{quote(scope['path'].lstrip('/'))}{'?' if query else ''}{query}"


def _client_address(scope: Scope) -> str:
    return str((scope.get("client") or ("",))[0])


def _error_response(status: int, text: str) -> Response:
    return JSONResponse({"detail": text}, status_code=status)


async def _read_form(request: Request) -> bytes | None:
    """Return the body of a form; None for a body above the size limit."""
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
    """Return a `send` function that adds the security headers to each response."""

    async def send_with_headers(message: ASGIMessage) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", ()), *_HEADERS]}
        await send(message)

    return send_with_headers


def _is_same_token(sent: str, token: str) -> bool:
    return hmac.compare_digest(sent.encode(errors="replace"), token.encode(errors="replace"))


def _token_page(status: int, text: str, *, form: bool = False) -> Response:
    return HTMLResponse(panel_html("token_page", text=text, form=form), status_code=status)
