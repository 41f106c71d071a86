"""Results over MQTT with a real broker that ends, hangs or requires a password."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from itertools import groupby, pairwise
from pathlib import Path
from queue import Queue
from urllib.parse import urlsplit

import pytest
from packages.station.tests.loop.test_line import free_port
from packages.station.tests.mosquitto import PROGRAM, TIMEOUT_S, BrokerProcess, Subscriber
from packages.station.tests.served_pages import (
    SERVE,
    SIMULATED,
    Machine,
    run_server,
    write_certificate,
)
from tests.fixtures import skip
from tests.whole.test_json_schemas import faults

from palpate.grasp.document import GraspDocument
from palpate.grasp.result import GraspResult, Outcome
from palpate_station.mqtt.broker import Broker, read_broker
from palpate_station.mqtt.publisher import Publisher

TOPIC = "palpate/line-1"


@pytest.fixture(autouse=True)
def mosquitto_installed() -> None:
    if PROGRAM is None:
        skip("no MQTT broker; install it (Debian: mosquitto)")


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[BrokerProcess]:
    folder = tmp_path / "broker"
    folder.mkdir()
    running = BrokerProcess(folder)
    yield running
    running.resume()
    running.kill()


@pytest.fixture
def subscriber(broker: BrokerProcess) -> Iterator[Subscriber]:
    listening = Subscriber(broker.port, TOPIC)
    yield listening
    listening.close()


def broker_file(folder: Path, port: int) -> str:
    file = folder / "broker.toml"
    file.write_text(f'host = "127.0.0.1"\nport = {port}\ntls = false\ntopic = "{TOPIC}"\n')
    return str(file)


def publisher_to(
    broker: BrokerProcess, folder: Path, complaints: Queue[str] | None = None
) -> Publisher:
    plain = Broker(host="127.0.0.1", port=broker.port, tls=False, topic=TOPIC)
    on_error = (Queue() if complaints is None else complaints).put
    publisher = Publisher(plain, store=folder / "items.sqlite", on_error=on_error)
    publisher.start()
    return publisher


def numbered(number: int) -> GraspDocument:
    return GraspDocument(result=GraspResult(outcome=Outcome.HELD, frames=number))


def numbers(documents: list[dict[str, int]]) -> list[int]:
    """Return the numbers in order; unacknowledged results may arrive twice."""
    return list(dict.fromkeys(document["frames"] for document in documents))


def test_served_grasps_and_stops_with_a_hanging_or_missing_broker_are_not_delayed(
    broker: BrokerProcess, subscriber: Subscriber, tmp_path: Path
) -> None:
    with run_server(tmp_path, *SIMULATED, "--mqtt", broker_file(tmp_path, broker.port)) as (
        address,
        process,
    ):
        machine = Machine(address)
        subscriber.until("online", lambda content: content["online"])
        machine.ready()
        assert machine.ask("POST", "/grasp", {"item_id": "berry-7"})[0] == 202
        state = subscriber.until("state", lambda at: at["phase"] == "hold")
        assert faults("state", state) == []
        assert machine.ask("POST", "/release")[0] == 202
        result = subscriber.until("result")
        assert faults("grasp", result) == []
        assert result == machine.ask("GET", "/result")[1]
        # A later subscriber receives the retained state, but no result.
        late = Subscriber(broker.port, TOPIC)
        assert late.until("online") == {"online": True, "dropped": 0}
        assert set(late.until("state")) == set(state)
        late.close()
        recordings = []
        for number, trouble in enumerate((broker.suspend, broker.kill, broker.start)):
            machine.ready()
            if number == 2:
                trouble()
            recordings.append(machine.ask("POST", "/grasp", {})[1]["recording"])
            machine.until(lambda at: at["answered"])
            if number < 2:
                trouble()
            assert machine.ask("POST", "/stop") == (200, {"stopped": True})
            state = machine.until(lambda at: at["activity"] == "watching")
            assert 0 <= state["stopped_after_s"] < 0.2
            assert machine.ask("POST", "/release")[0] == 202
        found: list[str] = []
        while len(found) < 3:
            found = list(dict.fromkeys([*found, subscriber.until("result")["recording"]]))
        assert found == recordings
        process.send_signal(signal.SIGKILL)
        subscriber.until("online", lambda content: content == {"online": False})  # the last will


def test_mqtt_state_is_published_once_for_each_change_with_the_held_object(
    broker: BrokerProcess, subscriber: Subscriber, tmp_path: Path
) -> None:
    with run_server(tmp_path, *SIMULATED, "--mqtt", broker_file(tmp_path, broker.port)) as (
        address,
        _,
    ):
        machine = Machine(address)
        machine.ready()
        assert machine.ask("POST", "/grasp", {"item_id": "berry-8"})[0] == 202
        # A hold that ends between two messages would not be published.
        subscriber.until("state", lambda at: at["state"] == "holding")
        assert machine.ask("POST", "/release")[0] == 202
        result = subscriber.until("result", lambda _: True)
        machine.ready()
        subscriber.until("state", lambda at: at["state"] == "idle")
    states = [document for name, document in subscriber.seen if name == "state"]
    assert all(before != after for before, after in pairwise(states))
    names = [name for name, _ in groupby(at["state"] for at in states)]
    assert [name for name in names if name in ("holding", "idle")][-2:] == ["holding", "idle"]
    held = [at["held"] for at in states if at["held"] is not None]
    assert held[-1]["item_id"] == "berry-8"
    assert held[-1]["size_mm"] == result["size_mm"]


@pytest.mark.parametrize(
    "first", [300, 1], ids=["stopped while receiving", "killed before receiving"]
)
def test_mqtt_results_arrive_in_order_after_a_broker_outage(
    broker: BrokerProcess, subscriber: Subscriber, tmp_path: Path, first: int
) -> None:
    publisher = publisher_to(broker, tmp_path)
    for number in range(first):
        publisher.publish_result(numbered(number))
    results = [subscriber.until("result") for _ in range(min(first, 5))]
    broker.stop() if first > 1 else broker.kill()
    assert results[-1]["frames"] < 299, "the outage must precede most results"
    for number in range(first, 300):
        publisher.publish_result(numbered(number))
    broker.start()
    while results[-1]["frames"] < 299:
        results.append(subscriber.until("result"))
    assert numbers(results) == list(range(300))
    publisher.close()


def test_mqtt_results_queued_at_exit_are_sent_first_in_the_next_run(
    broker: BrokerProcess, subscriber: Subscriber, tmp_path: Path
) -> None:
    first = publisher_to(broker, tmp_path)
    subscriber.until("online")
    broker.suspend()
    for number in range(3):
        first.publish_result(numbered(number))
    first.close()
    broker.kill()
    broker.start()
    second = publisher_to(broker, tmp_path)
    second.publish_result(numbered(3))
    results = [subscriber.until("result") for _ in range(4)]
    assert numbers(results) == [0, 1, 2, 3]
    second.close()
    assert subscriber.until("online", lambda content: not content["online"]) == {"online": False}


def test_mqtt_station_stays_online_when_a_second_server_finds_its_port_in_use(
    broker: BrokerProcess, subscriber: Subscriber, tmp_path: Path
) -> None:
    modbus, mqtt = str(free_port()), ("--mqtt", broker_file(tmp_path, broker.port))
    with run_server(tmp_path, *SIMULATED, "--modbus", modbus, *mqtt) as (address, _):
        subscriber.until("online", lambda content: content["online"])
        for taken in (("--port", str(urlsplit(address).port)), ("--port", "0", "--modbus", modbus)):
            again = [*SERVE, *SIMULATED, *mqtt, *taken]
            refused = subprocess.run(again, cwd=tmp_path, capture_output=True, timeout=TIMEOUT_S)
            assert b"in use" in refused.stderr
            late = Subscriber(broker.port, TOPIC)
            assert late.until("online")["online"]
            late.close()
    assert [one for name, one in subscriber.seen if name == "online" and not one["online"]] == []


def test_mqtt_station_is_online_again_after_another_client_of_its_topic_has_ended(
    broker: BrokerProcess, subscriber: Subscriber, tmp_path: Path
) -> None:
    first, second = (publisher_to(broker, tmp_path) for _ in range(2))
    for _ in range(2):
        subscriber.until("online", lambda content: content["online"])
    second.close()
    subscriber.until("online", lambda content: not content["online"])
    subscriber.until("online", lambda content: content["online"])
    first.close()


def test_mqtt_unusable_store_is_reported_and_results_are_still_sent(
    broker: BrokerProcess, subscriber: Subscriber, tmp_path: Path
) -> None:
    complaints: Queue[str] = Queue()
    (tmp_path / "items.sqlite").write_bytes(b"not a database" * 100)
    publisher = publisher_to(broker, tmp_path, complaints)
    publisher.publish_result(numbered(1))
    assert subscriber.until("result")["frames"] == 1
    assert "unsent results are kept in memory only" in complaints.get(timeout=TIMEOUT_S)
    publisher.close()


# The client leaves the socket of a failed handshake to the garbage collector.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_mqtt_broker_without_tls_is_reported_as_one_that_answers(
    broker: BrokerProcess, tmp_path: Path
) -> None:
    told: Queue[str] = Queue()
    encrypted = Broker(host="127.0.0.1", port=broker.port, topic=TOPIC)
    publisher = Publisher(encrypted, store=tmp_path / "items.sqlite", on_error=told.put)
    publisher.start()
    assert "answers, but not with TLS" in told.get(timeout=TIMEOUT_S)
    publisher.close()


def test_mqtt_outage_of_the_broker_is_reported_once_and_so_is_its_return(
    broker: BrokerProcess, tmp_path: Path
) -> None:
    plain = Broker(host="127.0.0.1", port=broker.port, tls=False, topic=TOPIC)
    told: Queue[str] = Queue()
    broker.kill()
    publisher = Publisher(
        plain, store=tmp_path / "items.sqlite", on_error=told.put, on_return=told.put
    )
    publisher.start()
    assert "does not answer; results wait" in told.get(timeout=TIMEOUT_S)
    for _ in range(2):
        broker.start()
        assert "answers again" in told.get(timeout=TIMEOUT_S)
        broker.stop()
        assert "does not answer" in told.get(timeout=TIMEOUT_S)
    publisher.close()
    broker.start()
    assert told.empty()


def test_mqtt_connects_with_tls_and_password(tmp_path: Path) -> None:
    write_certificate(tmp_path)
    password = ["mosquitto_passwd", "-b", "-c", "passwords", "line-1", "sesame"]
    subprocess.run(password, cwd=tmp_path, check=True, capture_output=True)
    broker = BrokerProcess(
        tmp_path,
        options=f"certfile {tmp_path}/certificate.pem\nkeyfile {tmp_path}/key.pem\n"
        f"password_file {tmp_path}/passwords\nallow_anonymous false",
    )
    file = tmp_path / "broker.toml"
    file.write_text(
        f'host = "127.0.0.1"\nport = {broker.port}\ntopic = "{TOPIC}"\nca = "certificate.pem"\n'
        'username = "line-1"\n'
    )
    listening = Subscriber(
        broker.port, TOPIC, ca=tmp_path / "certificate.pem", username="line-1", password="sesame"
    )
    for password in ("guess", "sesame"):
        complaints: Queue[str] = Queue()
        asked = read_broker(file, environment={"PALPATE_MQTT_PASSWORD": password})
        publisher = Publisher(asked, store=tmp_path / "items.sqlite", on_error=complaints.put)
        publisher.start()
        publisher.publish_result(replace(numbered(1), item_id=password))
        if password == "guess":
            assert "check username and password" in complaints.get(timeout=TIMEOUT_S)
        else:
            # The result that could not be sent with the wrong password was queued.
            assert listening.until("result")["item_id"] == "guess"
            assert listening.until("result")["item_id"] == "sesame"
        publisher.close()
    listening.close()
    broker.kill()
