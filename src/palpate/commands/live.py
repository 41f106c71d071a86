"""`palpate live`: the pixels, the aggregate and the link, as they are now."""

from __future__ import annotations

import math
from contextlib import closing
from typing import Annotated

import typer


def live(
    rig: Annotated[
        str | None, typer.Option(help="Name of a rig, or a rig file.", metavar="NAME_OR_TOML")
    ] = None,
    port: Annotated[
        str | None, typer.Option(help="Serial port. Found by USB id, or by asking, by default.")
    ] = None,
    duration_s: Annotated[
        float, typer.Option("--duration", help="Seconds; until Ctrl-C by default.", min=0.1)
    ] = math.inf,
    layout: Annotated[
        str | None,
        typer.Option(help="Of the board on --port: rigid-2x2, soft-3x2, or e.g. 4x4."),
    ] = None,
    reference_ohm: Annotated[
        float | None, typer.Option(help="Its divider's resistor; 4700 by default.")
    ] = None,
    rate_hz: Annotated[
        float | None, typer.Option(help="Its frames per second; 250 by default.")
    ] = None,
    baud: Annotated[
        int | None, typer.Option(help="Speed of its firmware; 1000000 by default.")
    ] = None,
) -> None:
    """Show pixels, contact, rate and losses in the terminal. Leave the sensor alone at the start.

    Example: palpate live --rig sim-rigid --duration 20
    """
    from rich.console import Console
    from rich.live import Live

    from palpate.clock import RealClock
    from palpate.commands.live_squeeze import paced
    from palpate.commands.live_view import DRAW_HZ, LiveView
    from palpate.commands.sensor_source import open_source, refuse_beside_rig

    refuse_beside_rig(
        rig, port=port, layout=layout, reference_ohm=reference_ohm, rate_hz=rate_hz, baud=baud
    )
    source = open_source(
        rig=rig,
        port=port,
        layout=layout,
        reference_ohm=reference_ohm,
        rate_hz=rate_hz,
        baud=baud,
    )
    clock = RealClock()
    with closing(source):
        view = LiveView(source, rest_ohm=source.rest_ohm(), clock=clock)
        end_s = clock.now_s() + duration_s
        screen = Live(console=Console(), auto_refresh=False, transient=False)
        with screen:
            drawn_s = -math.inf
            for frame in paced(source, clock=clock):
                if frame is not None:
                    view.add(frame)
                now_s = clock.now_s()
                if now_s - drawn_s >= 1.0 / DRAW_HZ:
                    drawn_s = now_s
                    screen.update(view.render(), refresh=True)
                if now_s >= end_s:
                    break
