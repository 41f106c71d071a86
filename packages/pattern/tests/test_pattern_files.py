"""Cut files read with independent libraries: sizes, registration, mirroring, no shorts."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import ezdxf
import pytest
import svgelements
from shapely import affinity
from shapely.geometry import Polygon
from tests.commands import Command

from palpate_pattern.design import PRESETS, SensorDesign
from palpate_pattern.drawing import draw_layer_svg
from palpate_pattern.pattern import MARK_MM, Pattern, lay_out

PX_PER_MM = 96 / 25.4
ROUND_MM = {"pixel_width_mm": 5.0, "pixel_height_mm": 5.0, "corner_mm": 2.5, "tail_mm": 30.0}
CROWDED_MM = {"pixel_width_mm": 3.0, "pixel_height_mm": 4.0, "overhang_mm": 0.6}
CROWDED_MM |= {"pad_pitch_mm": 4.0, "tail_mm": 40.0, "substrate_width_mm": 60.0}
DESIGNS = {
    **PRESETS,
    "round-4x6": SensorDesign(name="round-4x6", rows=4, cols=6, gap_mm=1.0, **ROUND_MM),
    "crowded-5x5": SensorDesign(name="crowded-5x5", rows=5, cols=5, gap_mm=0.5, **CROWDED_MM),
}


def polygons(file: Path) -> list[Polygon]:
    """Read the paths of an SVG as polygons in millimetres, with svgelements."""
    found = []
    for path in svgelements.SVG.parse(file, ppi=96).elements():
        if not isinstance(path, svgelements.Path):
            continue
        points: list[tuple[float, float]] = []
        for segment in path:
            if isinstance(segment, svgelements.Arc):
                points += [tuple(segment.point(k / 24)) for k in range(24)]
            elif isinstance(segment, svgelements.Line):
                points.append(tuple(segment.start))
        found.append(Polygon([(x / PX_PER_MM, y / PX_PER_MM) for x, y in points]))
    return found


@dataclass(frozen=True)
class Cut:
    """A pattern, with parts and marks of each layer as its file draws them."""

    design: SensorDesign
    pattern: Pattern
    drawn: dict[str, tuple[list[Polygon], list[Polygon]]]

    def parts(self, name: str) -> list[Polygon]:
        """Return the parts of a layer, mirrored back to the sensor's view."""
        [layer] = [layer for layer in self.pattern.layers() if layer.name == name]
        parts, middle = self.drawn[name][0], (self.pattern.width / 2, 0)
        if layer.mirrored:
            return [affinity.scale(part, xfact=-1, origin=middle) for part in parts]
        return parts


