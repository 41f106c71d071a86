"""A private MQTT broker for the tests, and a subscriber that keeps received messages."""

from __future__ import annotations

import json
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from queue import Queue
from typing import Any

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

#: Debian puts it where users have no path to.
PROGRAM = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")
TIMEOUT_S = 60.0


class BrokerProcess:
    """Mosquitto on a free loopback port, which can be killed, restarted and suspended."""

    def __init__(self, folder: Path, *, options: str = "allow_anonymous true") -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self._folder = folder
        # Subscriptions are saved as they change: without them, a killed broker would accept a
        # message before its subscriber has reconnected, and would not deliver it.
        (folder / "mosquitto.conf").write_text(
            f"listener {self.port} 127.0.0.1\nuser root\npersistence true\n"
            "autosave_on_changes true\nautosave_interval 1\n"
            f"persistence_location {folder}/\n{options}\n"
        )
        self.start()

    def start(self) -> None:
        assert PROGRAM is not None
        self._log = (self._folder / "log").open("ab")
        self._process = subprocess.Popen(
            [PROGRAM, "-c", str(self._folder / "mosquitto.conf")],
            stdout=self._log,
            stderr=self._log,
        )
        # A client that connects too early would wait for seconds before it tries again.
        give_up_s = time.monotonic() + TIMEOUT_S
        while time.monotonic() < give_up_s:
            with (
                suppress(ConnectionRefusedError),
                socket.create_connection(("127.0.0.1", self.port)),
            ):
                return
            time.sleep(0.01)
        raise AssertionError("the broker does not listen")

    def kill(self) -> None:
        """Kill it at once, with all messages acknowledged but not delivered."""
        self._process.kill()
        self._process.wait()
        self._log.close()

    def stop(self) -> None:
        """End it as a restart does: what it has acknowledged and not delivered is saved."""
        self._process.terminate()
        self._process.wait()
        self._log.close()

    def suspend(self) -> None:
        self._process.send_signal(signal.SIGSTOP)

    def resume(self) -> None:
        self._process.send_signal(signal.SIGCONT)


class Subscriber:
    """Receives all messages below a topic, in a session that the broker keeps."""

    def __init__(
        self,
        port: int,
        topic: str,
        *,
        ca: Path | None = None,
        username: str | None = None,
        password: str | None = None,
    ) -> None:
        self.received: Queue[tuple[str, Any, bool]] = Queue()
        #: All documents so far, by name.
        self.seen: list[tuple[str, Any]] = []
        self._subscribed: Queue[None] = Queue()
        self._client = paho.Client(
            CallbackAPIVersion.VERSION2, client_id="listener", clean_session=False
        )
        if ca is not None:
            self._client.tls_set(str(ca))
        self._client.username_pw_set(username, password)
        self._client.reconnect_delay_set(1, 1)
        self._client.on_connect = lambda client, *_: client.subscribe(f"{topic}/#", qos=1)
        self._client.on_subscribe = lambda *_: self._subscribed.put(None)
        self._client.on_message = self._receive
        self._client.connect_async("127.0.0.1", port)
        self._client.loop_start()
        self._subscribed.get(timeout=TIMEOUT_S)

    def _receive(self, client: object, data: object, message: paho.MQTTMessage) -> None:
        name = message.topic.rpartition("/")[2]
        document = json.loads(message.payload)
        self.seen.append((name, document))
        self.received.put((name, document, message.retain))

    def until(self, name: str, fits: Callable[[Any], bool] = lambda document: True) -> Any:
        """Return the next document of a topic that fits."""
        while True:
            topic, document, _ = self.received.get(timeout=TIMEOUT_S)
            if topic == name and fits(document):
                return document

    def close(self) -> None:
        self._client.disconnect()
        self._client.loop_stop()
