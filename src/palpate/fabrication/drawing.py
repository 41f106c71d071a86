"""Cut patterns as SVG and DXF files."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from pathlib import Path

from palpate.errors import needing
from palpate.fabrication.pattern import Layer, Pattern
from palpate.fabrication.shapes import Outline, arc_radius

_HEAD = (
    '<svg xmlns="http://www.w3.org/2000/svg" '
    'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" version="1.1"'
)
#: Fill, its opacity, and line of each layer in the combined drawing.
LOOKS: dict[str, tuple[str, float, str]] = {
    "1-base": ("#f3e3b3", 0.9, "#b59b4c"),
    "2-copper-rows": ("#c8763a", 0.95, "#8a4b1e"),
    "3-velostat": ("#2b333b", 0.78, "#11161a"),
    "4-copper-columns": ("#e0a062", 0.72, "#8a4b1e"),
    "5-cover": ("#cfe3ee", 0.28, "#5b8aa3"),
}


def layer_svg(pattern: Pattern, layer: Layer) -> str:
    """Return the cut file of a layer: hairlines in millimetres, mirrored where it must be."""
    outlines = [*layer.parts, *pattern.mark_outlines]
    if layer.mirrored:
        outlines = [outline.mirror(pattern.width) for outline in outlines]
    side = "mirrored" if layer.mirrored else "not mirrored"
    return "\n".join(
        [
            _opening(pattern),
            f"<title>{escape(pattern.design.name)} {layer.name}</title>",
            f"<desc>{escape(layer.material)}, {side}: {escape(layer.why)}. Millimetres.</desc>",
            '<g fill="none" stroke="#d00000" stroke-width="0.1">',
            *_paths(outlines),
            "</g>",
            "</svg>\n",
        ]
    )


def draw_combined_svg(pattern: Pattern) -> str:
    """Return all layers as Inkscape layers, seen from the cover, with names of the pads."""
    parts = [
        _opening(pattern),
        f"<title>{escape(pattern.design.name)}, seen from the cover</title>",
        f'<rect width="{_mm(pattern.width)}" height="{_mm(pattern.height)}" fill="#ffffff"/>',
    ]
    for layer in pattern.layers():
        fill, opacity, line = LOOKS[layer.name]
        parts += [
            _group(layer.name),
            f'<g fill="{fill}" fill-opacity="{opacity:g}" stroke="{line}" stroke-width="0.15">',
            *_paths(layer.parts),
            "</g></g>",
        ]
    parts += [
        _group("marks"),
        '<g fill="none" stroke="#d00000" stroke-width="0.2">',
        *_paths(pattern.mark_outlines),
        "</g></g>",
        _group("names"),
        *_names(pattern),
        "</g>",
        "</svg>\n",
    ]
    return "\n".join(parts)


def _opening(pattern: Pattern) -> str:
    width, height = _mm(pattern.width), _mm(pattern.height)
    return f'{_HEAD} width="{width}mm" height="{height}mm" viewBox="0 0 {width} {height}">'


def _group(name: str) -> str:
    return f'<g id="{name}" inkscape:groupmode="layer" inkscape:label="{name}">'


def _names(pattern: Pattern) -> Iterable[str]:
    size = min(1.6, 0.6 * pattern.design.pad_pitch_mm)
    style = f'font-family="sans-serif" font-size="{size:g}" text-anchor="middle"'
    for letter, nets in (("R", pattern.rows), ("C", pattern.cols)):
        for i, net in enumerate(nets):
            x, y = net.points[-1]
            yield f'<text x="{_mm(x)}" y="{_mm(y + 1.2 * size)}" {style}>{letter}{i}</text>'
    for pixel in pattern.pixels:
        x, y = pixel.body.centre
        yield (
            f'<text x="{_mm(x)}" y="{_mm(y + 0.35 * size)}" fill="#ffffff" {style}>'
            f"R{pixel.row} C{pixel.col}</text>"
        )


def _paths(outlines: Iterable[Outline]) -> Iterable[str]:
    return (f'<path d="{path_data(outline)}"/>' for outline in outlines)


def path_data(outline: Outline) -> str:
    """Return the `d` of an outline.

    >>> from palpate.fabrication.shapes import polygon
    >>> path_data(polygon([(0, 0), (2.5, 0), (0, 1)]))
    'M 0 0 L 2.5 0 L 0 1 L 0 0 Z'
    """
    first = outline.vertices[0]
    words = [f"M {_mm(first.x)} {_mm(first.y)}"]
    for one, two in outline.edges():
        end = f"{_mm(two.x)} {_mm(two.y)}"
        if one.bulge == 0:
            words.append(f"L {end}")
        else:
            radius = _mm(arc_radius(one, two))
            words.append(f"A {radius} {radius} 0 0 {int(one.bulge > 0)} {end}")
    return " ".join([*words, "Z"])


def _mm(value: float) -> str:
    """Write a length to a tenth of a micrometre, without needless zeros."""
    text = f"{value:.4f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def require_dxf() -> None:
    """Refuse early where DXF can't be written.

    Raises `MissingExtraError` if ezdxf is not installed.
    """
    with needing("DXF", extra="fabrication"):
        import ezdxf
    del ezdxf


def write_dxf(pattern: Pattern, layer: Layer, path: Path) -> None:
    """Write the cut file of a layer: the same lines as its SVG, y up as DXF has it.

    Arcs stay arcs (polylines with bulges), the unit is stated as millimetres.
    """
    require_dxf()
    from ezdxf import units
    from ezdxf.document import Drawing

    document = Drawing.new("R2010")
    document.units = units.MM
    document.layers.add(layer.name, color=1)
    space = document.modelspace()
    for outline in (*layer.parts, *pattern.mark_outlines):
        seen = outline.mirror(pattern.width) if layer.mirrored else outline
        space.add_lwpolyline(
            [(v.x, pattern.height - v.y, -v.bulge) for v in seen.vertices],
            format="xyb",
            close=True,
            dxfattribs={"layer": layer.name},
        )
    document.saveas(path)
