"""A station that runs unattended: health, metrics, log, audit, retention and versioned API."""

from __future__ import annotations

import asyncio
import json
import os
import re
import ssl
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
from asyncua import Client, ua
from packages.station.tests.epcis import read_epcis
from packages.station.tests.loop.test_line import OpcUa, free_port
from packages.station.tests.served_pages import (
    SIMULATED,
    Machine,
    kill_devices,
    run_server,
    write_certificate,
    write_users,
)
from tests.whole.test_json_schemas import faults

OLD = "grasp-20260101-080000.mcap"


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Machine, str, Path]]:
    folder = tmp_path_factory.mktemp("unattended")
    (folder / "data").mkdir()
    for name in (OLD, "kept.mcap", "grasp-20260101-080001.mcap"):
        (folder / "data" / name).write_bytes(b"")
    for name in (OLD, "kept.mcap"):
        os.utime(folder / "data" / name, (0, 0))
    options = ("--keep-days", "30", "--station", "4012345000009")
    with run_server(folder, *SIMULATED, *options) as (address, _):
        machine = Machine(address)
        machine.ready()
        yield machine, address, folder / "data"


def read_metrics(address: str) -> dict[str, float]:
    with urllib.request.urlopen(f"{address}metrics", timeout=60) as reply:
        assert reply.headers["content-type"].startswith("text/plain; version=0.0.4")
        lines = reply.read().decode().splitlines()
    samples = (line.rsplit(" ", 1) for line in lines if not line.startswith("#"))
    found = {name: float(value) for name, value in samples}
    described = {line.split()[2] for line in lines if line.startswith("# TYPE")}
    assert {re.sub(r"\{.*", "", name) for name in found} == described
    return found


def test_health_and_metrics_follow_a_grasp_over_the_versioned_path(
    served: tuple[Machine, str, Path],
) -> None:
    machine, address, _ = served
    status, health = machine.ask("GET", "/v1/health")
    assert (status, health["healthy"], health["problems"]) == (200, True, [])
    before = read_metrics(address)
    assert machine.ask("POST", "/v1/grasp", {"item_id": "A1"})[0] == 202
    machine.until(lambda at: at["state"] == "holding")
    assert machine.ask("POST", "/v1/release")[0] == 202
    machine.ready()
    assert machine.ask("POST", "/v1/stop") == (200, {"stopped": True})
    after = read_metrics(address)
    changed = {name: after[name] - before[name] for name in after if name.count("_total")}
    assert changed['palpate_grasps_total{outcome="held"}'] == 1
    assert changed['palpate_grasps_stored_total{stored="true"}'] == 1
    assert changed["palpate_stops_total"] == 1
    assert (after["palpate_healthy"], after["palpate_state"]) == (1, 1)


def test_item_stated_and_labelled_over_http_is_stored_with_its_station(
    served: tuple[Machine, str, Path],
) -> None:
    machine, _, folder = served
    result = machine.grasp_and_release("B1")
    assert result["station"] == machine.ask("GET", "/state")[1]["station"] == "4012345000009"
    stated = {"kind": "avocado", "batch": "Montag-Früh", "labels": {"ripeness": "ripe"}}
    status, item = machine.ask("PATCH", "/items/B1", stated)
    assert (status, faults("item", item)) == (200, [])
    assert (item["item"]["kind"], item["item"]["batch"]) == ("avocado", "Montag-Früh")
    assert item["grasps"][0]["station"] == "4012345000009"
    (label,) = item["verdicts"]
    assert (label["about"], label["text"], label["source"]) == ("ripeness", "ripe", "person")
    assert label["details"] == {"by": "HTTP 127.0.0.1"}
    assert label["grasp_id"] == item["grasps"][0]["grasp_id"]
    assert machine.ask("GET", "/items/B1") == (200, item)
    (event,) = read_epcis(machine.ask("GET", "/epcis/B1")[1])
    assert event["readPoint"] == {"id": "https://id.gs1.org/414/4012345000009"}
    assert "label B1" in (folder / "audit.jsonl").read_text()
    for wrong in ({"labels": {"taste": "good"}}, {"labels": {"bin": ""}}, {"colour": "red"}):
        assert machine.ask("PATCH", "/items/B1", wrong)[0] == 422


def test_audit_file_tells_who_drove_and_stopped(served: tuple[Machine, str, Path]) -> None:
    machine, _, folder = served
    machine.ask("PUT", "/driver")
    assert machine.ask("POST", "/stop") == (200, {"stopped": True})
    machine.ask("DELETE", "/driver")
    deadline_s = time.monotonic() + 30.0
    lines: list[dict[str, str]] = []
    while time.monotonic() < deadline_s and not (lines and lines[-1]["what"] == "stops driving"):
        lines = [json.loads(line) for line in (folder / "audit.jsonl").read_text().splitlines()]
    events = [(one["who"], one["what"]) for one in lines]
    assert ("HTTP 127.0.0.1", "drives") in events
    assert events[-2:] == [("HTTP 127.0.0.1", "stop"), ("HTTP 127.0.0.1", "stops driving")]


