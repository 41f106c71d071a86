"""The websocket server that Foxglove connects to: the SDK's, in threads of its own.

A message is encoded only for topics with a subscriber, and handing one over never waits:
a viewer that is too slow misses messages.
"""

from __future__ import annotations

from collections.abc import Callable

from palpate.arrays import FloatArray
from palpate.errors import InputError, require_extra
from palpate.estimate.measurement import Measurement
from palpate.foxglove.channels import (
    HEAT_MAP,
    HEAT_MAP_ENCODING,
    Link,
    encode_change,
    encode_force,
    encode_link,
    heat_map_data,
    live_schemas,
)
from palpate.recording.channels import SCHEMAS, RecordedMessage, encode, topic_of
from palpate.sensor.array import ArrayLayout

with require_extra("--foxglove", extra="foxglove"):
    import foxglove
    from foxglove.channels import RawImageChannel
    from foxglove.messages import RawImage, Timestamp


class FoxgloveServer:
    """Sends messages to every Foxglove that subscribed to their topic.

    `host`, `port`: where to listen; port 0 takes a free one.
    `name`: what Foxglove calls the source.
    `unix_ns`: gives the Unix time, nanoseconds, of a time on the sensor's clock, seconds.
    Raises `InputError` if it can't listen there; `MissingExtraError`: on import, without the
    Foxglove SDK.
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
        # Not the SDK's global one: two servers of a process have channels of the same names. Kept,
        # because a server whose context is gone no longer answers.
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
        #: What to type in Foxglove.
        self.address = f"ws://{shown}:{self._server.port}"

    def record(self, message: RecordedMessage) -> None:
        """Send a frame, gripper state, event or load cell reading, as a recording has it."""
        self._log(topic_of(message), message.time_s, lambda: encode(message))

    def change(self, time_s: float, change_percent: FloatArray) -> None:
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

    def force(self, time_s: float, force_n: Measurement) -> None:
        """Send the force with its interval."""
        self._log("/force", time_s, lambda: encode_force(time_s, force_n))

    def link(self, link: Link) -> None:
        """Send where the frames come from, and how the link does."""
        self._log("/link", link.time_s, lambda: encode_link(link))

    def close(self) -> None:
        """Send nothing more."""
        self._server.stop()

    def _log(self, topic: str, time_s: float, encoded: Callable[[], bytes]) -> None:
        channel = self._channels[topic]
        if channel.has_sinks():
            channel.log(encoded(), log_time=self._unix_ns(time_s))
