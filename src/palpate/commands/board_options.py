"""The options by which every verb is told of a board on a port."""

from __future__ import annotations

from typing import Annotated, TypeAlias

import typer

PortOption: TypeAlias = Annotated[
    str | None, typer.Option(help="Serial port. Found by USB id, or by asking, by default.")
]
LayoutOption: TypeAlias = Annotated[
    str | None, typer.Option(help="Of the board on --port: rigid-2x2, soft-3x2, or e.g. 4x4.")
]
ReferenceOption: TypeAlias = Annotated[
    float | None, typer.Option(help="Its divider's resistor; 4700 by default.")
]
RateOption: TypeAlias = Annotated[
    float | None, typer.Option(help="Its frames per second; 250 by default.")
]
BaudOption: TypeAlias = Annotated[
    int | None, typer.Option(help="Speed of its firmware; 1000000 by default.")
]
