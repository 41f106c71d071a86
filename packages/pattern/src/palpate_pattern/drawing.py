"""Cut patterns as SVG and DXF files."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from pathlib import Path

from palpate.errors import require_extra
from palpate_pattern.pattern import Layer, Pattern
from palpate_pattern.shapes import Outline, arc_radius

_HEAD = (
    '<svg xmlns="http://www.w3.org/2000/svg" '
    'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" version="1.1"'
)
#: Fill colour, opacity and line colour of each layer in the combined drawing.
LAYER_COLOURS: dict[str, tuple[str, float, str]] = {
    "1-base": ("#f3e3b3", 0.9, "#b59b4c"),
    "2-copper-rows": ("#c8763a", 0.95, "#8a4b1e"),
    "3-velostat": ("#2b333b", 0.78, "#11161a"),
    "4-copper-columns": ("#e0a062", 0.72, "#8a4b1e"),
    "5-cover": ("#cfe3ee", 0.28, "#5b8aa3"),
}


def draw_layer_svg(pattern: Pattern, layer: Layer) -> str:
    """Return an SVG with the cuts of one sheet, as hairlines in millimetres."""
    side = "mirrored" if layer.mirrored else "not mirrored"
    return "\n".join(
        [
            _opening(pattern),
            f"<title>{escape(f'{pattern.design.name} {layer.name}')}</title>",
            f"<desc>{escape(f'{layer.material}, {side}: {layer.why}')}. Millimetres.</desc>",
            '<g fill="none" stroke="#d00000" stroke-width="0.1">',
            *_paths(_list_cuts(pattern, layer)),
            "</g>",
            "</svg>\n",
        ]
    )


def write_layer_dxf(pattern: Pattern, layer: Layer, path: Path) -> None:
    """Write a DXF file with the lines of the SVG, y axis up.

    Arcs are preserved (polylines with bulges); the unit is millimetres.
    """
    require_dxf()
    from ezdxf import units
    from ezdxf.document import Drawing

    document = Drawing.new("R2010")
    document.units = units.MM
    document.layers.add(layer.name, color=1)
    space = document.modelspace()
    for outline in _list_cuts(pattern, layer):
        space.add_lwpolyline(
            [(v.x, pattern.height - v.y, -v.bulge) for v in outline.vertices],
            format="xyb",
            close=True,
            dxfattribs={"layer": layer.name},
        )
    document.saveas(path)


def _list_cuts(pattern: Pattern, layer: Layer) -> list[Outline]:
    """Return the lines of a layer and its marks, mirrored if necessary."""
    cuts = [*layer.parts, *pattern.mark_outlines]
    return [cut.mirror(pattern.width) for cut in cuts] if layer.mirrored else cuts


def draw_combined_svg(pattern: Pattern) -> str:
    """Return an SVG with all layers seen from the cover, with names and dimensions."""
    parts = [
        _opening(pattern),
        f"<title>{escape(pattern.design.name)}, seen from the cover</title>",
        f'<rect width="{_mm(pattern.width)}" height="{_mm(pattern.height)}" fill="#ffffff"/>',
    ]
    for layer in pattern.layers():
        fill, opacity, line = LAYER_COLOURS[layer.name]
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
        _group("dimensions"),
        *_dimensions(pattern),
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


def _dimensions(pattern: Pattern) -> Iterable[str]:
    """Draw the dimensions of the body, and the pixels' size and pitch."""
    body, design, out = pattern.body, pattern.design, 2.0
    style = 'font-family="sans-serif" font-size="1.6" fill="#404040"'
    x, y = body.centre
    across, along = body.top - out, body.right + out
    line = (
        f"M {_mm(body.left)} {_mm(across)} H {_mm(body.right)} "
        f"M {_mm(along)} {_mm(body.top)} V {_mm(body.bottom)}"
    )
    for end in (body.left, body.right):
        line += f" M {_mm(end)} {_mm(across - 0.7)} v 1.4"
    for end in (body.top, body.bottom):
        line += f" M {_mm(along - 0.7)} {_mm(end)} h 1.4"
    yield f'<path d="{line}" fill="none" stroke="#404040" stroke-width="0.15"/>'
    yield (
        f'<text x="{_mm(x)}" y="{_mm(across - 0.8)}" text-anchor="middle" {style}>'
        f"{body.width:.4g}</text>"
    )
    yield (
        f'<text transform="translate({_mm(along + 2.2)} {_mm(y)}) rotate(-90)" '
        f'text-anchor="middle" {style}>{body.height:.4g}</text>'
    )
    pixel, pitch = (design.pixel_width_mm, design.pixel_height_mm), design.pitch_mm
    words = (
        f"pixel {pixel[0]:g} x {pixel[1]:g} mm",
        f"pitch {pitch[0]:g} x {pitch[1]:g} mm",
    )
    for number, text in enumerate(words):
        below = _mm(body.bottom + 3.0 + 2.2 * number)
        at = f'x="{_mm(pattern.width - out)}" y="{below}" text-anchor="end"'
        yield f"<text {at} {style}>{text}</text>"


def _paths(outlines: Iterable[Outline]) -> Iterable[str]:
    return (f'<path d="{path_data(outline)}"/>' for outline in outlines)


def path_data(outline: Outline) -> str:
    """Return the SVG path data of an outline.

    >>> from palpate_pattern.shapes import polygon
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
    """Format a length to 0.1 micrometres without trailing zeros."""
    text = f"{value:.4f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def require_dxf() -> None:
    """Check early that DXF files can be written.

    Raises `MissingExtraError` if ezdxf is not installed.
    """
    with require_extra("DXF", extra="dxf", package="palpate-pattern"):
        import ezdxf
    del ezdxf
