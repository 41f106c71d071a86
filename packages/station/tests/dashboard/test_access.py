"""Access control: tokens, cookies, origins and throttling."""

from __future__ import annotations

import asyncio
import hmac
from typing import Any
from urllib.parse import quote

import pytest
from starlette.responses import PlainTextResponse

from palpate_station.dashboard.access import (
    COOKIE,
    MAX_WRONG_TOKENS,
    AccessControl,
    WrongTokens,
)
from palpate_station.dashboard.audit import (
    MAX_REFUSALS,
    MAX_REFUSALS_OF_CLIENT,
    RefusalLog,
)

TOKEN = "correct-horse"


class Answer:
    def __init__(self, messages: list[dict[str, Any]]) -> None:
        start = messages[0]
        self.status = start.get("status", start.get("code"))
        self.headers = {key.decode(): value.decode() for key, value in start.get("headers", [])}
        self.body = b"".join(message.get("body", b"") for message in messages[1:]).decode()

    @property
    def cookie(self) -> str:
        return self.headers["set-cookie"].split(";")[0]


async def application(scope: Any, receive: Any, send: Any) -> None:
    """Accept every request."""
    if scope["type"] == "websocket":
        await send({"type": "websocket.accept"})
    else:
        await PlainTextResponse("in")(scope, receive, send)


def gate_with(token: str | None = TOKEN, *, loopback: bool = False) -> AccessControl:
    return AccessControl(application, token=token, loopback=loopback, now_s=lambda: 0.0)


def ask(
    gate: AccessControl,
    *,
    method: str = "GET",
    path: str = "/",
    query: str = "",
    body: str = "",
    kind: str = "http",
    client: str = "10.0.0.1",
    endless: bool = False,
    **headers: str,
) -> Answer:
    """Send one request through access control."""
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
    reads = iter(range(6 if endless else 1))

    async def receive() -> dict[str, Any]:
        next(reads)  # not beyond the size limit
        return {"type": "http.request", "body": body.encode(), "more_body": endless}

    async def send(message: Any) -> None:
        messages.append(message)

    asyncio.run(gate(scope, receive, send))
    return Answer(messages)


@pytest.mark.parametrize(
    ("status", "words", "request_fields"),
    [
        *(
            (401, '<input name="token"', {"path": path})
            for path in ("/", "/live", "/stop", "/static/live.js")
        ),
        *(
            (403, "Wrong token.", fields)
            for sent in ("wrong-horse", TOKEN[:1], TOKEN[:-1], TOKEN + "x")
            for fields in (
                {"query": f"token={sent}"},
                {"method": "POST", "body": f"token={sent}"},
            )
        ),
        (403, "", {"method": "POST", "body": "token=".ljust(4096, "x")}),
        (413, "", {"method": "POST", "body": "token=".ljust(4097, "x")}),
        (413, "", {"method": "POST", "body": "x" * 1000, "endless": True}),
        (1008, "", {"kind": "websocket"}),
    ],
)
def test_request_without_the_token_is_refused(
    status: int, words: str, request_fields: dict[str, Any]
) -> None:
    answer = ask(gate_with(), **{"host": "robot:8080", **request_fields})
    assert answer.status == status
    assert words in answer.body


@pytest.mark.parametrize("token", [TOKEN, "пароль-яблоко-🍏"])
@pytest.mark.parametrize("method", ["GET", "POST"])
def test_correct_token_sets_an_http_only_cookie_that_grants_access(method: str, token: str) -> None:
    gate, robot = gate_with(token), {"host": "robot:8080"}
    sent = {"query" if method == "GET" else "body": f"token={quote(token)}"}
    answer = ask(gate, method=method, **sent, **robot)
    assert (answer.status, answer.headers["location"]) == (303, "/")
    set_cookie = answer.headers["set-cookie"]
    assert token not in set_cookie
    assert "HttpOnly" in set_cookie
    assert "samesite=lax" in set_cookie.lower()
    name, _, value = answer.cookie.partition("=")
    assert name == COOKIE
    inside = ask(gate, cookie=answer.cookie, **robot)
    assert (inside.status, inside.body) == (200, "in")
    # A cookie derived from the token could be used to verify guesses without throttling.
    known = hmac.new(token.encode(), b"palpate", "sha256").hexdigest()
    assert ask(gate_with(token), method=method, **sent, **robot).cookie != answer.cookie
    for wrong in (value[:-1], value[:8], value + "0", "", quote(token), known):
        assert ask(gate, cookie=f"{name}={wrong}", **robot).status == 401


