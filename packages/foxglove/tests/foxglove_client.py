"""A client of the Foxglove websocket protocol, as the app is one: subscribes, counts, decodes."""

from __future__ import annotations

import json
import struct
import time
from base64 import b64decode
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from websockets.sync.client import ClientConnection, connect

SUBPROTOCOL = "foxglove.sdk.v1"
TIMEOUT_S = 60.0
_MESSAGE = 1
_HEAD = struct.Struct("<BIQ")


@dataclass(frozen=True)
class Received:
    """A message: JSON as its content, protobuf as an object of its advertised class."""

    topic: str
    log_time_ns: int
    content: Any


class FoxgloveClient:
    """Subscribes to every channel that the server advertises."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket
        self.server: dict[str, Any] = {}
        self.channels: dict[str, dict[str, Any]] = {}
        while len(self.channels) == 0:
            self._take(json.loads(socket.recv(timeout=TIMEOUT_S)))

    def subscribe(self, *topics: str) -> None:
        """Subscribe to topics; to all without any."""
        wanted = [self.channels[topic]["id"] for topic in topics or self.channels]
        subscriptions = [{"id": number, "channelId": number} for number in wanted]
        self._socket.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))

    def messages(self, *, for_s: float = TIMEOUT_S) -> Iterator[Received]:
        """Yield messages as they come, until the time is up."""
        topics = {channel["id"]: topic for topic, channel in self.channels.items()}
        classes = {
            topic: message_class(channel)
            for topic, channel in self.channels.items()
            if channel["encoding"] == "protobuf"
        }
        end_s = time.monotonic() + for_s
        while (left_s := end_s - time.monotonic()) > 0:
            try:
                data = self._socket.recv(timeout=left_s)
            except TimeoutError:
                return
            if isinstance(data, str):
                self._take(json.loads(data))
                continue
            kind, subscription, log_time_ns = _HEAD.unpack_from(data)
            if kind == _MESSAGE:
                topic, payload = topics[subscription], data[_HEAD.size :]
                made = classes.get(topic)
                content = json.loads(payload) if made is None else made.FromString(payload)
                yield Received(topic, log_time_ns, content)

    def _take(self, message: dict[str, Any]) -> None:
        if message["op"] == "serverInfo":
            self.server = message
        elif message["op"] == "advertise":
            self.channels |= {channel["topic"]: channel for channel in message["channels"]}


@contextmanager
def foxglove_client(address: str) -> Iterator[FoxgloveClient]:
    """Connect to a server; leave it at the end."""
    with connect(address, subprotocols=[SUBPROTOCOL]) as socket:  # type: ignore[list-item]
        assert socket.subprotocol == SUBPROTOCOL
        yield FoxgloveClient(socket)


def message_class(channel: dict[str, Any]) -> Any:
    """Make the class of a channel's messages from the descriptors that it advertises."""
    files = descriptor_pb2.FileDescriptorSet.FromString(b64decode(channel["schema"]))
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"]))
