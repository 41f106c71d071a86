"""Access control: tokens, cookies, origins and throttling."""

from __future__ import annotations

import asyncio
import hmac
from typing import Any
from urllib.parse import quote

import pytest
from starlette.responses import PlainTextResponse

from palpate.dashboard.access import (
    COOKIE,
    MAX_WRONG_TOKENS,
    AccessControl,
    WrongTokens,
    check_token,
    is_loopback,
)
from palpate.errors import InputError

TOKEN = "correct-horse"


class Answer:
    def __init__(self, messages: list[dict[str, Any]]) -> None:
        start = messages[0]
        self.kind = start["type"]
        self.status = start.get("status", start.get("code"))
        self.headers = {key.decode(): value.decode() for key, value in start.get("headers", [])}
        self.body = b"".join(message.get("body", b"") for message in messages[1:]).decode()


async def application(scope: Any, receive: Any, send: Any) -> None:
    """Accept every request."""
    if scope["type"] == "websocket":
        await send({"type": "websocket.accept"})
    else:
        await PlainTextResponse("in")(scope, receive, send)


def gate_with(token: str = TOKEN) -> AccessControl:
    return AccessControl(application, token=token, loopback=False, now_s=lambda: 0.0)


def ask(
    *,
    token: str | None = None,
    loopback: bool = True,
    method: str = "GET",
    path: str = "/",
    query: str = "",
    body: str = "",
    kind: str = "http",
    gate: AccessControl | None = None,
    client: str = "10.0.0.1",
    **headers: str,
) -> Answer:
    """Send one request through access control to an application that accepts everything."""
    headers = {"host": "127.0.0.1:8080", **headers}
    scope = {
        "type": kind,
        "method": method,
        "path": path,
        "query_string": query.encode(),
        "headers": [(key.encode(), value.encode()) for key, value in headers.items()],
        "client": (client, 40_000),
    }
    messages: list[dict[str, Any]] = []

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": body.encode(), "more_body": False}

    async def send(message: Any) -> None:
        messages.append(message)

    gate = gate or AccessControl(application, token=token, loopback=loopback)
    asyncio.run(gate(scope, receive, send))
    return Answer(messages)


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "robot.local"])
def test_check_token_beyond_the_loopback_requires_a_token(host: str) -> None:
    assert not is_loopback(host)
    with pytest.raises(InputError, match="set --token"):
        check_token(host, None)
    check_token(host, TOKEN)


def test_check_token_on_the_loopback_allows_no_token_and_refuses_a_short_one() -> None:
    check_token("127.0.0.1", None)
    check_token("::1", None)
    with pytest.raises(InputError, match="has 3 characters; use at least 8"):
        check_token("127.0.0.1", "abc")
    check_token("127.0.0.1", "8letters")
    with pytest.raises(InputError, match="has 7 characters"):
        check_token("127.0.0.1", "7letter")


def test_request_without_a_token_returns_the_token_form() -> None:
    answer = ask(token=TOKEN, loopback=False, host="robot:8080")
    assert answer.status == 401
    assert '<input name="token"' in answer.body
    for path in ("/live", "/stop", "/static/live.js"):
        assert ask(token=TOKEN, loopback=False, host="robot:8080", path=path).status == 401


def test_request_with_a_wrong_token_is_refused() -> None:
    for fields in (
        {"query": "token=wrong-horse"},
        {"method": "POST", "body": "token=wrong-horse"},
    ):
        answer = ask(token=TOKEN, loopback=False, host="robot:8080", **fields)
        assert answer.status == 403
        assert "Wrong token." in answer.body


