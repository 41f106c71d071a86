"""The options of every verb that reads a board on a port."""

from __future__ import annotations

from typing import Annotated, TypeAlias

import typer

PortOption: TypeAlias = Annotated[
    str | None, typer.Option(help="Serial port. [default: found by USB id, or by asking]")
]
LayoutOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        help="Of the board on --port: rigid-2x2, soft-3x2, or rows x columns "
        "such as 4x4. [default: rigid-2x2]"
    ),
]
ReferenceOption: TypeAlias = Annotated[
    float | None, typer.Option(help="Its divider's resistor. [default: 4700]")
]
RateOption: TypeAlias = Annotated[
    float | None, typer.Option(help="Its frames per second. [default: 250]")
]
BaudOption: TypeAlias = Annotated[
    int | None, typer.Option(help="Speed of its firmware. [default: 1000000]")
]
