"""A thread that publishes to a broker which may not answer."""

from __future__ import annotations

import json
import os
import socket
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from palpate.errors import InputError, StoreError, require_extra
from palpate.mqtt.broker import Broker
from palpate.produce.store import Store

with require_extra("--mqtt", extra="mqtt"):
    import paho.mqtt.client as paho
    from paho.mqtt.enums import CallbackAPIVersion

#: At most this many results wait: a day of a grasp every nine seconds, about 30 MB. When one more
#: comes the oldest goes, and is counted.
MOST_WAITING = 10_000
#: A broker that is silent for one and a half times this is lost, and reconnected.
_KEEPALIVE_S = 10
_CONNECT_S, _SOONEST_S, _LATEST_S = 5.0, 1, 10
#: A broker that does not answer does not keep the program from ending.
_FAREWELL_S = 3.0


class Publisher:
    """Publishes documents; the caller never waits.

    A result is written to the outbox of the store first, and leaves it once the broker has
    acknowledged it. One is sent at a time, so that their order holds through every lost connection;
    a result whose receipt was lost comes twice.

    `store`: as `Store.open` takes it; results of an earlier run go first.
    `complain`: called with a line when the broker refuses, or the store fails; by a thread of its
        own.
    Raises `InputError` if a certificate can't be used.
    """

    def __init__(
        self,
        broker: Broker,
        *,
        store: str | Path | None,
        complain: Callable[[str], None],
    ) -> None:
        self._topic, self._where, self._complain = broker.topic, store, complain
        self._dropped = 0
        # Stations differ by their topic.
        self._receiver = f"mqtt {broker.topic}"
        self._calls: SimpleQueue[Callable[[Store], object] | None] = SimpleQueue()
        self._last_state: bytes | None = None
        self._link = _Link()
        self._client = self._connecting(broker)
        self._client.connect_async(broker.host, broker.port_or_usual, keepalive=_KEEPALIVE_S)
        self._client.loop_start()
        self._thread = threading.Thread(target=self._run, name="mqtt", daemon=True)
        self._thread.start()

    def result(self, document: Mapping[str, object]) -> None:
        """Publish a result, now or when the broker is there."""
        text = json.dumps(document, allow_nan=False)

        def queue(store: Store) -> None:
            self._dropped += store.add_message(text, receiver=self._receiver, most=MOST_WAITING)

        self._calls.put(queue)

    def state(self, document: Mapping[str, object]) -> None:
        """Publish the state, unless it is the one published last."""
        payload = _payload(document)
        if payload != self._last_state:
            self._last_state = payload
            self._calls.put(lambda _: self._link.show(payload))

    def close(self) -> None:
        """Disconnect; results that the broker did not acknowledge wait in the store."""
        self._calls.put(None)
        self._thread.join(_FAREWELL_S)

    # -- the thread -----------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            store = Store.open(self._where)
        except StoreError as error:
            self._complain(f"mqtt: {error}; results wait in memory alone")
            store = Store.open("sqlite://")
        try:
            while (call := self._calls.get()) is not None:
                try:
                    call(store)
                    self._send(store)
                except StoreError as error:
                    self._complain(f"mqtt: {error}; a result may be lost")
        finally:
            store.close()
            if self._link.is_up:
                self._publish("online", _OFFLINE)
            self._client.disconnect()
            self._client.loop_stop()

    def _greet(self, store: Store) -> None:
        self._link.is_up, self._link.is_state_sent = True, False
        self._publish("online", _payload({"online": True, "dropped": self._dropped}))

    def _lose(self, store: Store) -> None:
        self._link.is_up = False

    def _acknowledge(self, message: int, store: Store) -> None:
        link = self._link
        if link.sent is not None and message == link.sent[0]:
            store.remove_message(link.sent[1])
            link.sent = None
        elif message == link.state_message:
            link.state_message = None

    def _send(self, store: Store) -> None:
        """Hand the client what it may have: one result and one state at a time."""
        link = self._link
        if not link.is_up:
            return
        if link.state is not None and not link.is_state_sent and link.state_message is None:
            link.state_message, link.is_state_sent = self._publish("state", link.state), True
        waiting = None if link.sent is not None else store.oldest_message(self._receiver)
        if waiting is not None:
            number, text = waiting
            link.sent = self._publish("result", text.encode(), retain=False), number

    def _publish(self, name: str, payload: bytes, *, retain: bool = True) -> int:
        # The client sends it again when the connection comes back.
        return self._client.publish(f"{self._topic}/{name}", payload, qos=1, retain=retain).mid

    # -- the client, whose callbacks come from its own thread ------------------------------------

    def _connecting(self, broker: Broker) -> paho.Client:
        name = f"palpate-{socket.gethostname()}-{os.getpid()}"
        client = paho.Client(CallbackAPIVersion.VERSION2, client_id=name)
        client.connect_timeout = _CONNECT_S
        client.reconnect_delay_set(_SOONEST_S, _LATEST_S)
        client.will_set(f"{broker.topic}/online", _OFFLINE, qos=1, retain=True)
        if broker.username is not None:
            client.username_pw_set(broker.username, broker.password)
        if broker.tls:
            try:
                client.tls_set(broker.ca, broker.certificate, broker.key)
            except (OSError, ValueError) as error:
                raise InputError(f"--mqtt: its certificates can't be used: {error}") from error
        client.on_connect = self._on_connect
        client.on_disconnect = lambda *_: self._calls.put(self._lose)
        client.on_publish = lambda _client, _data, message, *_: self._calls.put(
            partial(self._acknowledge, message)
        )
        return client

    def _on_connect(self, client: Any, data: Any, flags: Any, reason: Any, more: Any) -> None:
        if reason.is_failure:
            self._complain(f"mqtt: the broker refuses: {reason}; look at username and password")
        else:
            self._calls.put(self._greet)


@dataclass(slots=True)
class _Link:
    """State of the connection, owned by the thread."""

    is_up: bool = False
    #: Numbers of the result that was sent: the client's and the outbox's.
    sent: tuple[int, int] | None = None
    state: bytes | None = None
    is_state_sent: bool = False
    state_message: int | None = None

    def show(self, state: bytes) -> None:
        """Take the newest state."""
        self.state, self.is_state_sent = state, False


def _payload(document: Mapping[str, object]) -> bytes:
    return json.dumps(document, allow_nan=False).encode()


_OFFLINE = _payload({"online": False})