@pytest.mark.parametrize(
    "fields", [{"query": f"token={TOKEN}"}, {"method": "POST", "body": f"token={TOKEN}"}]
)
def test_correct_token_sets_an_http_only_cookie_that_grants_access(
    fields: dict[str, Any],
) -> None:
    gate = gate_with()
    answer = ask(gate=gate, host="robot:8080", **fields)
    assert answer.status == 303
    assert answer.headers["location"] == "/"
    cookie = answer.headers["set-cookie"]
    assert TOKEN not in cookie
    assert "HttpOnly" in cookie
    assert "samesite=lax" in cookie.lower()
    name, _, value = cookie.split(";")[0].partition("=")
    assert name == COOKIE
    inside = ask(gate=gate, host="robot:8080", cookie=f"{name}={value}")
    assert (inside.status, inside.body) == (200, "in")
    for wrong in (value[:-1], value[:8], value + "0", "", TOKEN):
        outside = ask(gate=gate, host="robot:8080", cookie=f"{name}={wrong}")
        assert outside.status == 401


def test_cookie_cannot_be_computed_from_the_token() -> None:
    """A cookie derived from the token could be used to verify guesses without throttling."""
    cookies = set()
    for _ in range(2):
        gate = gate_with()
        answer = ask(gate=gate, host="robot:8080", query=f"token={TOKEN}")
        cookies.add(answer.headers["set-cookie"].split(";")[0])
        known = hmac.new(TOKEN.encode(), b"palpate", "sha256").hexdigest()
        assert ask(gate=gate, host="robot:8080", cookie=f"{COOKIE}={known}").status == 401
    assert len(cookies) == 2


@pytest.mark.parametrize("sent", [TOKEN[:1], TOKEN[:-1], TOKEN + "x"])
def test_token_with_missing_or_additional_characters_is_refused(sent: str) -> None:
    assert ask(token=TOKEN, loopback=False, host="robot:8080", query=f"token={sent}").status == 403


def test_token_with_non_ascii_characters_is_accepted() -> None:
    token = "пароль-яблоко-🍏"
    gate = gate_with(token)
    answer = ask(gate=gate, host="robot:8080", method="POST", body=f"token={quote(token)}")
    assert answer.status == 303
    cookie = answer.headers["set-cookie"].split(";")[0]
    assert ask(gate=gate, host="robot:8080", cookie=cookie).status == 200


def test_token_form_with_an_endless_body_is_refused_after_the_size_limit() -> None:
    read = 0

    async def endless() -> dict[str, Any]:
        nonlocal read
        read += 1
        assert read < 100, "reads beyond the size limit"
        return {"type": "http.request", "body": b"x" * 1000, "more_body": True}

    sent: list[Any] = []

    async def send(message: Any) -> None:
        sent.append(message)

    async def application(scope: Any, receive: Any, send: Any) -> None:
        raise AssertionError("the request was forwarded")

    scope = {
        "type": "http",
        "method": "POST",
        "path": "/",
        "query_string": b"",
        "headers": [(b"host", b"robot:8080")],
    }
    asyncio.run(AccessControl(application, token=TOKEN, loopback=False)(scope, endless, send))
    assert sent[0]["status"] == 413
    assert read <= 6


def bearer(token: str) -> dict[str, Any]:
    return {"host": "robot:8080", "path": "/api/state", "authorization": f"Bearer {token}"}


@pytest.mark.parametrize("path", ["/api/stop", "/"])
def test_correct_token_is_never_refused_during_a_flood_of_wrong_ones(path: str) -> None:
    gate = gate_with()

    def answer_to(token: str) -> int:
        sent = {"query": f"token={token}"} if path == "/" else bearer(token)
        return ask(gate=gate, **{"host": "robot:8080", **sent, "path": path}).status

    wrong = []
    for number in range(10 * MAX_WRONG_TOKENS):
        wrong.append(answer_to(f"guess-{number:08d}"))
        assert answer_to(TOKEN) == (303 if path == "/" else 200)
    assert wrong == [403] * MAX_WRONG_TOKENS + [429] * (9 * MAX_WRONG_TOKENS)
    assert ask(gate=gate, **bearer("wrong-horse"), client="10.0.0.2").status == 403


