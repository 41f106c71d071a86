"""The options of `palpate pattern`: sizes of the sensor, of its tail, of what can be cut."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import typer

_SHEET = "Expected rest resistance"
_TAIL = "Copper and tape"
_CUTTER = "What can be cut"


Shape: TypeAlias = Literal["rectangle", "rounded", "circle"]
FolderOption: TypeAlias = Annotated[
    Path, typer.Option(help="Folder for the files; made if absent.", metavar="DIR")
]
PresetOption: TypeAlias = Annotated[
    str, typer.Option(help="Start from paper-2x2, paper-3x2 or so101.", metavar="NAME")
]
NameOption: TypeAlias = Annotated[
    str | None, typer.Option(help="Stem of the files; the preset's by default.")
]
RowsOption: TypeAlias = Annotated[int | None, typer.Option(help="Pixels along the finger.")]
ColsOption: TypeAlias = Annotated[int | None, typer.Option(help="Pixels across it.")]
PixelOption: TypeAlias = Annotated[
    str | None, typer.Option(help="Size of a pixel: 7, or 7x9 for width x height.")
]
ShapeOption: TypeAlias = Annotated[
    Shape, typer.Option(help="Of the pixels: rectangle, rounded or circle.", metavar="SHAPE")
]
CornerOption: TypeAlias = Annotated[float, typer.Option(help="Corner radius of rounded pixels.")]
GapOption: TypeAlias = Annotated[float | None, typer.Option(help="Between pixels.")]
OverhangOption: TypeAlias = Annotated[
    float | None, typer.Option(help="Velostat round the crossing copper; 1 by default.")
]
DxfOption: TypeAlias = Annotated[bool, typer.Option("--dxf", help="Write DXF files as well.")]

TraceOption: TypeAlias = Annotated[
    float | None, typer.Option(help="Width of traces; 1.2 by default.", rich_help_panel=_TAIL)
]
PadOption: TypeAlias = Annotated[
    str | None, typer.Option(help="Solder pad, WxL; 1.6x5 by default.", rich_help_panel=_TAIL)
]
PadPitchOption: TypeAlias = Annotated[
    float | None, typer.Option(help="Between pads; 2.54 by default.", rich_help_panel=_TAIL)
]
TailOption: TypeAlias = Annotated[
    float | None, typer.Option(help="From pixels to pads; 20 by default.", rich_help_panel=_TAIL)
]
MarginOption: TypeAlias = Annotated[
    float | None, typer.Option(help="Tape round it all; 3 by default.", rich_help_panel=_TAIL)
]
WidthOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        help="Width of base and cover, as the finger has it; what fits by default.",
        rich_help_panel=_TAIL,
    ),
]

MinFeatureOption: TypeAlias = Annotated[
    float, typer.Option(help="Narrowest strip.", rich_help_panel=_CUTTER)
]
MinGapOption: TypeAlias = Annotated[
    float, typer.Option(help="Narrowest gap.", rich_help_panel=_CUTTER)
]
SheetOption: TypeAlias = Annotated[
    str, typer.Option(help="Cutting area, WxH.", rich_help_panel=_CUTTER)
]

MeasuredOhmOption: TypeAlias = Annotated[
    float | None, typer.Option(help="Rest resistance of a pixel of yours.", rich_help_panel=_SHEET)
]
MeasuredAreaOption: TypeAlias = Annotated[
    float | None,
    typer.Option(help="Its copper contact area; this design's by default.", rich_help_panel=_SHEET),
]
ResistivityOption: TypeAlias = Annotated[
    float, typer.Option(help="Of the sheet, ohm cm.", rich_help_panel=_SHEET)
]
ThicknessOption: TypeAlias = Annotated[
    float, typer.Option(help="Of the sheet.", rich_help_panel=_SHEET)
]
