"""Output of `palpate pattern`: the cut files, and the report on them."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.errors import MissingExtraError

if TYPE_CHECKING:
    from palpate.fabrication.pattern import Pattern
    from palpate.fabrication.rest_resistance import RestExpectation


def write_files(drawn: Pattern, folder: Path, *, dxf: bool) -> list[Path]:
    """Write every file whole or not at all; return them in order."""
    from palpate.fabrication.drawing import combined_svg, layer_svg, require_dxf, write_dxf
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
        # The cut files are what was asked for; the picture is an extra.
        print(f"palpate pattern: no preview: {error}", file=sys.stderr)
    else:
        files.append(folder / f"{name}.png")
    return files


def summary(drawn: Pattern, expected: RestExpectation, files: list[Path]) -> dict[str, object]:
    """Return the JSON document: lengths in mm, resistances in ohm."""
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


def print_pattern(drawn: Pattern, expected: RestExpectation, files: list[Path]) -> None:
    """Print the layers, the pixels, and how far apart two marks must be."""
    from rich.console import Console
    from rich.table import Table

    from palpate.commands.fitted_table import fitted

    console = Console()
    layers = Table("layer", "material", "file shows it", "because it is", box=None, pad_edge=False)
    for layer in drawn.layers():
        layers.add_row(
            layer.name, layer.material, "mirrored" if layer.mirrored else "as is", layer.why
        )
    pixels = Table("pixel", box=None)
    for column in ("x, mm", "y, mm", "contact, mm²", "ohm, see below"):
        pixels.add_column(column, justify="right")
    for p in drawn.pixels:
        area = p.contact.width * p.contact.height
        pixels.add_row(
            f"R{p.row} C{p.col}",
            *(f"{value:.2f}" for value in (*p.body.centre, area)),
            _three_digits(expected.rest_ohm(contact_mm2=area)),
        )
    apart_mm = drawn.marks[1][0] - drawn.marks[0][0]
    console.print(fitted(layers, console=console))
    console.print()
    console.print(pixels)
    console.print(f"Resistance: {expected.basis}.", highlight=False)
    console.print(
        f"\nSheet {drawn.width:.2f} x {drawn.height:.2f} mm; after import the upper marks must be "
        f"{apart_mm:.2f} mm apart, centre to centre.\nWritten: {len(files)} files in "
        f"{files[0].parent}",
        highlight=False,
    )


def _three_digits(ohm: float) -> str:
    rounded = float(f"{ohm:.3g}")
    return f"{rounded:.0f}" if rounded >= 100 else f"{rounded:g}"
