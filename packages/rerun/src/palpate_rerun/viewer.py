"""A `Viewer` that writes to a Rerun recording stream, which goes to a viewer or to a file.

Entities: ``pixels/decrease_percent`` (image) with ``pixels/names``, ``change``, ``force``,
``force/status``, ``gripper/...``, ``load_cells``, ``link/...``, ``events`` and ``source``. Unknown
numbers are NaN. Raw counts are not shown; a recording has them.
"""

from __future__ import annotations

import math
import socket
from collections.abc import Callable
from pathlib import Path

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import InputError, require_extra
from palpate.gripper.interface import GripperState
from palpate.measurement import Measurement
from palpate.recording import Event, LoadCells
from palpate.recording.channels import RecordedMessage
from palpate.sensor.array import ArrayLayout
from palpate.signal.relative import mean_change
from palpate.viewer import Link, pixel_names

with require_extra("--rerun", extra="rerun"):
    import rerun
    from rerun import blueprint

#: Time on the sensor's clock, as the `time_s` of a recording or an exported table.
SENSOR_TIME = "sensor_time"
#: Time of day; absent if unknown, as in simulated recordings.
WALL_TIME = "wall_time"
#: Decrease of resistance with the brightest colour, percent. That of a firm grasp.
_BRIGHTEST_PERCENT = 80.0
_CONNECT_S = 2.0
#: Longest wait at the end for a viewer that no longer reads.
_FLUSH_S = 2.0


class RerunViewer:
    """Writes one sensor's values to a recording stream.

    Parameters
    ----------
    stream : rerun.RecordingStream
        An open stream, which `close` closes.
    source : str
        Shown origin of the data, such as the rig and whether it is simulated.
    layout : ArrayLayout
        Layout of the pixels.
    unix_ns : callable or None
        Converts a time on the sensor's clock (seconds) to Unix time (nanoseconds); None if unknown.
    description : str
        The viewer's name and address, for the user.
    """

    def __init__(
        self,
        stream: rerun.RecordingStream,
        *,
        source: str,
        layout: ArrayLayout,
        unix_ns: Callable[[float], int] | None,
        description: str,
    ) -> None:
        self._stream, self._unix_ns, self.description = stream, unix_ns, description
        self._status = ""
        names = pixel_names(layout)
        centers = [
            [col + 0.5, row + 0.5] for row in range(layout.rows) for col in range(layout.cols)
        ]
        half_sizes = [[0.5, 0.5]] * layout.pixels
        boxes = rerun.Boxes2D(centers=centers, half_sizes=half_sizes, labels=names)
        stream.log("pixels/names", boxes, static=True)
        series = {
            "change": ["mean_percent", *(f"{name}_percent" for name in names)],
            "force": ["force_n", "low_n", "high_n"],
        }
        for entity, lines in series.items():
            stream.log(entity, rerun.SeriesLines(names=lines), static=True)
        stream.log("source", rerun.TextDocument(source), static=True)

    def send_recorded(self, message: RecordedMessage) -> None:
        """Send a gripper state, an event or a load cell reading; frames have no entity."""
        if isinstance(message, GripperState):
            for name in ("width_mm", "pressure_kpa", "current_ma"):
                value = getattr(message, name)
                if math.isfinite(value):
                    self._log(message.time_s, f"gripper/{name}", rerun.Scalars(value))
        elif isinstance(message, Event):
            text = f"{message.name}: {message.text}" if message.text else message.name
            self._log(message.time_s, "events", rerun.TextLog(text))
        elif isinstance(message, LoadCells) and message.force_n:
            self._log(message.time_s, "load_cells/force_n", rerun.Scalars(list(message.force_n)))

    def send_change(self, time_s: float, change_percent: FloatArray) -> None:
        """Send relative changes, shape (rows, cols), as numbers and as an image.

        The image shows the decrease, because a colour scale of Rerun begins at zero.
        """
        values = [float(mean_change(change_percent)), *change_percent.ravel().tolist()]
        self._log(time_s, "change", rerun.Scalars(values))
        image = rerun.DepthImage(
            np.ascontiguousarray(-change_percent, dtype=np.float32),
            colormap="inferno",
            depth_range=(0.0, _BRIGHTEST_PERCENT),
        )
        self._log(time_s, "pixels/decrease_percent", image)

    def send_force(self, time_s: float, force_n: Measurement) -> None:
        """Send the force with its interval, and its status when it changes."""
        ends = (force_n.value, *force_n.known_ends)
        values = [math.nan if value is None else value for value in ends]
        self._log(time_s, "force", rerun.Scalars(values))
        status = f"{force_n.status}, {force_n.level:.0%}"
        if status != self._status:
            self._status = status
            self._log(time_s, "force/status", rerun.TextLog(status))

    def send_link(self, link: Link) -> None:
        """Send the frame rate and the counts of the link."""
        for name in ("rate_hz", "frames", "lost", "corrupt"):
            self._log(link.time_s, f"link/{name}", rerun.Scalars(float(getattr(link, name))))

    def close(self) -> None:
        """Send what is still waiting; a viewer that no longer reads loses it."""
        try:
            self._stream.flush(timeout_sec=_FLUSH_S)
        except Exception:
            # RuntimeError in older versions of the SDK; the viewer is gone either way.
            return
        self._stream.disconnect()

    def _log(self, time_s: float, entity: str, values: rerun.AsComponents) -> None:
        self._stream.set_time(SENSOR_TIME, duration=time_s)
        if self._unix_ns is not None:
            wall_time = np.datetime64(self._unix_ns(time_s), "ns")
            self._stream.set_time(WALL_TIME, timestamp=wall_time)
        self._stream.log(entity, values)