def test_stop_requires_the_token_even_during_a_flood_of_wrong_ones() -> None:
    gate = gate_with()
    stop = {**bearer("wrong-horse"), "path": "/api/stop", "method": "POST"}
    statuses = {ask(gate=gate, **stop).status for _ in range(3 * MAX_WRONG_TOKENS)}
    assert statuses == {403, 429}
    without = {name: value for name, value in stop.items() if name != "authorization"}
    assert ask(gate=gate, **without).status == 401


def test_every_response_has_the_security_headers() -> None:
    for answer in (ask(), ask(token=TOKEN, loopback=False), ask(origin="https://evil.example")):
        assert answer.headers["x-frame-options"] == "DENY"
        assert answer.headers["content-security-policy"] == "frame-ancestors 'none'"
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["referrer-policy"] == "same-origin"


@pytest.mark.parametrize("header", ["host", "origin"])
@pytest.mark.parametrize("loopback", [True, False])
def test_request_with_a_malformed_host_or_origin_is_refused(header: str, loopback: bool) -> None:
    for value in ("[::1", "["):
        assert ask(token=None, loopback=loopback, **{header: value}).status == 403


def test_request_with_a_foreign_origin_is_refused() -> None:
    assert ask(origin="http://127.0.0.1:8080").status == 200
    assert ask(origin="https://evil.example", method="POST", path="/stop").status == 403
    assert ask(origin="null", method="POST", path="/stop").status == 403


def test_websocket_with_a_foreign_origin_or_without_a_token_is_closed() -> None:
    assert ask(kind="websocket", origin="https://evil.example").status == 1008
    refused = ask(kind="websocket", token=TOKEN, loopback=False)
    assert (refused.kind, refused.status) == ("websocket.close", 1008)
    assert ask(kind="websocket", origin="http://127.0.0.1:8080").status is None


def test_loopback_request_with_a_foreign_host_name_is_refused() -> None:
    assert ask(host="evil.example:8080").status == 403
    assert ask(host="localhost:8080").status == 200
    assert ask(host="[::1]:8080").status == 200
    assert ask(host="[::1]").status == 200
    assert ask(host="[fe80::1]:8080").status == 403


@pytest.mark.parametrize("other", ["a/b=1", "\x00=;;", 'x="', COOKIE])
def test_foreign_cookies_neither_grant_nor_block_access(other: str) -> None:
    gate = gate_with()
    inside = ask(gate=gate, query=f"token={TOKEN}").headers["set-cookie"]
    own = inside.split(";")[0]
    assert ask(gate=gate, cookie=other).status == 401
    assert ask(gate=gate, cookie=f"{other}; {own}").status == 200


@pytest.mark.parametrize(("length", "status"), [(4096, 403), (4097, 413)])
def test_token_form_above_the_size_limit_is_refused(length: int, status: int) -> None:
    body = "token=".ljust(length, "x")
    assert ask(token=TOKEN, loopback=False, method="POST", body=body).status == status


def test_client_addresses_beyond_the_maximum_share_one_count() -> None:
    clock = [0.0]
    wrong_tokens = WrongTokens(now_s=lambda: clock[0])
    for number in range(999):
        wrong_tokens.add(str(number))
    for _ in range(MAX_WRONG_TOKENS):
        wrong_tokens.add("last address counted separately")
    assert wrong_tokens.is_throttled("last address counted separately")
    assert not wrong_tokens.is_throttled("one more")
    for number in range(MAX_WRONG_TOKENS):
        assert not wrong_tokens.is_throttled("one more")
        wrong_tokens.add(f"one more {number}")
    assert wrong_tokens.is_throttled("one more")
    assert not wrong_tokens.is_throttled("0")
    for _ in range(MAX_WRONG_TOKENS):
        wrong_tokens.add("0")
    assert wrong_tokens.is_throttled("0")
    clock[0] = 60.0
    assert wrong_tokens.is_throttled("0")
    clock[0] = 60.1
    assert not wrong_tokens.is_throttled("one more")
    assert not wrong_tokens.is_throttled("0")
