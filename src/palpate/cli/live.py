"""`palpate live`: live view of pixels, aggregate and link."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from typing import Annotated

import typer
from rich.console import Console
from rich.live import Live

from palpate.cli import options as option
from palpate.cli.lazy_group import find_entry_point
from palpate.cli.live_reading import LiveReading, pace_frames
from palpate.cli.live_view import DRAW_HZ, LiveView
from palpate.cli.options import opt, parse_address
from palpate.cli.output import print_message
from palpate.cli.sensor_source import SensorSource, open_source
from palpate.clock import Clock, RealClock
from palpate.errors import InputError
from palpate.force.force_follower import ForceSource
from palpate.force.of_calibration import force_now
from palpate.recording import Event
from palpate.sensor.array import Frame
from palpate.stop_signals import watch_stop_signals
from palpate.viewer import GROUP, Link, Viewer

#: Viewer -> its default address.
DEFAULT_ADDRESSES = {"foxglove": "127.0.0.1:8765", "rerun": "127.0.0.1:9876"}
#: Time between messages about the link.
_LINK_S = 1.0


def live(
    address: Annotated[
        str | None,
        typer.Argument(
            metavar="HOST:PORT",
            help="Listening address of --foxglove, or address of the viewer of --rerun. "
            f"[default: {', '.join(DEFAULT_ADDRESSES.values())}]",
            show_default=False,
        ),
    ] = None,
    foxglove: Annotated[
        bool, opt("--foxglove", "Also stream the data to Foxglove (docs: See it in Foxglove).")
    ] = False,
    rerun: Annotated[
        bool,
        opt("--rerun", "Also send the data to a running Rerun viewer (docs: See it in Rerun)."),
    ] = False,
    rig: option.SensorOption = None,
    port: option.PortOption = None,
    duration_s: Annotated[
        float,
        opt(
            "--duration SECONDS",
            "Display time. [default: until Ctrl-C]",
            min=0.1,
            show_default=False,
        ),
    ] = math.inf,
    force: Annotated[
        bool, opt("--force", "Show the present force, using the rig's calibration.")
    ] = False,
) -> None:
    """Show pixels, contact, rate and losses in the terminal.

    Keep the sensor unloaded at the start.

    Example: palpate live --rig sim-rigid --duration 20
    """
    chosen = {"foxglove": foxglove, "rerun": rerun}
    viewers = [name for name, is_chosen in chosen.items() if is_chosen]
    if address is not None and len(viewers) != 1:
        raise InputError(f"{address}: an address belongs to one viewer; add --foxglove or --rerun")
    clock = RealClock()
    with ExitStack() as stack:
        stopped = stack.enter_context(watch_stop_signals(interrupts=True))
        source = stack.enter_context(closing(open_source(rig, port=port)))
        force_tracker = _make_force_tracker(source) if force else None
        reading = LiveReading(source, rest_ohm=source.rest_ohm(), clock=clock, force=force_tracker)
        view, streams = LiveView(reading), list[LiveStream]()
        for name in viewers:
            stream = LiveStream(
                reading, clock=clock, viewer=name, address=address or DEFAULT_ADDRESSES[name]
            )
            streams.append(stack.enter_context(closing(stream)))
            print_message(f"palpate live: {stream.description}")
        end_s = clock.now_s() + duration_s
        console = Console(emoji=False)
        if not console.is_terminal:  # Rich does not end the last line there.
            stack.callback(console.line)
        screen = stack.enter_context(Live(console=console, auto_refresh=False, transient=False))
        drawn_s = -math.inf
        for frame in pace_frames(source):
            if frame is not None:
                view.add(frame)
            for stream in streams:
                stream.add(frame)
            now_s = clock.now_s()
            if now_s - drawn_s >= 1.0 / DRAW_HZ:
                drawn_s = now_s
                screen.update(view.render(console), refresh=True)
            if stopped():
                raise KeyboardInterrupt
            if now_s >= end_s:
                break


def _make_force_tracker(source: SensorSource) -> ForceSource:
    """Return a force tracker with the source's calibration.

    Raises `InputError` if the source has no calibration.
    """
    calibration = source.find_calibration()
    if calibration is None:
        raise InputError(
            f"--force: {source.name} has no calibration; run `palpate calibrate rest`, then "
            "`palpate calibrate force`"
        )
    return force_now(calibration)


def _find_viewer(name: str) -> Callable[..., Viewer]:
    """Return the function that opens a viewer.

    Raises `InputError` if its package is not installed.
    """
    package = (f"palpate-{name}", f"packages/{name}")
    point = find_entry_point(GROUP, name, *package, wanted=f"--{name}")
    found: Callable[..., Viewer] = point.load()
    return found


class LiveStream:
    """Sends each frame's reading to a viewer.

    `clock`: real-time clock, which also stamps a board's frames.
    `viewer`: "foxglove" or "rerun".
    `address`: HOST:PORT to listen on, or of the viewer.
    Raises `InputError` if the address is unusable, or the viewer's package is not installed.
    """

    def __init__(self, reading: LiveReading, *, clock: Clock, viewer: str, address: str) -> None:
        source = reading.source
        host, port = parse_address(address, option=f"--{viewer}")
        self._reading, self._clock = reading, clock
        self._zero_unix_ns = self._wall_zero_unix_ns(clock.now_s())
        self._viewer = _find_viewer(viewer)(
            host=host,
            port=port,
            name=f"palpate {source.name}" + (" (SIMULATED)" if source.simulated else ""),
            layout=source.array.layout,
            unix_ns=lambda time_s: self._zero_unix_ns + round(time_s * 1e9),
        )
        #: The viewer's name and address, for the user.
        self.description = self._viewer.description
        self._touching: frozenset[int] = frozenset()
        self._lost, self._silent = 0, False
        self._next_link_s = -math.inf

    def add(self, frame: Frame | None) -> None:
        """Publish the reading after a frame; None means that no frame arrived."""
        time_s = self._clock.now_s() if frame is None else frame.time_s
        if self._reading.frames == 1 and self._reading.source.simulated:
            # The twin has a separate clock, which is paced to real time from the first frame.
            self._zero_unix_ns = self._wall_zero_unix_ns(time_s)
        for event in self._events(time_s, silent=frame is None):
            self._viewer.send_recorded(event)
        if frame is not None:
            self._send(frame)
        if time_s >= self._next_link_s:
            self._next_link_s = time_s + _LINK_S
            self._viewer.send_link(self._link(time_s))

    def close(self) -> None:
        """Close the viewer's connection."""
        self._viewer.close()

    def _send(self, frame: Frame) -> None:
        reading = self._reading
        self._viewer.send_recorded(frame)
        if reading.source.gripper is not None:
            self._viewer.send_recorded(reading.source.gripper.state())
        if reading.change_percent is not None:
            self._viewer.send_change(frame.time_s, reading.change_percent)
        if reading.force_n is not None:
            self._viewer.send_force(frame.time_s, reading.force_n)

    def _events(self, time_s: float, *, silent: bool) -> Iterator[Event]:
        """Yield new events: contacts, lost frames, silence of the sensor."""
        reading = self._reading
        if silent != self._silent:
            yield Event(time_s=time_s, name="silent" if silent else "back")
        if reading.lost > self._lost:
            yield Event(time_s=time_s, name="lost", text=f"{reading.lost - self._lost} frames")
        for finger in sorted(reading.touching ^ self._touching):
            name = "contact" if finger in reading.touching else "released"
            yield Event(time_s=time_s, name=name, text=f"finger {finger}")
        self._silent, self._lost, self._touching = silent, reading.lost, reading.touching

    def _link(self, time_s: float) -> Link:
        reading = self._reading
        return Link(
            time_s=time_s,
            source=reading.source.name,
            simulated=reading.source.simulated,
            rate_hz=reading.rate_hz,
            frames=reading.frames,
            lost=reading.lost,
            corrupt=reading.source.link_counters().corrupt,
        )

    @staticmethod
    def _wall_zero_unix_ns(time_s: float) -> int:
        """Return the Unix time of 0 s on a clock that now reads `time_s`, ns."""
        return time.time_ns() - round(time_s * 1e9)
