"""`palpate pattern`: files for a vinyl cutter, from a few numbers in millimetres."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.errors import InputError, MissingExtraError

if TYPE_CHECKING:
    from palpate.fabrication.design import SensorDesign
    from palpate.fabrication.pattern import Pattern
    from palpate.fabrication.rest_resistance import RestExpectation


class Shape(StrEnum):
    """Shape of the pixels."""

    RECTANGLE = "rectangle"
    ROUNDED = "rounded"
    CIRCLE = "circle"


_SHEET = "Expected rest resistance"
_TAIL = "Copper and tape"
_CUTTER = "What can be cut"


def pattern(
    out: Annotated[Path, typer.Option(help="Folder for the files; made if absent.")],
    preset: Annotated[
        str, typer.Option(help="Start from paper-2x2 or paper-3x2.", metavar="NAME")
    ] = "paper-2x2",
    name: Annotated[
        str | None, typer.Option(help="Stem of the files; the preset's by default.")
    ] = None,
    rows: Annotated[int | None, typer.Option(help="Pixels along the finger.")] = None,
    cols: Annotated[int | None, typer.Option(help="Pixels across it.")] = None,
    pixel: Annotated[
        str | None, typer.Option(help="Size of a pixel: 7, or 7x9 for width x height.")
    ] = None,
    shape: Annotated[Shape, typer.Option(help="Shape of the pixels.")] = Shape.RECTANGLE,
    corner: Annotated[float, typer.Option(help="Corner radius of rounded pixels.")] = 1.5,
    gap: Annotated[float | None, typer.Option(help="Between pixels.")] = None,
    overhang: Annotated[
        float | None,
        typer.Option(help="Velostat round the crossing copper; 1 by default."),
    ] = None,
    trace: Annotated[
        float | None,
        typer.Option(help="Width of traces; 1.2 by default.", rich_help_panel=_TAIL),
    ] = None,
    pad: Annotated[
        str | None,
        typer.Option(help="Solder pad, WxL; 1.6x5 by default.", rich_help_panel=_TAIL),
    ] = None,
    pad_pitch: Annotated[
        float | None,
        typer.Option(help="Between pads; 2.54 by default.", rich_help_panel=_TAIL),
    ] = None,
    tail: Annotated[
        float | None,
        typer.Option(help="From pixels to pads; 20 by default.", rich_help_panel=_TAIL),
    ] = None,
    margin: Annotated[
        float | None,
        typer.Option(help="Tape round it all; 3 by default.", rich_help_panel=_TAIL),
    ] = None,
    width: Annotated[
        float | None,
        typer.Option(
            help="Width of base and cover, as the finger has it; what fits by default.",
            rich_help_panel=_TAIL,
        ),
    ] = None,
    min_feature: Annotated[
        float, typer.Option(help="Narrowest strip.", rich_help_panel=_CUTTER)
    ] = 1.0,
    min_gap: Annotated[float, typer.Option(help="Narrowest gap.", rich_help_panel=_CUTTER)] = 0.5,
    sheet: Annotated[
        str, typer.Option(help="Cutting area, WxH.", rich_help_panel=_CUTTER)
    ] = "296x298",
    measured_ohm: Annotated[
        float | None,
        typer.Option(help="Rest resistance of a pixel of yours.", rich_help_panel=_SHEET),
    ] = None,
    measured_mm2: Annotated[
        float | None,
        typer.Option(
            help="Its copper contact area; this design's by default.", rich_help_panel=_SHEET
        ),
    ] = None,
    resistivity: Annotated[
        float, typer.Option(help="Of the sheet, ohm cm.", rich_help_panel=_SHEET)
    ] = 500.0,
    thickness: Annotated[float, typer.Option(help="Of the sheet.", rich_help_panel=_SHEET)] = 0.1,
    dxf: Annotated[bool, typer.Option("--dxf", help="Write DXF files as well.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document.")] = False,
) -> None:
    """Draw the cut files of a sensor: base, copper, Velostat, copper, cover. Lengths in mm.

    Example: palpate pattern --preset paper-3x2 --out sensor
    """
    from palpate.fabrication.design import Cutter
    from palpate.fabrication.pattern import lay_out
    from palpate.fabrication.refusals import check_design, check_pattern

    changes = {
        "name": name,
        "rows": rows,
        "cols": cols,
        "gap_mm": gap,
        "overhang_mm": overhang,
        "trace_mm": trace,
        "pad_pitch_mm": pad_pitch,
        "tail_mm": tail,
        "margin_mm": margin,
        "substrate_width_mm": width,
    }
    if pixel is not None:
        changes["pixel_width_mm"], changes["pixel_height_mm"] = _size(pixel, option="--pixel")
    if pad is not None:
        changes["pad_width_mm"], changes["pad_length_mm"] = _size(pad, option="--pad")
    design = _design(preset, changes={k: v for k, v in changes.items() if v is not None})
    design = replace(design, corner_mm=_corner_mm(design, shape=shape, corner_mm=corner))
    sheet_mm = _size(sheet, option="--sheet")
    cutter = Cutter(
        width_mm=sheet_mm[0], height_mm=sheet_mm[1], feature_mm=min_feature, gap_mm=min_gap
    )
    check_design(design, cutter=cutter)
    drawn = lay_out(design)
    check_pattern(drawn, cutter=cutter)
    expected = _expectation(
        drawn,
        measured_ohm=measured_ohm,
        measured_mm2=measured_mm2,
        resistivity=resistivity,
        thickness=thickness,
    )
    files = _write(drawn, out, dxf=dxf)
    if as_json:
        print(json.dumps(_summary(drawn, expected, files), indent=1))
    else:
        _print(drawn, expected, files)


def _design(preset: str, *, changes: dict[str, Any]) -> SensorDesign:
    from palpate.fabrication.design import PRESETS

    if preset not in PRESETS:
        raise InputError(f"--preset {preset}: there are {', '.join(PRESETS)}")
    if not re.fullmatch(r"[\w.-]+", changes.get("name", preset)):
        raise InputError(f"--name {changes['name']!r}: use letters, digits, '-', '_' and '.'")
    return replace(PRESETS[preset], **changes)


def _corner_mm(design: SensorDesign, *, shape: Shape, corner_mm: float) -> float:
    if shape is Shape.RECTANGLE:
        return 0.0
    if shape is Shape.ROUNDED:
        return corner_mm
    if design.pixel_width_mm != design.pixel_height_mm:
        raise InputError(
            f"--shape circle with --pixel {design.pixel_width_mm:g}x{design.pixel_height_mm:g}: "
            "a circle is as wide as high; give one number"
        )
    return design.pixel_width_mm / 2


def _size(text: str, *, option: str) -> tuple[float, float]:
    """Return width and height of ``"7"`` or ``"7x9"``.

    Examples
    --------
    >>> _size("7x9.5", option="--pixel"), _size("7", option="--pixel")
    ((7.0, 9.5), (7.0, 7.0))
    """
    try:
        numbers = [float(part) for part in text.lower().split("x")]
    except ValueError:
        numbers = []
    if len(numbers) == 1:
        numbers *= 2
    if len(numbers) != 2:
        raise InputError(f"{option} {text}: give millimetres, such as 7 or 7x9")
    return numbers[0], numbers[1]


def _expectation(
    drawn: Pattern,
    *,
    measured_ohm: float | None,
    measured_mm2: float | None,
    resistivity: float,
    thickness: float,
) -> RestExpectation:
    from palpate.fabrication.rest_resistance import from_measurement, from_sheet

    if measured_ohm is None:
        if measured_mm2 is not None:
            raise InputError("--measured-mm2 needs --measured-ohm beside it")
        return from_sheet(volume_ohm_cm=resistivity, thickness_mm=thickness)
    contact = drawn.pixels[0].contact
    area_mm2 = contact.width * contact.height if measured_mm2 is None else measured_mm2
    return from_measurement(ohm=measured_ohm, contact_mm2=area_mm2)


def _write(drawn: Pattern, folder: Path, *, dxf: bool) -> list[Path]:
    """Write every file whole or not at all; return them in order."""
    from palpate.fabrication.dxf import require_dxf, write_dxf
    from palpate.fabrication.svg import combined_svg, layer_svg
    from palpate.files import atomic_path
    from palpate.plots.pattern import draw_pattern

    if dxf:
        require_dxf()
    folder.mkdir(parents=True, exist_ok=True)
    name, files = drawn.design.name, []
    for layer in drawn.layers():
        files.append(folder / f"{name}-{layer.name}.svg")
        with atomic_path(files[-1]) as partial:
            partial.write_text(layer_svg(drawn, layer), encoding="utf-8")
        if dxf:
            files.append(folder / f"{name}-{layer.name}.dxf")
            with atomic_path(files[-1]) as partial:
                write_dxf(drawn, layer, partial)
    files.append(folder / f"{name}.svg")
    with atomic_path(files[-1]) as partial:
        partial.write_text(combined_svg(drawn), encoding="utf-8")
    try:
        draw_pattern(drawn, folder / f"{name}.png")
    except MissingExtraError as error:
        # The cut files are what was asked for; the picture is beside them.
        print(f"palpate pattern: no preview: {error}", file=sys.stderr)
    else:
        files.append(folder / f"{name}.png")
    return files


def _summary(drawn: Pattern, expected: RestExpectation, files: list[Path]) -> dict[str, object]:
    return {
        "name": drawn.design.name,
        "rows": drawn.design.rows,
        "cols": drawn.design.cols,
        "pitch_mm": list(drawn.design.pitch_mm),
        "sheet_mm": {"width": round(drawn.width, 4), "height": round(drawn.height, 4)},
        "marks_mm": [[round(x, 4), round(y, 4)] for x, y in drawn.marks],
        "layers": [
            {
                "name": layer.name,
                "material": layer.material,
                "mirrored": layer.mirrored,
                "why": layer.why,
                "cut_mm": round(sum(part.length() for part in layer.parts), 1),
            }
            for layer in drawn.layers()
        ],
        "pixels": [
            {
                "row": p.row,
                "col": p.col,
                "x_mm": round(p.body.centre[0], 4),
                "y_mm": round(p.body.centre[1], 4),
                "contact_mm2": round(p.contact.width * p.contact.height, 3),
                "rest_ohm": round(
                    expected.rest_ohm(contact_mm2=p.contact.width * p.contact.height), 1
                ),
            }
            for p in drawn.pixels
        ],
        "rest_ohm_basis": expected.basis,
        "files": [str(file) for file in files],
    }


def _print(drawn: Pattern, expected: RestExpectation, files: list[Path]) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console()
    layers = Table("layer", "material", "file shows it", "because it is", box=None, pad_edge=False)
    for layer in drawn.layers():
        layers.add_row(
            layer.name, layer.material, "mirrored" if layer.mirrored else "as is", layer.why
        )
    pixels = Table("pixel", "x, mm", "y, mm", "contact, mm²", "rest, ohm (rough)", box=None)
    for p in drawn.pixels:
        area = p.contact.width * p.contact.height
        pixels.add_row(
            f"R{p.row} C{p.col}",
            *(f"{value:.2f}" for value in (*p.body.centre, area)),
            f"{expected.rest_ohm(contact_mm2=area):.3g}",
        )
    apart_mm = drawn.marks[1][0] - drawn.marks[0][0]
    console.print(layers)
    console.print()
    console.print(pixels)
    console.print(f"Rest resistance: {expected.basis}.", highlight=False)
    console.print(
        f"\nSheet {drawn.width:.2f} x {drawn.height:.2f} mm; after import the upper marks must be "
        f"{apart_mm:.2f} mm apart, centre to centre.\nWrote {len(files)} files to "
        f"{files[0].parent}.",
        highlight=False,
    )
