"""`palpate flash`: put palpate's firmware on an Arduino Mega 2560, Uno or Nano."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

from palpate.cli.avrdude import avrdude_path, write_image
from palpate.clock import RealClock
from palpate.errors import DeviceError, DeviceNotFoundError
from palpate.firmware_image import image_path
from palpate.sensor.byte_stream import SerialStream
from palpate.sensor.ports import ask_identity, serial_ports


def flash(
    port: Annotated[
        str | None, typer.Option(help="Serial port; by default the one found by USB id.")
    ] = None,
    board: Annotated[
        Literal["mega2560", "uno", "nano"], typer.Option(help="Which Arduino it is.")
    ] = "mega2560",
    baud: Annotated[
        int,
        typer.Option(
            help="Speed it will talk at: 1000000, 500000, 250000 or 115200; a Mega also 9600."
        ),
    ] = 1_000_000,
    image: Annotated[
        Path | None, typer.Option(help="Another image (Intel hex) than the one installed.")
    ] = None,
) -> None:
    """Write the firmware with avrdude, verify it, and ask the board what it runs.

    Example: palpate flash --port /dev/ttyACM0
    """
    avrdude_path()
    chosen = image or image_path(board, baud)
    device = port or _only_port()
    # Opened and closed first: reports in one line what avrdude reports in many, or not at all.
    SerialStream(device, baud=baud).close()
    print(f"writing {chosen.name} to {device} ...", file=sys.stderr)
    write_image(chosen, board=board, port=device)
    try:
        found = ask_identity(SerialStream(device, baud=baud), clock=RealClock())
    except DeviceError as error:
        raise DeviceError(
            f"written and verified, but the board does not answer: {error}"
        ) from error
    version = ".".join(map(str, found.version))
    print(f"{device}: {found.board} runs palpate's firmware {version} at {found.baud} baud")


def _only_port() -> str:
    """Return the one port that looks like a board: asking would need the firmware already."""
    likely = [found for found in serial_ports() if found.board is not None]
    if len(likely) == 1:
        return likely[0].device
    if not likely:
        raise DeviceNotFoundError(
            "no Arduino found by its USB id. Plug it in with a data cable; `palpate ports` lists "
            "what there is, --port names one."
        )
    names = ", ".join(found.device for found in likely)
    raise DeviceError(f"{len(likely)} boards found: {names}. Choose one with --port.")