def connect_viewer(
    *, host: str, port: int, name: str, layout: ArrayLayout, unix_ns: Callable[[float], int]
) -> RerunViewer:
    """Connect to a running Rerun viewer.

    Parameters
    ----------
    host, port
        Address of the viewer; its own default is port 9876.
    name : str
        Name of the source in the viewer.
    layout, unix_ns
        As for `RerunViewer`.

    Raises
    ------
    InputError
        If no viewer listens there. The SDK itself would wait for one silently.
    """
    shown = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
    try:
        socket.create_connection((host, port), timeout=_CONNECT_S).close()
    except OSError as error:
        raise InputError(
            f"--rerun: no viewer at {shown} ({error}); start one with `rerun --port {port}`"
        ) from error
    stream = rerun.RecordingStream("palpate")
    stream.connect_grpc(f"rerun+http://{shown}/proxy", default_blueprint=default_blueprint())
    stream.send_recording_name(name)
    description = f"Rerun viewer at {shown}"
    return RerunViewer(stream, source=name, layout=layout, unix_ns=unix_ns, description=description)


def open_file(
    path: Path,
    *,
    title: str,
    source: str,
    layout: ArrayLayout,
    unix_ns: Callable[[float], int] | None,
) -> RerunViewer:
    """Write to a file, complete when the viewer is closed.

    Parameters
    ----------
    path : Path
        The `.rrd` file, which is overwritten.
    title : str
        Name of the recording in the viewer.
    source, layout, unix_ns
        As for `RerunViewer`.
    """
    stream = rerun.RecordingStream("palpate")
    stream.save(path, default_blueprint=default_blueprint())
    stream.send_recording_name(title)
    return RerunViewer(stream, source=source, layout=layout, unix_ns=unix_ns, description=str(path))


def default_blueprint() -> blueprint.Blueprint:
    """Return the panels: pixels, force, width, changes, events, source."""
    return blueprint.Blueprint(
        blueprint.Horizontal(
            blueprint.Vertical(
                blueprint.TextDocumentView(origin="source", name="Source"),
                blueprint.Spatial2DView(
                    origin="pixels", name=f"Decrease of resistance, 0 to {_BRIGHTEST_PERCENT:g} %"
                ),
                blueprint.TextLogView(origin="/", name="Contacts and phases"),
                row_shares=[1, 4, 3],
            ),
            blueprint.Vertical(
                blueprint.TimeSeriesView(origin="force", name="Force with its interval, N"),
                blueprint.TimeSeriesView(origin="gripper", name="Hand"),
                blueprint.TimeSeriesView(origin="change", name="Change relative to rest, %"),
            ),
        ),
        collapse_panels=True,
    )
