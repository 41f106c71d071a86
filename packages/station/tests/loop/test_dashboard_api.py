"""The dashboard's HTTP interface on the twin: a grasp, a stop, results, refusals and a replay."""

from __future__ import annotations

import itertools
import json
import os
import re
import resource
import runpy
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, closing
from http.client import HTTPConnection
from pathlib import Path
from time import monotonic
from urllib.parse import urlsplit

import pytest
from benchmarks.dashboard import ROOT
from benchmarks.processes import children_of
from packages.station.tests.served_pages import (
    POLL_PERIOD_S,
    SIMULATED,
    Machine,
    run_server,
    serve_dashboard,
)
from tests.commands import Command
from tests.whole.test_json_schemas import faults

from palpate.grasp.plan import HOLD_S

TOKEN = "correct-horse"
RULES = 'default = "by hand"\n[[rule]]\nbin = "large"\nsize_mm = [30, 200]\n'


@pytest.fixture(scope="module")
def address(folder: Path) -> Iterator[str]:
    (folder / "rules.toml").write_text(RULES)
    with serve_dashboard(folder, *SIMULATED, "--rules", str(folder / "rules.toml")) as address:
        yield address


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, subprocess.Popen]]:
    """A server with a token, and its process, which the last test kills."""
    folder = tmp_path_factory.mktemp("guarded")
    with run_server(folder, *SIMULATED, PALPATE_TOKEN=TOKEN) as served:
        yield served


@pytest.fixture
def machine(address: str) -> Machine:
    """A client that is the driver of an idle rig with an open hand."""
    machine = Machine(address)
    machine.ask("PUT", "/driver")
    machine.ready()
    return machine


def test_api_grasp_is_held_released_and_stored_with_its_item(machine: Machine) -> None:
    status, grasp = machine.ask("POST", "/grasp", {"target_force_n": 2, "item_id": "berry-1"})
    assert status == 202
    status, refused = machine.ask("POST", "/grasp", {})
    assert (status, refused["detail"]) == (409, "grasping: wait, or press stop")
    state = machine.until(lambda at: at["phase"] == "hold" and at["answered"])
    assert faults("state", state) == []
    assert state["simulated"]
    assert machine.ask("POST", "/release") == (202, {"accepted": True})
    machine.until(lambda at: at["activity"] == "watching")
    status, result = machine.ask("GET", "/result")
    assert (status, result["outcome"], result["item_id"]) == (200, "held", "berry-1")
    assert result["recording"] == grasp["recording"]
    assert faults("grasp", result) == []
    assert result["item"] == {"id": "berry-1", "kind": None, "stage": None, "bruised": None}
    assert result["bin"]["name"] == "large"
    status, items = machine.ask("GET", "/items?limit=5")
    assert (status, faults("items", items)) == (200, [])
    status, item = machine.ask("GET", "/items/berry-1")
    assert (status, faults("item", item)) == (200, [])
    assert item["grasps"][0]["recording"].endswith(grasp["recording"])


def test_api_grasp_with_an_outdated_stop_count_is_refused(machine: Machine) -> None:
    known = machine.ask("GET", "/state")[1]["stops"]
    assert machine.ask("POST", "/stop") == (200, {"stopped": True})
    status, refused = machine.ask("POST", "/grasp", {"stops": known})
    assert (status, refused["detail"].startswith("refused: a stop")) == (409, True)
    state = machine.ask("GET", "/state")[1]
    assert (state["activity"], state["stops"]) == ("watching", known + 1)
    # A number that a client kept from before a restart may be larger.
    assert machine.ask("POST", "/grasp", {"stops": known + 50})[0] == 409
    assert machine.ask("POST", "/grasp", {"stops": state["stops"]})[0] == 202
    machine.until(lambda at: at["phase"] is not None)
    assert machine.ask("POST", "/stop") == (200, {"stopped": True})
    machine.until(lambda at: at["activity"] == "watching")
    assert machine.ask("POST", "/release")[0] == 202