@pytest.fixture(scope="module", params=sorted(DESIGNS))
def cut(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Cut:
    design = DESIGNS[request.param]
    pattern, drawn = lay_out(design), {}
    for layer in pattern.layers():
        file = tmp_path_factory.getbasetemp() / "layer.svg"
        file.write_text(draw_layer_svg(pattern, layer), encoding="utf-8")
        shapes = polygons(file)
        drawn[layer.name] = (shapes[: len(layer.parts)], shapes[len(layer.parts) :])
    return Cut(design=design, pattern=pattern, drawn=drawn)


def test_pattern_svg_has_every_pixel_at_its_size_and_position(cut: Cut) -> None:
    design, pixels = cut.design, cut.parts("3-velostat")
    assert len(pixels) == design.rows * design.cols
    width_mm, height_mm = design.pixel_width_mm, design.pixel_height_mm
    for number, pixel in enumerate(pixels):
        left, top, right, bottom = pixel.bounds
        assert (right - left, bottom - top) == pytest.approx((width_mm, height_mm), abs=0.01)
        row, col = divmod(number, design.cols)
        first = pixels[0].bounds
        assert left - first[0] == pytest.approx(col * (width_mm + design.gap_mm), abs=0.01)
        assert top - first[1] == pytest.approx(row * (height_mm + design.gap_mm), abs=0.01)
        area = width_mm * height_mm - (4 - math.pi) * design.corner_mm**2
        assert pixel.area == pytest.approx(area, rel=2e-3)


def test_pattern_marks_have_equal_positions_in_every_file(cut: Cut) -> None:
    first, *others = (
        sorted(tuple(round(length, 3) for length in mark.bounds) for mark in marks)
        for _, marks in cut.drawn.values()
    )
    assert (len(first), others) == (3, 4 * [first])
    for left, _, right, _ in first:
        assert right - left == pytest.approx(MARK_MM, abs=0.01)


def test_pattern_has_no_shorts_between_nets(cut: Cut) -> None:
    design = cut.design
    rows, cols = cut.parts("2-copper-rows"), cut.parts("4-copper-columns")
    pixels = cut.parts("3-velostat")
    assert (len(rows), len(cols)) == (design.rows, design.cols)
    for same_layer in (rows, cols):
        assert all(a.is_valid for a in same_layer)
        for one, two in combinations(same_layer, 2):
            assert one.distance(two) >= 0.5 - 1e-6
    for r, row in enumerate(rows):
        for c, col in enumerate(cols):
            crossing, pixel = row.intersection(col), pixels[r * design.cols + c]
            assert pixel.buffer(1e-6).contains(crossing.buffer(0.5))
            bar_width, bar_height = design.bars_mm
            assert crossing.area == pytest.approx(bar_width * bar_height, abs=0.01)
    for number, pixel in enumerate(pixels):
        row, col = divmod(number, design.cols)
        strangers = [n for r, n in enumerate(rows) if r != row]
        strangers += [n for c, n in enumerate(cols) if c != col]
        assert all(pixel.distance(net) >= 0.5 - 1e-6 for net in strangers)


def test_pattern_pads_are_bare_and_other_copper_is_covered(cut: Cut) -> None:
    [base], [cover] = cut.parts("1-base"), cut.parts("5-cover")
    rows, cols = cut.parts("2-copper-rows"), cut.parts("4-copper-columns")
    pad_mm2 = cut.design.pad_width_mm * cut.design.pad_length_mm
    for nets, under, over in ((rows, base, cover), (cols, cover, base)):
        for net in nets:
            assert under.contains(net)
            assert net.difference(over).area == pytest.approx(pad_mm2, abs=0.2)
    taped = base.intersection(cover)
    assert all(taped.buffer(-0.45).contains(pixel) for pixel in cut.parts("3-velostat"))


def test_pattern_command_writes_and_lists_every_file(tmp_path: Path, palpate: Command) -> None:
    out = tmp_path / "new" / "sensor"
    summary = palpate("pattern", "--preset", "paper-3x2", "--out", out, "--dxf", "--json").document
    assert sorted(summary["files"]) == sorted(str(p) for p in out.iterdir())
    assert {p.suffix for p in out.iterdir()} == {".svg", ".dxf"}
    assert [layer["mirrored"] for layer in summary["layers"]] == [True, False, False, True, False]
    pixels = summary["pixels"]
    assert len(pixels) == 6
    assert pixels[0]["contact_mm2"] == 49.0
    combined = (out / "paper-3x2.svg").read_text()
    assert combined.count('inkscape:groupmode="layer"') == 8
    body = lay_out(PRESETS["paper-3x2"]).body
    for words in (f">{body.width:.4g}<", f">{body.height:.4g}<", ">pitch 10 x 10 mm<"):
        assert words in combined
    assert 'width="48.15mm"' in combined


def test_pattern_dxf_and_svg_have_equal_lines(tmp_path: Path, palpate: Command) -> None:
    palpate("pattern", "--out", tmp_path, "--shape", "rounded", "--dxf", "--json", "--name", "r")
    height = lay_out(replace(PRESETS["paper-2x2"], corner_mm=1.5)).height
    for svg in sorted(tmp_path.glob("r-*.svg")):
        document = ezdxf.readfile(svg.with_suffix(".dxf"))
        assert document.units == ezdxf.units.MM
        drawn = []
        for line in document.modelspace().query("LWPOLYLINE"):
            path = ezdxf.path.make_path(line)
            drawn.append(Polygon([(p.x, height - p.y) for p in path.flattening(0.001)]))
        lines = polygons(svg)
        assert len(lines) == len(drawn) > 3
        for one, two in zip(lines, drawn, strict=True):
            assert one.symmetric_difference(two).area < 0.02


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--gap", "0.2"], "pixels R0 C0 and R0 C1 are 0.20 mm apart, 0.30 mm less"),
        (["--pad", "2.54x5"], "traces of R0 and R1 are shorted, 0.50 mm less than"),
        (["--trace", "2.4"], "traces of R0 and R1 are 0.14 mm apart, 0.36 mm less"),
        (["--rows", "1", "--cols", "1", "--trace", "2.6"], "leave a gap of 0.00 mm at the turns"),
        (["--width", "24", "--cols", "1", "--pad-pitch", "8"], "the tail is 3.60 mm wider"),
        (["--trace", "0.8"], "trace width 0.80 mm is 0.20 mm less than the smallest feature"),
        (["--pixel", "2.5"], "column copper in the pixels 0.50 mm is 0.50 mm less"),
        (["--overhang", "0.2"], "R0 and C0 are 0.20 mm from a short next to their pixel"),
        (["--tail", "5"], "tail of 5 mm is 2.54 mm too short"),
        (["--width", "20"], "pixel R0 C1 extends 5.11 mm too far to the right"),
        (["--margin", "0.1"], "margin of 0.1 mm is 0.40 mm less than"),
        (["--rows", "16", "--pixel", "20"], "114.0 mm more than the cutter's 298 mm"),
        (["--rows", "17"], "rows and columns must be 1 to 16 each"),
        (["--shape", "rounded", "--corner", "4"], "0.50 mm more than half of the pixel"),
        (["--shape", "circle", "--pixel", "7x8"], "a circle needs equal width and height"),
        (["--pixel", "big"], "--pixel big: give millimetres"),
        (["--pad-pitch", "nan"], "pad pitch of nan mm: must be a positive length"),
        (["--preset", "other"], "no preset 'other'; available: paper-2x2, paper-3x2"),
        (["--name", "../x"], "--name '../x'"),
    ],
)
def test_pattern_command_invalid_design_is_refused_without_files(
    options: list[str], words: str, tmp_path: Path, palpate: Command
) -> None:
    out = tmp_path / "out"
    assert words in palpate.refused("pattern", "--out", out, *options)
    assert not out.exists()
