"""`palpate record FILE`: frames of a board, or of a whole rig, into a recording."""

from __future__ import annotations

import math
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Annotated

import typer

from palpate.commands import options as option
from palpate.errors import InputError


def record(
    file: Annotated[Path, typer.Argument(help="The new recording.")] = Path("recording.mcap"),
    rig: Annotated[
        str | None,
        typer.Option(help="Rig or rig file: array and gripper.", metavar="NAME_OR_TOML"),
    ] = None,
    port: option.PortOption = None,
    layout: option.LayoutOption = None,
    reference_ohm: option.ReferenceOption = None,
    rate_hz: option.RateOption = None,
    oversampling: Annotated[
        int | None, typer.Option(help="Conversions per pixel. [default: 1]", min=1, max=64)
    ] = None,
    baud: option.BaudOption = None,
    load_cells: Annotated[
        bool, typer.Option("--load-cells", help="Record the reference load cells too.")
    ] = False,
    duration_s: Annotated[
        float | None,
        typer.Option("--duration", help="How long. [default: until Ctrl-C]"),
    ] = None,
    seed: option.SeedOption = 0,
) -> None:
    """Record a board, or a rig with its gripper. The file is readable at any moment.

    Ctrl-C or SIGTERM ends it, exit status 130, with the file finished.

    Example: palpate record apple.mcap --port /dev/ttyACM0 --duration 30
    """
    from palpate.commands.record_source import board_source, rig_source
    from palpate.recording import RecordingWriter
    from palpate.recording.writer import capture

    if file.suffix != ".mcap":
        raise InputError(f"{file}: a recording ends in .mcap; `palpate export` makes tables of it")
    if duration_s is not None and not duration_s > 0:
        raise InputError(f"--duration {duration_s:g}: must be above 0")
    options = {
        "port": port,
        "layout": layout,
        "reference_ohm": reference_ohm,
        "rate_hz": rate_hz,
        "oversampling": oversampling,
        "baud": baud,
        "load_cells": load_cells or None,
    }
    given = {name: value for name, value in options.items() if value is not None}
    if rig is None and not given:
        rig = option.stated_rig()
    with ExitStack() as stack:
        if rig is None:
            source = board_source(given, stack=stack)
        else:
            source = rig_source(rig, given, stack=stack, seed=seed, endless=duration_s is None)
        # Before the file: a signal while that is begun or finished must not tear it either.
        stopped = stack.enter_context(_stop_signals())
        writer = stack.enter_context(RecordingWriter(file, info=source.info))
        _say(f"recording {source.name} to {file}; Ctrl-C ends it")
        capture(
            source.array,
            writer=writer,
            clock=source.clock,
            duration_s=math.inf if duration_s is None else duration_s,
            load_cells=source.load_cells,
            gripper=source.gripper,
            stopped=stopped,
            report=_say,
        )
    _say(f"{file}: {source.link_text()}")
    if stopped():
        raise KeyboardInterrupt


@contextmanager
def _stop_signals() -> Iterator[Callable[[], bool]]:
    """Yield a function that returns whether Ctrl-C or SIGTERM came, so that neither cuts a file."""
    came: list[int] = []
    before = {
        number: signal.signal(number, lambda number, _: came.append(number))
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield lambda: bool(came)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _say(text: str) -> None:
    print(text, file=sys.stderr)
