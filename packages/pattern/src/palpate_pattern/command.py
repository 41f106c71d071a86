"""`palpate pattern`: cut files of a sensor for a vinyl cutter."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import typer

from palpate.cli.options import JsonOption, opt
from palpate.cli.output import print_json
from palpate.errors import InputError
from palpate.files import atomic_path
from palpate.terminal_table import make_console, print_table
from palpate_pattern.design import PRESETS, Cutter, SensorDesign
from palpate_pattern.drawing import (
    draw_combined_svg,
    draw_layer_svg,
    require_dxf,
    write_layer_dxf,
)
from palpate_pattern.pattern import Pattern, lay_out
from palpate_pattern.refusals import check_design, check_pattern

_TAIL, _CUTTER = "Copper and tape", "Limits of the cutter"
Shape: TypeAlias = Literal["rectangle", "rounded", "circle"]


def _number(text: str, panel: str | None = None, metavar: str = "MM") -> Any:
    return typer.Option(help=text, rich_help_panel=panel, metavar=metavar)


Size: TypeAlias = float | None


def pattern(
    out: Annotated[Path, opt("--out DIR", "Output folder, created if absent.")],
    preset: Annotated[
        str, opt("--preset NAME", "Start from paper-2x2, paper-3x2 or so101.")
    ] = "paper-2x2",
    name: Annotated[
        str | None, opt("--name NAME", "Stem of the file names. [default: the preset's]")
    ] = None,
    rows: Annotated[int | None, _number("Number of pixels along the finger.", None, "N")] = None,
    cols: Annotated[int | None, _number("Number of pixels across the finger.", None, "N")] = None,
    pixel: Annotated[
        str | None, _number("Size of a pixel: 7, or 7x9 for width x height.", None, "WxH")
    ] = None,
    shape: Annotated[
        Shape, opt("--shape SHAPE", "Shape of the pixels: rectangle, rounded or circle.")
    ] = "rectangle",
    corner: Annotated[float, _number("Corner radius of rounded pixels.")] = 1.5,
    gap: Annotated[Size, _number("Gap between pixels.")] = None,
    overhang: Annotated[Size, _number("Velostat beyond the copper.")] = None,
    trace: Annotated[Size, _number("Width of traces.", _TAIL)] = None,
    pad: Annotated[str | None, _number("Size of a solder pad.", _TAIL, "WxL")] = None,
    pad_pitch: Annotated[Size, _number("Pitch of pads.", _TAIL)] = None,
    tail: Annotated[Size, _number("Length from pixels to pads.", _TAIL)] = None,
    margin: Annotated[Size, _number("Tape margin.", _TAIL)] = None,
    width: Annotated[Size, _number("Width of base and cover; minimal by default.", _TAIL)] = None,
    min_feature: Annotated[float, _number("Narrowest strip.", _CUTTER)] = 1.0,
    min_gap: Annotated[float, _number("Narrowest gap.", _CUTTER)] = 0.5,
    sheet: Annotated[str, _number("Cutting area.", _CUTTER, "WxH")] = "296x298",
    dxf: Annotated[bool, opt("--dxf", "Write DXF files as well.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Draw the cut files of a sensor: base, copper, Velostat, copper and cover.

    Lengths are in mm. Dimensions without an option are those of the preset.

    Example: palpate pattern --preset paper-3x2 --out sensor
    """
    if name is not None and not re.fullmatch(r"[\w.-]+", name):
        raise InputError(f"--name {name!r}: use letters, digits, '-', '_' and '.'")
    changes: dict[str, Any] = {
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
        changes["pixel_width_mm"], changes["pixel_height_mm"] = _parse_size(pixel, option="--pixel")
    if pad is not None:
        changes["pad_width_mm"], changes["pad_length_mm"] = _parse_size(pad, option="--pad")
    if preset not in PRESETS:
        raise InputError(f"no preset {preset!r}; available: {', '.join(PRESETS)}")
    given = {key: value for key, value in changes.items() if value is not None}
    width_mm, height_mm = _parse_size(sheet, option="--sheet")
    design = replace(PRESETS[preset], **given)
    design = replace(design, corner_mm=_corner_mm(design, shape=shape, corner_mm=corner))
    cutter = Cutter(width_mm=width_mm, height_mm=height_mm, feature_mm=min_feature, gap_mm=min_gap)
    check_design(design, cutter=cutter)
    pattern = lay_out(design)
    check_pattern(pattern, cutter=cutter)
    document = _document(pattern, _write_files(pattern, out, dxf=dxf))
    if as_json:
        print_json(document)
    else:
        _print(document, folder=out)


def _corner_mm(design: SensorDesign, *, shape: Shape, corner_mm: float) -> float:
    if shape == "rectangle":
        return 0.0
    if shape == "rounded":
        return corner_mm
    if design.pixel_width_mm != design.pixel_height_mm:
        raise InputError(
            f"--shape circle with --pixel {design.pixel_width_mm:g}x{design.pixel_height_mm:g}: "
            "a circle needs equal width and height; give one number"
        )
    return design.pixel_width_mm / 2


def _parse_size(text: str, *, option: str) -> tuple[float, float]:
    """Return width and height of ``"7"`` or ``"7x9"``.

    >>> _parse_size("7x9.5", option="--pixel"), _parse_size("7", option="--pixel")
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


def _write_files(pattern: Pattern, folder: Path, *, dxf: bool) -> list[Path]:
    """Write the SVG and optional DXF files, each atomically."""
    if dxf:
        require_dxf()
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    stem = pattern.design.name
    for layer in pattern.layers():
        files.append(folder / f"{stem}-{layer.name}.svg")
        with atomic_path(files[-1]) as partial:
            partial.write_text(draw_layer_svg(pattern, layer), encoding="utf-8")
        if dxf:
            files.append(folder / f"{stem}-{layer.name}.dxf")
            with atomic_path(files[-1]) as partial:
                write_layer_dxf(pattern, layer, partial)
    files.append(folder / f"{stem}.svg")
    with atomic_path(files[-1]) as partial:
        partial.write_text(draw_combined_svg(pattern), encoding="utf-8")
    return files


def _document(pattern: Pattern, files: list[Path]) -> dict[str, Any]:
    """Return the JSON document; lengths in mm."""
    return {
        "name": pattern.design.name,
        "rows": pattern.design.rows,
        "cols": pattern.design.cols,
        "pitch_mm": list(pattern.design.pitch_mm),
        "sheet_mm": {"width": round(pattern.width, 4), "height": round(pattern.height, 4)},
        "marks_mm": [[round(x, 4), round(y, 4)] for x, y in pattern.marks],
        "layers": [
            {
                "name": layer.name,
                "material": layer.material,
                "mirrored": layer.mirrored,
                "why": layer.why,
                "cut_mm": round(sum(part.length() for part in layer.parts), 1),
            }
            for layer in pattern.layers()
        ],
        "pixels": [
            {
                "row": p.row,
                "col": p.col,
                "x_mm": round(p.body.centre[0], 4),
                "y_mm": round(p.body.centre[1], 4),
                "contact_mm2": round(p.contact.width * p.contact.height, 3),
            }
            for p in pattern.pixels
        ],
        "files": [str(file) for file in files],
    }


def _print(document: dict[str, Any], *, folder: Path) -> None:
    """Print the layers, the pixels and the spacing of the upper registration marks."""
    console = make_console()
    layers = [
        (row["name"], row["material"], "mirrored" if row["mirrored"] else "as is", row["why"])
        for row in document["layers"]
    ]
    print_table(("layer", "material", "in the file", "reason"), layers, console=console)
    console.print()
    pixels = [
        (
            f"R{row['row']} C{row['col']}",
            *(f"{row[name]:.2f}" for name in ("x_mm", "y_mm", "contact_mm2")),
        )
        for row in document["pixels"]
    ]
    columns = ("pixel", ">x, mm", ">y, mm", ">contact, mm²")
    print_table(columns, pixels, console=console)
    marks, sheet = document["marks_mm"], document["sheet_mm"]
    console.print(
        f"Sheet {sheet['width']:.2f} x {sheet['height']:.2f} mm; after import the upper "
        f"registration marks must be {marks[1][0] - marks[0][0]:.2f} mm apart, centre to centre.\n"
        f"Written: {len(document['files'])} files in {folder}"
    )