def test_gateway_example_fills_its_registers(
    machine: Machine,
    address: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(sys, "argv", ["plc_gateway.py", address, "berry-2"])
    runpy.run_path(str(ROOT / "examples" / "plc_gateway.py"), run_name="__main__")
    found = re.search(r"registers 1 1 (\d+) (\d+) (-?\d+)", capsys.readouterr().out)
    size, force, stiffness = map(int, found.groups())
    assert 200 < size < 600
    assert 500 < force < 5000
    assert stiffness == -1 or stiffness > 0


@pytest.mark.parametrize(
    ("method", "path", "body", "status", "why"),
    [
        *(
            ("POST", "/grasp", body, 422, why)
            for body, why in (
                ({"target_force_n": 99}, "body.target_force_n: Input should be less than or equal"),
                (b'{"target_force_n": NaN}', "body.target_force_n: Input should be "),
                ({"force": 2}, "body.force: Extra inputs are not permitted"),
                ({"item_id": "\n"}, "item"),
                ({"kind": "kiwi"}, "kind kiwi: requires a damage file"),
                (b"{", "body.1: JSON decode error"),
                (b"[]", "body: must be a JSON object"),
                (b'{"item_id": "\xff"}', "body: not UTF-8 at byte 13"),
            )
        ),
        ("GET", "/items?limit=0", None, 422, "query.limit"),
        ("GET", "/items/no-such-item", None, 404, ""),
        ("GET", "/nowhere", None, 404, ""),
    ],
)
def test_api_refuses_invalid_input_in_one_line(
    machine: Machine, method: str, path: str, body: object, status: int, why: str
) -> None:
    found, refused = machine.ask(method, path, body)
    assert (found, list(refused)) == (status, ["detail"])
    assert refused["detail"].startswith(why)
    assert "\n" not in refused["detail"]
    assert machine.ask("GET", "/state")[1]["activity"] == "watching"


def test_api_refuses_a_body_without_its_header_by_the_name_of_the_header(address: str) -> None:
    for sent in ({}, {"Content-Type": "text/plain"}):
        connection = HTTPConnection(urlsplit(address).netloc, timeout=60.0)
        with closing(connection):
            connection.request("POST", "/api/grasp", b"{}", sent)
            reply = connection.getresponse()
            assert reply.status == 422
            assert "Content-Type: must be application/json" in json.loads(reply.read())["detail"]


def test_api_openapi_document_contains_the_published_schemas(machine: Machine) -> None:
    status, described = machine.ask("GET", "/openapi.json")
    assert status == 200
    assert set(described["paths"]) == {
        *("/state", "/grasp", "/release", "/stop", "/driver", "/health"),
        *("/result", "/items", "/items/{item_id}", "/epcis/{item_id}"),
    }
    known = described["components"]["schemas"]
    assert known["grasp"]["properties"]["force_n"]["anyOf"][0] == {
        "$ref": "#/components/schemas/measurement"
    }
    assert "ValidationError" not in json.dumps(described)


def test_replay_of_a_served_grasp_reproduces_the_stored_result(
    machine: Machine, folder: Path, palpate: Command
) -> None:
    machine.ask("POST", "/grasp", {"target_force_n": 2, "item_id": "berry-3"})
    machine.until(lambda at: at["phase"] == "hold" and at["answered"])
    # At ten times the speed, the hold is longer than with `palpate grasp`.
    polls = itertools.count()
    machine.until(lambda _: POLL_PERIOD_S * next(polls) > HOLD_S)
    machine.ask("POST", "/release")
    machine.ready()
    served_grasp = machine.ask("GET", "/result")[1]
    file, store = folder / "data" / served_grasp["recording"], folder / "items.sqlite"
    replayed = palpate("replay", file, "--json").document
    assert replayed.pop("recording") == str(file)
    assert replayed.pop("simulated") is True
    assert replayed == {name: served_grasp[name] for name in replayed}
    assert served_grasp["outcome"] == "held"
    (grasp,) = palpate("items", "berry-3", "--store", store, "--json").document["grasps"]
    for name in ("size_mm", "force_n", "stiffness_n_per_mm", "settled_percent", "firmness"):
        # The store contains numbers only, no bounds.
        is_number = replayed[name] is not None and replayed[name]["value"] is not None
        assert grasp["measurements"].get(name) == (replayed[name] if is_number else None)
    sort = ("sort", "--store", store, "--rules", folder / "rules.toml", "--json")
    bins = {item["item_id"]: item["bin"] for item in palpate(*sort).document["rows"]}
    assert bins["berry-3"] == served_grasp["bin"]["name"] == "large"


def test_api_with_a_token_requires_it_in_every_request(
    guarded: tuple[str, subprocess.Popen],
) -> None:
    address, _ = guarded
    machine = Machine(address, TOKEN)
    assert machine.ask("POST", "/stop") == (200, {"stopped": True}), "directly after the start"
    status, refused = Machine(address).ask("POST", "/stop")
    assert (status, "Bearer" in refused["detail"]) == (401, True)
    assert Machine(address, "wrong-horse").ask("GET", "/state")[0] == 403
    assert machine.ask("GET", "/openapi.json")[1]["security"] == [{"token": []}]
    assert machine.ask("GET", "/result")[0] == 404
    assert machine.ask("GET", "/items") == (200, {"items": []})


def test_stop_is_confirmed_despite_half_open_connections_and_a_killed_server_leaves_no_process(
    guarded: tuple[str, subprocess.Popen],
) -> None:
    (address, process), stop = guarded, ("POST", "/stop")
    host, machine = urlsplit(address), Machine(address, TOKEN)
    resource.prlimit(process.pid, resource.RLIMIT_NOFILE, (256, 256))
    with ExitStack() as held:
        for _ in range(300):
            half = held.enter_context(socket.create_connection((host.hostname, host.port)))
            half.sendall(b"POST /api/stop HTTP/1.1\r\nHost: ")
        assert machine.ask(*stop) == (200, {"stopped": True})
        children = children_of(process.pid)
        assert children
        process.kill()
        process.wait()
        deadline = monotonic() + 30.0
        while filter_running(children) and monotonic() < deadline:
            os.sched_yield()
        assert not filter_running(children)


def filter_running(pids: list[int]) -> list[int]:
    """Return the running processes, without zombies."""
    states = {pid: Path(f"/proc/{pid}/stat") for pid in pids}
    return [pid for pid, stat in states.items() if stat.exists() and " Z " not in stat.read_text()]
