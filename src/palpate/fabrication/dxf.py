"""DXF files of the layers, through ezdxf."""

from __future__ import annotations

from pathlib import Path

from palpate.errors import needing
from palpate.fabrication.pattern import Layer, Pattern


def require_dxf() -> None:
    """Refuse early where DXF can't be written.

    Raises
    ------
    MissingExtraError
        If ezdxf is not installed.
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
        seen = outline.mirrored(pattern.width) if layer.mirrored else outline
        space.add_lwpolyline(
            [(v.x, pattern.height - v.y, -v.bulge) for v in seen.vertices],
            format="xyb",
            close=True,
            dxfattribs={"layer": layer.name},
        )
    document.saveas(path)
