"""Publish documents to a broker from a background thread."""

from __future__ import annotations

import json
import math
import socket
import ssl
import sys
import threading
import time
import uuid
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from palpate.errors import InputError, StoreError, require_extra
from palpate.grasp.document import GraspDocument
from palpate_station.mqtt.broker import Broker
from palpate_station.store import Store

with require_extra("--mqtt", extra="mqtt", package="palpate-station"):
    import paho.mqtt.client as paho
    from paho.mqtt.enums import CallbackAPIVersion

#: Maximum number of queued results, enough for a day with a grasp every nine seconds (about 30 MB).
#: Beyond this limit the oldest result is dropped and counted.
MAX_QUEUED_RESULTS = 10_000
#: Keepalive period, seconds. Without an answer, the broker publishes the last will after one and a
#: half periods, and the client reconnects after two.
_KEEPALIVE_S = 10
#: Period at which a connected publisher repeats that it is online, seconds: since then another
#: client of the topic may have ended, or the broker have published an older connection's last will.
_ONLINE_PERIOD_S = 10.0
_CONNECT_TIMEOUT_S, _MIN_RECONNECT_S, _MAX_RECONNECT_S = 5.0, 1, 10
#: Maximum time that `close` waits for the thread, seconds.
_CLOSE_TIMEOUT_S = 3.0