def test_old_recordings_are_deleted_but_renamed_and_new_ones_are_kept(
    served: tuple[Machine, str, Path],
) -> None:
    _, _, folder = served
    found = {file.name for file in folder.glob("*.mcap")}
    assert OLD not in found
    assert {"kept.mcap", "grasp-20260101-080001.mcap"} <= found


def test_station_without_devices_is_not_healthy_and_ends(tmp_path: Path) -> None:
    with run_server(tmp_path, *SIMULATED, "--exit-after", "10") as (address, process):
        machine = Machine(address)
        machine.ready()
        kill_devices(process)
        machine.until(lambda at: at["activity"] == "gone")
        status, health = machine.ask("GET", "/health")
        assert (status, health["healthy"]) == (503, False)
        assert "restart palpate serve" in health["problems"][0]
        assert process.wait(timeout=60) == 3


def test_https_users_act_within_their_roles_and_under_their_names(tmp_path: Path) -> None:
    write_certificate(tmp_path)
    opcua_port = free_port()
    options = ("--certificate", "certificate.pem", "--key", "key.pem", "--opcua", str(opcua_port))
    with run_server(tmp_path, *SIMULATED, *write_users(tmp_path), *options) as (address, _):
        assert address.startswith("https://")
        trusted = ssl.create_default_context(cafile=str(tmp_path / "certificate.pem"))
        maria = Machine(address, "marias-token", trusted=trusted)
        screen = Machine(address, "screens-token", trusted=trusted)
        maria.ready()
        assert Machine(address, trusted=trusted).ask("GET", "/state")[0] == 401
        assert screen.ask("GET", "/v1/state")[1]["state"] == "idle"
        assert screen.ask("POST", "/grasp", {}) == (
            403,
            {"detail": "screen may only watch and stop"},
        )
        assert maria.ask("POST", "/grasp", {})[0] == 202
        assert screen.ask("GET", "/state")[1]["driver_name"] == "maria"
        assert screen.ask("POST", "/stop") == (200, {"stopped": True})
        maria.until(lambda at: at["activity"] == "watching")
        assert maria.ask("DELETE", "/driver")[0] == 204
        assert Machine(address, "guess", trusted=trusted).ask("GET", "/state")[0] == 403

        async def drive_over_opcua(password: str, *, user: str = "maria") -> str:
            client = Client(f"opc.tcp://127.0.0.1:{opcua_port}/palpate")
            client.set_user(user)
            client.set_password(password)
            client.application_uri = "urn:example:client"
            await client.set_security_string(
                f"Basic256Sha256,SignAndEncrypt,{tmp_path}/data/opcua-certificate.der,"
                f"{tmp_path}/data/opcua-key.pem"
            )
            async with client:
                await OpcUa(client).call("TakeOver")
                driver: str = await OpcUa(client).value("Driver")
                return driver

        wrong = (("maria", "guess"), ("screen", "screens-token"), ("mario", "marias-token"))
        for user, password in wrong:
            with pytest.raises((ua.UaError, ConnectionError, asyncio.TimeoutError)):
                asyncio.run(drive_over_opcua(password, user=user))
        assert asyncio.run(drive_over_opcua("marias-token")) == "maria"
        wanted = {
            ("maria", "grasp"),
            ("screen", "stop"),
            ("screen", "refused: POST '/api/grasp', role view"),
            ("HTTP 127.0.0.1", "refused: wrong token"),
            ("OPC UA 127.0.0.1", "refused: login as 'maria', wrong password"),
            ("OPC UA 127.0.0.1", "refused: login as 'screen', role view"),
            ("OPC UA 127.0.0.1", "refused: login as 'mario', unknown user"),
        }
        deadline_s, audit = time.monotonic() + 30.0, tmp_path / "data" / "audit.jsonl"
        events = set[tuple[str, str]]()
        while not wanted <= events:
            assert time.monotonic() < deadline_s, wanted - events
            lines = [json.loads(line) for line in audit.read_text().splitlines()]
            events = {(one["who"], one["what"]) for one in lines}
        assert ("OPC UA 127.0.0.1", "drives") not in events


def test_simulated_line_brings_a_new_object_unless_the_item_is_grasped_again(
    served: tuple[Machine, str, Path],
) -> None:
    machine, _, _ = served
    sizes_mm = {}
    for number, item in enumerate(("", "", "C1", "C1", "C2")):
        sizes_mm[number, item] = machine.grasp_and_release(item)["truth"]["size_mm"]
    assert sizes_mm[2, "C1"] == sizes_mm[3, "C1"]
    assert len(set(sizes_mm.values())) == 4
