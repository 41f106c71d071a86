"""`palpate live`: live view of pixels, aggregate and link."""

from __future__ import annotations

import math
import threading
from contextlib import ExitStack, closing
from types import FrameType
from typing import Annotated, Protocol

import typer
from rich.console import Console
from rich.live import Live

from palpate.cli import options as option
from palpate.cli.lazy_group import find_entry_point
from palpate.cli.live_reading import LiveReading, pace_frames
from palpate.cli.live_view import DRAW_HZ, LiveView
from palpate.cli.options import opt
from palpate.cli.output import print_message
from palpate.cli.sensor_source import SensorSource, open_source
from palpate.clock import RealClock
from palpate.errors import InputError
from palpate.force.force_follower import ForceSource
from palpate.force.of_calibration import force_now
from palpate.sensor.array import Frame
from palpate.stop_signals import handle_stop_signals, interrupt

#: Foxglove's default address.
DEFAULT_ADDRESS = "127.0.0.1:8765"
#: Entry points of viewers: functions `open(reading, *, clock, address) -> Viewer`.
ENTRY_POINTS = "palpate.viewers"


class Viewer(Protocol):
    """A program of another package that shows the readings of `palpate live`."""

    #: One line for the user: where it is seen.
    announcement: str

    def add(self, frame: Frame | None) -> None:
        """Show the reading after a frame; None means that no frame arrived."""

    def close(self) -> None:
        """Stop the viewer."""


def live(
    address: Annotated[
        str | None,
        typer.Argument(
            metavar="HOST:PORT",
            help=f"Listening address of --foxglove. [default: {DEFAULT_ADDRESS}]",
            show_default=False,
        ),
    ] = None,
    foxglove: Annotated[
        bool, opt("--foxglove", "Also stream the data to Foxglove (docs: See it in Foxglove).")
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
    if address is not None and not foxglove:
        raise InputError(
            f"{address}: an address requires --foxglove; add --foxglove or omit the address"
        )
    opener = None
    if foxglove:
        package = ("palpate-foxglove", "packages/foxglove")
        opener = find_entry_point(ENTRY_POINTS, "foxglove", *package, wanted="--foxglove").load()
    clock, received = RealClock(), threading.Event()

    def stop(number: int, stack_frame: FrameType | None) -> None:
        # A library can lose the interrupt, but not the note.
        received.set()
        interrupt(number, stack_frame)

    with ExitStack() as stack:
        stack.enter_context(handle_stop_signals(stop))
        source = stack.enter_context(closing(open_source(rig, port=port)))
        force_tracker = _make_force_tracker(source) if force else None
        reading = LiveReading(source, rest_ohm=source.rest_ohm(), clock=clock, force=force_tracker)
        view = LiveView(reading)
        stream: Viewer | None = None
        if opener is not None:
            stream = opener(reading, clock=clock, address=address or DEFAULT_ADDRESS)
            stack.enter_context(closing(stream))
            print_message(f"palpate live: {stream.announcement}")
        end_s = clock.now_s() + duration_s
        console = Console(emoji=False)
        if not console.is_terminal:  # Rich does not end the last line there.
            stack.callback(console.line)
        screen = stack.enter_context(Live(console=console, auto_refresh=False, transient=False))
        drawn_s = -math.inf
        for frame in pace_frames(source, clock=clock):
            if frame is not None:
                view.add(frame)
            if stream is not None:
                stream.add(frame)
            now_s = clock.now_s()
            if now_s - drawn_s >= 1.0 / DRAW_HZ:
                drawn_s = now_s
                screen.update(view.render(console), refresh=True)
            if received.is_set():
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