class Publisher:
    """Publisher of documents, which never blocks the caller; it connects with `start`.

    Each result is queued in the store's outbox until the broker acknowledges it. Only one result is
    in flight at a time, which preserves the order across lost connections. A result is sent twice
    if its acknowledgement was lost.

    `store`: path or URL for `Store.open`; queued results of an earlier run are sent first.
    `on_error`: called from a background thread with one line when the broker does not answer or
        refuses the connection, or the store fails.
    `on_return`: called with one line when the broker answers again.
    Raises `InputError` if a certificate can't be used.
    """

    def __init__(
        self,
        broker: Broker,
        *,
        store: str | Path | None,
        on_error: Callable[[str], None],
        on_return: Callable[[str], None] = lambda line: None,
    ) -> None:
        self._topic, self._where = broker.topic, store
        self._on_error, self._on_return = on_error, on_return
        self._address = f"{broker.host}:{broker.effective_port}"
        self._dropped = 0
        #: Receiver of the results in the store's outbox. Several stations may share a store; the
        #: topic identifies the station.
        self.receiver = f"mqtt {broker.topic}"
        self._calls: SimpleQueue[Callable[[Store], object] | None] = SimpleQueue()
        self._last_state: bytes | None = None
        self._link = _Link()
        self._client = self._create_client(broker)
        self._client.connect_async(broker.host, broker.effective_port, keepalive=_KEEPALIVE_S)
        self._online_s = -math.inf
        self._thread = threading.Thread(target=self._run, name="mqtt", daemon=True)

    @property
    def is_connected(self) -> bool:
        """Whether the broker has accepted the connection."""
        return self._link.is_up

    @property
    def fault(self) -> str:
        """What the broker does wrong, in a few words; empty while it is connected."""
        return "" if self._link.is_up else self._link.fault or "is not connected"

    def start(self) -> None:
        """Connect to the broker, which from then on shows that this station is online."""
        self._client.loop_start()
        self._thread.start()

    def publish_result(self, document: GraspDocument) -> None:
        """Queue a result and publish it as soon as the broker is connected."""
        text = json.dumps(document.to_dict(), allow_nan=False)

        def queue(store: Store) -> None:
            self._dropped += store.add_message(
                text, receiver=self.receiver, most=MAX_QUEUED_RESULTS
            )

        self._calls.put(queue)

    def publish_state(self, document: Mapping[str, object]) -> None:
        """Publish the state if it differs from the last published state."""
        payload = _payload(document)
        if payload != self._last_state:
            self._last_state = payload
            self._calls.put(lambda _: self._link.set_state(payload))

    def close(self) -> None:
        """Disconnect; unacknowledged results stay in the store."""
        self._calls.put(None)
        self._thread.join(_CLOSE_TIMEOUT_S)

    # -- on the publisher's thread --------------------------------------------------------------

    def _run(self) -> None:
        try:
            store = Store.open(self._where)
        except StoreError as error:
            self._on_error(f"mqtt: {error}; unsent results are kept in memory only")
            store = Store.open("sqlite://")
        try:
            while (call := self._next_call()) is not None:
                try:
                    call(store)
                    self._publish_online()
                    self._send(store)
                except StoreError as error:
                    self._on_error(f"mqtt: {error}; a result may be lost")
        finally:
            store.close()
            if self._link.is_up:
                self._publish("online", _OFFLINE)
            self._client.disconnect()
            self._client.loop_stop()

    def _next_call(self) -> Callable[[Store], object] | None:
        """Return the next call, or one without effect after a time; None at the end."""
        try:
            return self._calls.get(timeout=_ONLINE_PERIOD_S)
        except Empty:
            return lambda store: None

    def _publish_online(self) -> None:
        """Publish after a connection, and then regularly, that the station is online."""
        now_s = time.monotonic()
        if self._link.is_up and now_s - self._online_s >= _ONLINE_PERIOD_S:
            self._online_s = now_s
            self._publish("online", _payload({"online": True, "dropped": self._dropped}))

    def _on_connected(self, store: Store) -> None:
        self._link.is_up, self._link.is_state_sent = True, False
        self._online_s = -math.inf
        if self._link.fault:
            self._on_return(f"mqtt: the broker {self._address} answers again")
            self._link.fault = ""

    def _on_disconnected(self, store: Store) -> None:
        self._link.is_up = False
        # A refusal also ends the connection.
        if not self._link.fault:
            self._report("does not answer", store)

    def _report(self, fault: str, store: Store) -> None:
        """Report a new fault of the broker; the client tries again every few seconds."""
        if fault != self._link.fault:
            self._link.fault = fault
            self._on_error(f"mqtt: the broker {self._address} {fault}; results wait in the store")

    def _acknowledge(self, message: int, store: Store) -> None:
        link = self._link
        if link.sent is not None and message == link.sent[0]:
            store.remove_message(link.sent[1])
            link.sent = None
        elif message == link.state_message:
            link.state_message = None

    def _send(self, store: Store) -> None:
        """Publish the next result and the newest state, at most one of each in flight."""
        link = self._link
        if not link.is_up:
            return
        if link.state is not None and not link.is_state_sent and link.state_message is None:
            link.state_message, link.is_state_sent = self._publish("state", link.state), True
        waiting = None if link.sent is not None else store.oldest_message(self.receiver)
        if waiting is not None:
            number, text = waiting
            link.sent = self._publish("result", text.encode(), retain=False), number

    def _publish(self, name: str, payload: bytes, *, retain: bool = True) -> int:
        # The client resends an unacknowledged message after a reconnection.
        return self._client.publish(f"{self._topic}/{name}", payload, qos=1, retain=retain).mid

    # -- client callbacks, called on the client's own thread -------------------------------------

    def _create_client(self, broker: Broker) -> paho.Client:
        name = f"palpate-{socket.gethostname()}-{uuid.uuid4().hex[:8]}"
        client = paho.Client(CallbackAPIVersion.VERSION2, client_id=name)
        client.connect_timeout = _CONNECT_TIMEOUT_S
        client.reconnect_delay_set(_MIN_RECONNECT_S, _MAX_RECONNECT_S)
        client.will_set(f"{broker.topic}/online", _OFFLINE, qos=1, retain=True)
        if broker.username is not None:
            client.username_pw_set(broker.username, broker.password)
        if broker.tls:
            try:
                client.tls_set(broker.ca, broker.certificate, broker.key)
            except (OSError, ValueError) as error:
                raise InputError(
                    f"--mqtt: can't use the broker file's certificates: {error}"
                ) from error
        client.on_connect = self._on_connect
        client.on_disconnect = lambda *_: self._calls.put(self._on_disconnected)
        client.on_connect_fail = self._on_connect_fail
        client.on_publish = lambda _client, _data, message, *_: self._calls.put(
            partial(self._acknowledge, message)
        )
        return client

    def _on_connect_fail(self, client: Any, data: Any) -> None:
        # Called while the client handles the error. A reset is that of the handshake: nobody
        # listens after a refusal.
        error = sys.exception()
        if isinstance(error, ssl.SSLError | ConnectionResetError):
            why = getattr(error, "reason", None) or error.strerror
            fault = f"answers, but not with TLS ({why}; check port, tls and ca of the broker file)"
            self._calls.put(partial(self._report, fault))
        else:
            self._calls.put(self._on_disconnected)

    def _on_connect(self, client: Any, data: Any, flags: Any, reason: Any, properties: Any) -> None:
        if reason.is_failure:
            fault = f"refused the connection ({reason}; check username and password)"
            self._calls.put(partial(self._report, fault))
        else:
            self._calls.put(self._on_connected)


@dataclass(slots=True)
class _Link:
    """State of the connection, used only on the publisher's thread."""

    is_up: bool = False
    #: The last reported fault of the broker; empty while it answers.
    fault: str = ""
    #: Message numbers of the result in flight, in the client and in the outbox.
    sent: tuple[int, int] | None = None
    state: bytes | None = None
    is_state_sent: bool = False
    state_message: int | None = None

    def set_state(self, state: bytes) -> None:
        """Store the newest state for publication."""
        self.state, self.is_state_sent = state, False


def _payload(document: Mapping[str, object]) -> bytes:
    return json.dumps(document, allow_nan=False).encode()


_OFFLINE = _payload({"online": False})
