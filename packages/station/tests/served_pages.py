"""A served dashboard, a client of its HTTP interface, and what tests do on its pages."""

from __future__ import annotations

import json
import os
import re
import signal
import ssl
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from threading import Event
from typing import Any

from benchmarks.processes import children_of
from playwright.sync_api import Browser, Page, ViewportSize, expect

STRAWBERRY = ("--object", "strawberry", "--seed", "3")
#: Few frames a second, because simulated time runs faster than real time.
SIMULATED = ("--rig", "sim-rigid", *STRAWBERRY, "--speed", "10", "--rate-hz", "15")
#: For steps during a hold, which ends by itself after 60 s of simulated time.
SLOWER = ("--speed", "3")
SERVE = (sys.executable, "-W", "error", "-c", "from palpate.cli import main; main()", "serve")
#: Timeout of the pages, milliseconds; an idle machine requires one or two seconds.
TIMEOUT_MS = 60_000
#: Polling period of the state, and maximum number of polls.
POLL_PERIOD_S, MAX_POLLS = 0.02, 5000
WIDE: ViewportSize = {"width": 1280, "height": 800}
PHONE: ViewportSize = {"width": 390, "height": 844}
#: Labels of fields; that of the item has a hint if it is empty.
ITEM = re.compile(r"^Item(:|$)")
TARGET = "Target force, N (empty: a gentle squeeze)"


@contextmanager
def serve_dashboard(folder: Path, *options: str, **environment: str) -> Iterator[str]:
    """Serve a dashboard; yield its URL."""
    with run_server(folder, *options, **environment) as (address, _):
        yield address


@contextmanager
def run_server(
    folder: Path, *options: str, **environment: str
) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Serve a dashboard; yield its URL and process."""
    command = [*SERVE, "--port", "0", "--folder", str(folder / "data"), *options]
    command += ["--store", str(folder / "items.sqlite")]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, cwd=folder, env=os.environ | environment
    ) as process:
        try:
            found = re.search(r"https?://\S+", process.stdout.readline())
            assert found is not None, "the server did not start"
            yield found[0], process
        finally:
            process.terminate()


def write_users(folder: Path) -> tuple[str, str]:
    """Write maria, who may operate, and screen, who may watch; return the option."""
    users = folder / "users.toml"
    users.write_text(
        '[maria]\ntoken = "marias-token"\nrole = "operate"\n'
        '[screen]\ntoken = "screens-token"\nrole = "view"\n'
    )
    users.chmod(0o600)
    return "--users", str(users)


def write_certificate(folder: Path) -> None:
    """Write `certificate.pem` and `key.pem` of this machine, signed by itself."""
    command = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2"]
    command += ["-keyout", "key.pem", "-out", "certificate.pem", "-subj", "/CN=127.0.0.1"]
    command += ["-addext", "subjectAltName=IP:127.0.0.1"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)


def kill_devices(server: subprocess.Popen[str]) -> None:
    """Kill the device process of a server."""
    for child in children_of(server.pid):
        if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
            os.kill(child, signal.SIGKILL)


class Machine:
    """A minimal client, such as a gateway."""

    def __init__(
        self, address: str, token: str | None = None, *, trusted: ssl.SSLContext | None = None
    ) -> None:
        self._address, self._token, self._trusted = address, token, trusted

    def ask(self, method: str, path: str, body: object = None) -> tuple[int, Any]:
        data = body if isinstance(body, bytes) else None if body is None else json.dumps(body)
        request = urllib.request.Request(
            f"{self._address}api{path}",
            method=method,
            data=data.encode() if isinstance(data, str) else data,
            headers={"Content-Type": "application/json"}
            | ({"Authorization": f"Bearer {self._token}"} if self._token else {}),
        )
        try:
            with urllib.request.urlopen(
                request, timeout=TIMEOUT_MS / 1000, context=self._trusted
            ) as reply:
                text = reply.read()
                return reply.status, json.loads(text) if text else None
        except urllib.error.HTTPError as refused:
            return refused.code, json.loads(refused.read())

    def until(self, reached: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        for _ in range(MAX_POLLS):
            state: dict[str, Any] = self.ask("GET", "/state")[1]
            if reached(state):
                return state
            Event().wait(POLL_PERIOD_S)
        raise AssertionError(f"the state stayed {state}")

    def ready(self) -> None:
        self.until(lambda at: at["activity"] == "watching" and at["fresh"] and at["hand_open"])

    def grasp_and_release(self, item_id: str) -> dict[str, Any]:
        """Grasp an item, release it when it is held, and return the result."""
        self.ready()
        assert self.ask("POST", "/grasp", {"item_id": item_id})[0] == 202
        self.until(lambda at: at["state"] == "holding")
        assert self.ask("POST", "/release")[0] == 202
        self.ready()
        result: dict[str, Any] = self.ask("GET", "/result")[1]
        return result

    def leave_hand_open(self) -> None:
        """End what a failed test has left: a running job and a closed hand."""
        state = self.ask("GET", "/state")[1]
        if state["activity"] == "watching" and state["hand_open"] is not False:
            return
        self.ask("PUT", "/driver")
        self.ask("POST", "/stop")
        self.until(lambda at: at["activity"] in ("watching", "no rig"))
        self.ask("POST", "/release")
        self.ready()
        self.ask("DELETE", "/driver")


@contextmanager
def visit(
    browser: Browser, url: str, *, viewport: ViewportSize = WIDE, **options: Any
) -> Iterator[Page]:
    """Open a page in a context of its own, as another viewer."""
    context = browser.new_context(viewport=viewport, locale="en-US", **options)
    with closing(context):
        page = context.new_page()
        page.set_default_timeout(TIMEOUT_MS)
        page.goto(url)
        yield page


@contextmanager
def visit_as_driver(browser: Browser, url: str, **options: Any) -> Iterator[Page]:
    """Open a page as the driver of a rig that sends frames."""
    with visit(browser, url, **options) as page:
        expect_fresh_link(page)
        drive(page)
        yield page


def drive(page: Page) -> None:
    """Take control, unless the page already has it or gets it just before the click."""
    page.evaluate(
        "() => { const take = document.getElementById('take-over');"
        " if (take.checkVisibility()) take.click(); }"
    )
    expect(page.locator("#take-over")).to_be_hidden()


def expect_fresh_link(page: Page) -> None:
    expect(page.locator("#link")).to_have_attribute("data-state", "fresh")


def expect_verdict(page: Page, words: str | re.Pattern[str]) -> None:
    expect(page.locator("#verdict-text")).to_have_text(words)


def expect_enabled(page: Page, button: str) -> None:
    expect(page.locator(button)).to_be_enabled()


def open_tab(page: Page, name: str) -> None:
    page.get_by_role("tab", name=name).click()


def start_grasp(page: Page) -> None:
    expect_enabled(page, "#grasp")
    page.locator("#grasp").click()


def grasp(page: Page) -> None:
    start_grasp(page)
    expect_verdict(page, "holding")


def release(page: Page) -> None:
    page.locator("#release").click()
    expect_enabled(page, "#grasp")


def wait_for_draws(page: Page, count: int) -> None:
    """Wait until the page has been drawn a number of times more."""
    drawn = page.evaluate("+document.body.dataset.drawn")
    page.wait_for_function("(least) => +document.body.dataset.drawn > least", arg=drawn + count)