@pytest.mark.parametrize("other", ["a/b=1", "\x00=;;", 'x="', COOKIE])
def test_foreign_cookies_neither_grant_nor_block_access(other: str) -> None:
    gate = gate_with()
    own = ask(gate, query=f"token={TOKEN}").cookie
    assert ask(gate, cookie=other).status == 401
    assert ask(gate, cookie=f"{other}; {own}").status == 200


def bearer(token: str) -> dict[str, Any]:
    return {"host": "robot:8080", "path": "/api/state", "authorization": f"Bearer {token}"}


@pytest.mark.parametrize("path", ["/api/stop", "/"])
def test_correct_token_is_never_refused_during_a_flood_of_wrong_ones(path: str) -> None:
    gate = gate_with()

    def answer_to(token: str) -> int:
        sent = {"query": f"token={token}"} if path == "/" else bearer(token) | {"method": "POST"}
        return ask(gate, **{"host": "robot:8080", **sent, "path": path}).status

    wrong = []
    for number in range(10 * MAX_WRONG_TOKENS):
        wrong.append(answer_to(f"guess-{number:08d}"))
        assert answer_to(TOKEN) == (303 if path == "/" else 200)
    assert wrong == [403] * MAX_WRONG_TOKENS + [429] * (9 * MAX_WRONG_TOKENS)
    assert ask(gate, **bearer("wrong-horse"), client="10.0.0.2").status == 403
    assert ask(gate, host="robot:8080", path="/api/stop", method="POST").status == 401


@pytest.mark.parametrize(
    ("status", "loopback", "headers"),
    [
        *(
            (403, loopback, {header: value})
            for loopback in (True, False)
            for header in ("host", "origin")
            for value in ("[::1", "[")
        ),
        *((403, True, {"host": host}) for host in ("evil.example:8080", "[fe80::1]:8080")),
        *((200, True, {"host": host}) for host in ("localhost:8080", "[::1]:8080", "[::1]")),
        *((403, True, {"origin": one, "method": "POST"}) for one in ("https://evil.ex", "null")),
        (200, True, {"origin": "http://127.0.0.1:8080"}),
        (1008, True, {"origin": "https://evil.example", "kind": "websocket"}),
        (None, True, {"origin": "http://127.0.0.1:8080", "kind": "websocket"}),
    ],
)
def test_request_with_a_foreign_or_malformed_host_or_origin_is_refused(
    status: int | None, loopback: bool, headers: dict[str, str]
) -> None:
    assert ask(gate_with(None, loopback=loopback), **headers).status == status


def test_every_response_has_the_security_headers() -> None:
    free = gate_with(None, loopback=True)
    for answer in (ask(free), ask(gate_with()), ask(free, origin="https://evil.example")):
        assert answer.headers["x-frame-options"] == "DENY"
        assert answer.headers["content-security-policy"] == "frame-ancestors 'none'"
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["referrer-policy"] == "same-origin"


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


def test_flood_of_refusals_is_logged_in_few_lines_with_the_number_of_the_others(
    caplog: pytest.LogCaptureFixture,
) -> None:
    clock = [0.0]
    refusals = RefusalLog(now_s=lambda: clock[0])
    for _ in range(100):
        refusals.record("HTTP 10.0.0.1", "wrong token")
    assert len(caplog.records) == MAX_REFUSALS_OF_CLIENT
    for number in range(1000):
        refusals.record(f"HTTP 10.1.0.{number}", "wrong token")
    assert len(caplog.records) == MAX_REFUSALS
    clock[0] = 60.1
    refusals.record("HTTP 10.0.0.1", "wrong token")
    omitted = 1000 - (MAX_REFUSALS - MAX_REFUSALS_OF_CLIENT)
    assert caplog.records[-1].audit[1] == f"refused: wrong token ({omitted} more refusals before)"
