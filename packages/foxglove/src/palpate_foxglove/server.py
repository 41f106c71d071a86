"""The WebSocket server for Foxglove, based on the Foxglove SDK and its threads.

Messages are encoded only for topics with a subscriber. Sending never blocks; a slow viewer misses
messages.
"""

from __future__ import annotations

from collections.abc import Callable

import foxglove
from foxglove.channels import RawImageChannel
from foxglove.messages import RawImage, Timestamp

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.measurement import Measurement
from palpate.recording.channels import SCHEMAS, RecordedMessage, encode, topic_of
from palpate.sensor.array import ArrayLayout
from palpate.viewer import Link
from palpate_foxglove import LAYOUT
from palpate_foxglove.channels import (
    HEAT_MAP,
    HEAT_MAP_ENCODING,
    encode_change,
    encode_force,
    encode_link,
    heat_map_data,
    live_schemas,
)


class FoxgloveServer:
    """WebSocket server for all connected Foxglove viewers.

    `host`, `port`: listening address; port 0 selects a free port.
    `name`: name of the source in Foxglove.
    `unix_ns`: converts a time on the sensor's clock (seconds) to Unix time (nanoseconds).
    Raises `InputError` if the server can't listen at this address. Importing the module raises
    `MissingExtraError` without the Foxglove SDK.
    """

    def __init__(
        self,
        *,
        host: str,
        port: int,
        name: str,
        layout: ArrayLayout,
        unix_ns: Callable[[float], int],
    ) -> None:
        self._layout, self._unix_ns = layout, unix_ns
        # A separate context, because two servers in a process use the same channel names. The
        # attribute keeps the context alive; the server stops answering without it.
        self._context = context = foxglove.Context()
        self._channels = {
            topic: foxglove.Channel(topic, schema=schema, context=context)
            for topic, schema in (SCHEMAS | live_schemas(layout)).items()
        }
        self._heat_map = RawImageChannel(HEAT_MAP, context=context)
        try:
            self._server = foxglove.start_server(name=name, host=host, port=port, context=context)
        except RuntimeError as error:
            raise InputError(
                f"--foxglove {host}:{port}: {error}; choose another address"
            ) from error
        shown = f"[{host}]" if ":" in host else host
        #: URL to open in Foxglove.
        self.address = f"ws://{shown}:{self._server.port}"

    @property
    def description(self) -> str:
        """Address and panel layout to open in Foxglove."""
        return f"Foxglove at {self.address}, layout {LAYOUT}"

    def send_recorded(self, message: RecordedMessage) -> None:
        """Send a recorded message: frame, gripper state, event or load cell reading."""
        self._log(topic_of(message), message.time_s, lambda: encode(message))

    def send_change(self, time_s: float, change_percent: FloatArray) -> None:
        """Send relative changes, shape (rows, cols), as numbers and as a heat map."""
        layout = self._layout
        self._log("/change", time_s, lambda: encode_change(time_s, change_percent, layout=layout))
        if self._heat_map.has_sinks():
            time_ns = self._unix_ns(time_s)
            image = RawImage(
                timestamp=Timestamp(*divmod(time_ns, 1_000_000_000)),
                frame_id=layout.name,
                width=layout.cols,
                height=layout.rows,
                encoding=HEAT_MAP_ENCODING,
                step=4 * layout.cols,
                data=heat_map_data(change_percent),
            )
            self._heat_map.log(image, log_time=time_ns)

    def send_force(self, time_s: float, force_n: Measurement) -> None:
        """Send the force with its interval."""
        self._log("/force", time_s, lambda: encode_force(time_s, force_n))

    def send_link(self, link: Link) -> None:
        """Send the source of the frames and the state of the link."""
        self._log("/link", link.time_s, lambda: encode_link(link))

    def close(self) -> None:
        """Stop the server."""
        self._server.stop()

    def _log(self, topic: str, time_s: float, encoded: Callable[[], bytes]) -> None:
        channel = self._channels[topic]
        if channel.has_sinks():
            channel.log(encoded(), log_time=self._unix_ns(time_s))
