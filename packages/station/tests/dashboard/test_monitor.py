"""Health and metrics while results do not reach the plant."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import pytest
from packages.station.tests.dashboard.test_app_state import app_state_of
from packages.station.tests.dashboard.test_item_store import RESULT, place_and_add
from packages.station.tests.loop.test_line import free_port

from palpate.grasp.document import GraspDocument
from palpate_station.dashboard.monitor import Monitor
from palpate_station.mqtt.broker import Broker
from palpate_station.mqtt.publisher import Publisher


def wait_for(reached: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + 60.0
    while not reached():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


def samples(text: str) -> dict[str, float]:
    lines = (line.rsplit(" ", 1) for line in text.splitlines() if not line.startswith("#"))
    return {name: float(value) for name, value in lines}


def test_missing_broker_and_database_are_problems_of_a_station_that_can_grasp(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    where = f"postgresql://nobody@/items?host={tmp_path}"
    app_state = app_state_of(tmp_path, store=where)
    broker = Broker(host="127.0.0.1", port=free_port(), tls=False, topic="line-1")
    publisher = Publisher(broker, store=where, on_error=lambda line: None)
    publisher.start()
    monitor = Monitor(app_state, publisher)
    app_state.item_store.watch_shared()
    stopping = monitor.problems()
    stored = place_and_add(app_state.item_store, GraspDocument(result=RESULT, item_id="A17"))
    publisher.publish_result(stored)
    wait_for(lambda: app_state.item_store.shared_fault is not None)
    wait_for(lambda: app_state.item_store.waiting(publisher.receiver) == 1)
    wait_for(lambda: "does not answer" in publisher.fault)
    health = monitor.health()
    assert health["problems"] == [
        *stopping,
        "the shared store does not answer; records waiting in the local store: 1",
        "the broker does not answer; records waiting in the local store: 1",
    ]
    assert monitor.problems() == stopping, "they do not keep the station from grasping"
    found = samples(monitor.metrics())
    assert found["palpate_broker_connected"] == found["palpate_database_reachable"] == 0
    assert found['palpate_waiting_records{receiver="database"}'] == 1
    assert found['palpate_waiting_records{receiver="broker"}'] == 1
    assert 0 < found["palpate_database_last_answer_seconds"] < 120
    publisher.close()


def test_station_without_broker_and_shared_store_has_none_of_their_metrics(tmp_path: Path) -> None:
    app_state = app_state_of(tmp_path, store=str(tmp_path / "items.sqlite"))
    app_state.item_store.watch_shared()
    monitor = Monitor(app_state)
    assert monitor.delivery_problems() == []
    assert not any("broker" in name or "database" in name for name in samples(monitor.metrics()))
