"""Who may come in."""

from __future__ import annotations

import asyncio
import hmac
from typing import Any
from urllib.parse import quote

import pytest
from starlette.responses import PlainTextResponse

from palpate.dashboard.access import (
    CHECK_INTERVAL_S,
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
    """Say yes to everything."""
    if scope["type"] == "websocket":
        await send({"type": "websocket.accept"})
    else:
        await PlainTextResponse("in")(scope, receive, send)


class Waits:
    """A clock that stands still and records the length of each wait."""

    def __init__(self) -> None:
        self.waited_s: list[float] = []

    def now_s(self) -> float:
        return 0.0

    async def wait(self, seconds: float) -> None:
        self.waited_s.append(seconds)


def gate_with(token: str = TOKEN, *, waits: Waits | None = None) -> AccessControl:
    clock = waits or Waits()
    return AccessControl(
        application, token=token, loopback=False, now_s=clock.now_s, wait=clock.wait
    )


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
    """Send one request through a gate to an application that says yes to everything."""
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


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.7", "::", "robot.local"])
def test_address_beyond_the_loopback_needs_a_token(host: str) -> None:
    assert not is_loopback(host)
    with pytest.raises(InputError, match="give a --token"):
        check_token(host, None)
    check_token(host, TOKEN)


def test_token_on_the_loopback_is_optional_and_never_short() -> None:
    check_token("127.0.0.1", None)
    check_token("::1", None)
    with pytest.raises(InputError, match="has 3 characters; give at least 8"):
        check_token("127.0.0.1", "abc")
    check_token("127.0.0.1", "8letters")
    with pytest.raises(InputError, match="has 7 characters"):
        check_token("127.0.0.1", "7letter")


def test_a_visitor_without_the_token_is_asked_for_it() -> None:
    answer = ask(token=TOKEN, loopback=False, host="robot:8080")
    assert answer.status == 401
    assert '<input name="token"' in answer.body


@pytest.mark.parametrize("path", ["/live", "/stop", "/_nicegui/anything", "/static/live.js"])
def test_every_address_needs_the_token(path: str) -> None:
    assert ask(token=TOKEN, loopback=False, host="robot:8080", path=path).status == 401


def test_a_wrong_token_is_refused() -> None:
    for told in ({"query": "token=wrong-horse"}, {"method": "POST", "body": "token=wrong-horse"}):
        answer = ask(token=TOKEN, loopback=False, host="robot:8080", **told)
        assert answer.status == 403
        assert "not the token" in answer.body


@pytest.mark.parametrize(
    "told", [{"query": f"token={TOKEN}"}, {"method": "POST", "body": f"token={TOKEN}"}]
)
def test_the_right_token_is_remembered_by_a_cookie_that_scripts_cannot_read(
    told: dict[str, Any],
) -> None:
    gate = gate_with()
    answer = ask(gate=gate, host="robot:8080", **told)
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
    """A cookie that followed from the token would answer guesses without their limit."""
    cookies = set()
    for _ in range(2):
        gate = gate_with()
        answer = ask(gate=gate, host="robot:8080", query=f"token={TOKEN}")
        cookies.add(answer.headers["set-cookie"].split(";")[0])
        known = hmac.new(TOKEN.encode(), b"palpate", "sha256").hexdigest()
        assert ask(gate=gate, host="robot:8080", cookie=f"{COOKIE}={known}").status == 401
    assert len(cookies) == 2


@pytest.mark.parametrize("told", [TOKEN[:n] for n in range(1, len(TOKEN))] + [TOKEN + "x"])
def test_a_part_of_the_token_is_not_the_token(told: str) -> None:
    assert ask(token=TOKEN, loopback=False, host="robot:8080", query=f"token={told}").status == 403


def test_token_of_any_letters_is_accepted() -> None:
    token = "пароль-яблоко-🍏"
    gate = gate_with(token)
    answer = ask(gate=gate, host="robot:8080", method="POST", body=f"token={quote(token)}")
    assert answer.status == 303
    cookie = answer.headers["set-cookie"].split(";")[0]
    assert ask(gate=gate, host="robot:8080", cookie=cookie).status == 200


def test_endless_body_is_not_read() -> None:
    read = 0

    async def endless() -> dict[str, Any]:
        nonlocal read
        read += 1
        assert read < 100, "it goes on reading"
        return {"type": "http.request", "body": b"x" * 1000, "more_body": True}

    sent: list[Any] = []

    async def send(message: Any) -> None:
        sent.append(message)

    async def application(scope: Any, receive: Any, send: Any) -> None:
        raise AssertionError("nobody comes in")

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


def test_wrong_tokens_delay_their_visitor_alone() -> None:
    clock = [0.0]
    times_s = WrongTokens(now_s=lambda: clock[0])
    for _ in range(MAX_WRONG_TOKENS):
        assert not times_s.has_too_many("a")
        times_s.add("a")
    assert times_s.has_too_many("a")
    assert not times_s.has_too_many("b")
    clock[0] = 60.1
    assert not times_s.has_too_many("a")
    for number in range(5000):
        times_s.add(str(number))
    assert len(times_s._times_s) <= 1001


def bearer(token: str) -> dict[str, Any]:
    return {"host": "robot:8080", "path": "/api/state", "authorization": f"Bearer {token}"}


def test_right_token_after_wrong_ones_from_its_address_waits_a_turn_and_is_let_in() -> None:
    waits = Waits()
    gate = gate_with(waits=waits)
    for number in range(MAX_WRONG_TOKENS):
        wrong = bearer("wrong-horse") if number % 2 else {"query": "token=wrong-horse"}
        assert ask(gate=gate, **{"host": "robot:8080", **wrong}).status == 403
    for _ in range(20):
        assert ask(gate=gate, **bearer(TOKEN)).status == 200
    assert ask(gate=gate, host="robot:8080", query=f"token={TOKEN}").status == 303
    assert waits.waited_s == [], "a right one takes no turn"
    assert ask(gate=gate, **bearer("wrong-horse")).status == 403
    for _ in range(3):
        assert ask(gate=gate, **bearer(TOKEN)).status == 200
    assert waits.waited_s == [CHECK_INTERVAL_S] * 3
    assert ask(gate=gate, **bearer(TOKEN), client="10.0.0.2").status == 200
    assert len(waits.waited_s) == 3, "nobody else waits"


@pytest.mark.slow
def test_rapid_token_guesses_are_mostly_refused() -> None:
    waits = Waits()
    gate = gate_with(waits=waits)
    statuses = [ask(gate=gate, **bearer(f"guess-{n:08d}")).status for n in range(3000)]
    assert set(statuses) == {403, 429}
    # Ten, and then one a second: those that come while several wait are not compared.
    assert statuses.count(403) == MAX_WRONG_TOKENS + 5
    assert waits.waited_s == [1.0, 2.0, 3.0, 4.0]
    assert ask(gate=gate, **bearer(TOKEN)).status == 429


@pytest.mark.parametrize("token", [TOKEN, "wrong-horse"])
def test_stop_after_too_many_wrong_tokens_is_carried_out_without_a_wait(token: str) -> None:
    waits = Waits()
    gate = gate_with(waits=waits)
    stop = {**bearer(token), "path": "/api/stop", "method": "POST"}
    for _ in range(MAX_WRONG_TOKENS):
        assert ask(gate=gate, **(stop | bearer("wrong-horse"))).status == 403
    # The same answer for both: it says nothing about the token.
    assert [ask(gate=gate, **stop).status for _ in range(100)] == [200] * 100
    assert waits.waited_s == []
    without = {name: value for name, value in stop.items() if name != "authorization"}
    assert ask(gate=gate, **without).status == 401


def test_no_answer_can_be_framed_or_taken_for_another_type() -> None:
    for answer in (ask(), ask(token=TOKEN, loopback=False), ask(origin="https://evil.example")):
        assert answer.headers["x-frame-options"] == "DENY"
        assert answer.headers["content-security-policy"] == "frame-ancestors 'none'"
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["referrer-policy"] == "same-origin"


@pytest.mark.parametrize("header", ["host", "origin"])
@pytest.mark.parametrize("value", ["[::1", "[", "//[::1"])
@pytest.mark.parametrize("loopback", [True, False])
def test_a_malformed_address_is_refused(header: str, value: str, loopback: bool) -> None:
    status = ask(token=None, loopback=loopback, **{header: value}).status
    # Beyond the loopback any name of the host is as good as another.
    assert status == 403 or (value, header, loopback) == ("//[::1", "host", False)


def test_a_page_of_another_site_gets_nothing() -> None:
    assert ask(origin="http://127.0.0.1:8080").status == 200
    assert ask(origin="https://evil.example", method="POST", path="/stop").status == 403
    assert ask(origin="null", method="POST", path="/stop").status == 403


def test_a_socket_from_another_site_is_closed() -> None:
    assert ask(kind="websocket", origin="https://evil.example").status == 1008
    refused = ask(kind="websocket", token=TOKEN, loopback=False)
    assert (refused.kind, refused.status) == ("websocket.close", 1008)
    assert ask(kind="websocket", origin="http://127.0.0.1:8080").status is None


def test_a_foreign_name_that_points_at_the_loopback_gets_nothing() -> None:
    assert ask(host="evil.example:8080").status == 403
    assert ask(host="localhost:8080").status == 200
    assert ask(host="[::1]:8080").status == 200
    assert ask(host="[::1]").status == 200
    assert ask(host="[fe80::1]:8080").status == 403


@pytest.mark.parametrize("other", ["a/b=1", "\x00=;;", "=", ";", 'x="', COOKIE, "expires=x"])
def test_foreign_cookies_neither_grant_nor_block_access(other: str) -> None:
    gate = gate_with()
    inside = ask(gate=gate, query=f"token={TOKEN}").headers["set-cookie"]
    own = inside.split(";")[0]
    assert ask(gate=gate, cookie=other).status == 401
    assert ask(gate=gate, cookie=f"{other}; {own}").status == 200


@pytest.mark.parametrize(("length", "status"), [(4096, 403), (4097, 413)])
def test_form_is_read_up_to_the_length_limit(length: int, status: int) -> None:
    body = "token=".ljust(length, "x")
    assert ask(token=TOKEN, loopback=False, method="POST", body=body).status == status


def test_visitors_beyond_the_table_share_one_count() -> None:
    clock = [0.0]
    times_s = WrongTokens(now_s=lambda: clock[0])
    for number in range(999):
        times_s.add(str(number))
    for _ in range(MAX_WRONG_TOKENS):
        times_s.add("the last with a count of its own")
    assert times_s.has_too_many("the last with a count of its own")
    assert not times_s.has_too_many("one more")
    for number in range(MAX_WRONG_TOKENS):
        assert not times_s.has_too_many("one more")
        times_s.add(f"one more {number}")
    assert times_s.has_too_many("one more")
    assert not times_s.has_too_many("0")
    for _ in range(MAX_WRONG_TOKENS):
        times_s.add("0")
    assert times_s.has_too_many("0")
    clock[0] = 60.0
    assert times_s.has_too_many("0")
    clock[0] = 60.1
    assert not times_s.has_too_many("one more")
    assert not times_s.has_too_many("0")
