"""`palpate live`: the pixels, the aggregate and the link, as they are now."""

from __future__ import annotations

import math
import sys
from contextlib import ExitStack, closing
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.commands import options as option
from palpate.errors import InputError

if TYPE_CHECKING:
    from palpate.clock import Clock
    from palpate.commands.live_foxglove import LiveStream
    from palpate.commands.live_reading import LiveReading
    from palpate.commands.sensor_source import SensorSource
    from palpate.estimate.force_follower import FollowsForce

#: Where Foxglove looks by itself.
DEFAULT_ADDRESS = "127.0.0.1:8765"


def live(
    address: Annotated[
        str | None,
        typer.Argument(
            metavar="HOST:PORT",
            help=f"Where --foxglove listens. [default: {DEFAULT_ADDRESS}]",
            show_default=False,
        ),
    ] = None,
    foxglove: Annotated[
        bool,
        typer.Option(
            "--foxglove", help="Send all of it to Foxglove, too (docs: See it in Foxglove)."
        ),
    ] = False,
    rig: option.SensorOption = None,
    port: option.PortOption = None,
    duration_s: Annotated[
        float,
        typer.Option(
            "--duration",
            help="How long. [default: until Ctrl-C]",
            min=0.1,
            show_default=False,
        ),
    ] = math.inf,
    force: Annotated[
        bool, typer.Option("--force", help="Newtons now, by the rig's force calibration.")
    ] = False,
    layout: option.LayoutOption = None,
    reference_ohm: option.ReferenceOption = None,
    rate_hz: option.RateOption = None,
    baud: option.BaudOption = None,
) -> None:
    """Show pixels, contact, rate and losses in the terminal. Leave the sensor alone at the start.

    Example: palpate live --rig sim-rigid --duration 20
    """
    from rich.console import Console
    from rich.live import Live

    from palpate.clock import RealClock
    from palpate.commands.live_reading import LiveReading
    from palpate.commands.live_squeeze import paced
    from palpate.commands.live_view import DRAW_HZ, LiveView
    from palpate.commands.sensor_source import open_source

    if address is not None and not foxglove:
        raise InputError(f"{address}: an address is for --foxglove; add it, or leave this out")
    source = open_source(
        rig=rig,
        port=port,
        layout=layout,
        reference_ohm=reference_ohm,
        rate_hz=rate_hz,
        baud=baud,
    )
    clock = RealClock()
    with ExitStack() as stack:
        stack.enter_context(closing(source))
        follows = _followed(source) if force else None
        reading = LiveReading(source, rest_ohm=source.rest_ohm(), clock=clock, force=follows)
        view, stream = LiveView(reading), None
        if foxglove:
            stream = stack.enter_context(closing(_stream(reading, clock=clock, address=address)))
        end_s = clock.now_s() + duration_s
        screen = stack.enter_context(Live(console=Console(), auto_refresh=False, transient=False))
        drawn_s = -math.inf
        for frame in paced(source, clock=clock):
            if frame is not None:
                view.add(frame)
            if stream is not None:
                stream.add(frame)
            now_s = clock.now_s()
            if now_s - drawn_s >= 1.0 / DRAW_HZ:
                drawn_s = now_s
                screen.update(view.render(), refresh=True)
            if now_s >= end_s:
                break


def _stream(reading: LiveReading, *, clock: Clock, address: str | None) -> LiveStream:
    """Listen for Foxglove, and print what to type there."""
    from palpate.commands.live_foxglove import LiveStream
    from palpate.foxglove import LAYOUT

    stream = LiveStream(reading, clock=clock, address=address or DEFAULT_ADDRESS)
    print(f"palpate live: Foxglove at {stream.address}, layout {LAYOUT}", file=sys.stderr)
    return stream


def _followed(source: SensorSource) -> FollowsForce:
    """Return what follows the force by the source's calibration."""
    from palpate.grasp.planning import force_now

    calibration = source.known_calibration()
    if calibration is None:
        raise InputError(
            f"--force: {source.name} names no calibration; run `palpate calibrate force` and name "
            "its file in the rig file"
        )
    return force_now(calibration.force)
