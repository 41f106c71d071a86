"""The gripper to cut: gears mesh over the whole travel, parts fit, and the files hold them."""

from __future__ import annotations

import json
import math
from pathlib import Path

import ezdxf
import numpy as np
import pytest
from shapely import affinity
from shapely.geometry import Polygon

from palpate.cli import build_app, run
from palpate.cli.init import _SERVO
from palpate.fabrication.gripper import (
    CLOSED,
    OPEN,
    PITCH_RADIUS,
    Part,
    draw_pinion,
    draw_rack,
    list_parts,
    nest,
    turn,
)
from palpate.fabrication.shapes import Outline
from palpate.plots.pattern import points_of


def filled(part: Part) -> Polygon:
    return Polygon(points_of(part.edge), [points_of(hole) for hole in part.holes])


def shape(outline: Outline) -> Polygon:
    return Polygon(points_of(outline))


@pytest.fixture(scope="module")
def parts() -> dict[str, Part]:
    return {part.name: part for part in list_parts()}


@pytest.mark.parametrize("opening_mm", np.linspace(CLOSED, OPEN, 12).tolist())
def test_pinion_meshes_with_both_racks_at_every_opening(opening_mm: float) -> None:
    turned = (opening_mm - (OPEN + CLOSED) / 2) / 2 / PITCH_RADIUS
    pinion = affinity.rotate(shape(draw_pinion()), turned, origin=(0, 0), use_radians=True)
    rack = draw_rack(opening_mm)
    for one in (shape(rack), shape(turn(Part(name="rack", edge=rack)).edge)):
        assert pinion.intersection(one).area < 0.02
        assert pinion.distance(one) < 0.05
    # A tooth of another phase jams.
    wrong = affinity.rotate(pinion, math.pi / 28, origin=(0, 0), use_radians=True)
    assert wrong.intersection(shape(rack)).area > 1.0


def test_parts_fit_each_other(parts: dict[str, Part]) -> None:
    rail, plate = filled(parts["rail"]), shape(parts["lid"].edge)
    for opening_mm in np.linspace(CLOSED, OPEN, 5):
        rack = shape(draw_rack(float(opening_mm)))
        assert rail.distance(rack) == pytest.approx(0.1, abs=1e-6)
        assert plate.contains(rack)
        slider = parts["slider"].move((float(opening_mm) - CLOSED) / 2, 0.0)
        assert filled(parts["lid"]).intersection(shape(slider.edge)).area < 1e-9
    deck = filled(parts["deck"])
    assert deck.is_valid
    assert deck.interiors
    bolts = [shape(hole).centroid for hole in parts["rack"].holes]
    on_finger = [shape(hole).centroid for hole in parts["finger"].holes]
    assert all(any(bolt.distance(hole) < 1e-9 for hole in on_finger) for bolt in bolts)


@pytest.mark.parametrize("thickness_mm", [2.0, 3.0, 6.0])
def test_tabs_of_pads_and_gussets_are_as_long_as_the_sheet_is_thick(thickness_mm: float) -> None:
    parts = {part.name: part for part in list_parts(thickness_mm=thickness_mm)}
    assert parts["pad"].box.height == pytest.approx(30.0 + thickness_mm)
    assert parts["gusset"].box.height == pytest.approx(22.0 + thickness_mm)
    assert all(filled(part).is_valid for part in parts.values())


def test_pieces_lie_apart_on_the_sheet() -> None:
    pieces, sheet = nest(list_parts(), width_mm=296.0)
    bodies = [shape(piece.edge) for piece in pieces]
    for number, body in enumerate(bodies):
        assert body.bounds[0] > 1.0
        assert body.bounds[2] < sheet.right - 1.0
        assert body.bounds[3] < sheet.bottom - 1.0
        assert all(body.distance(other) > 1.0 for other in bodies[:number])


def test_travel_is_that_of_the_rig_file_that_init_writes() -> None:
    turned = math.radians(0.09) * (float(_SERVO["closed_us"]) - float(_SERVO["open_us"]))
    assert (_SERVO["open_mm"], _SERVO["closed_mm"]) == (OPEN, CLOSED)
    assert 2 * PITCH_RADIUS * turned == pytest.approx(OPEN - CLOSED, abs=0.2)


def test_files_hold_every_piece(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ("pattern", "--gripper", "--out", str(tmp_path), "--dxf", "--json")
    assert run(build_app(), arguments, name="palpate") == 0
    document = json.loads(capsys.readouterr().out)
    assert [Path(file).name for file in document["files"]] == [
        "gripper.svg",
        "gripper.dxf",
        "gripper.png",
    ]
    pieces, _ = nest(list_parts(), width_mm=296.0)
    wanted = sum(line.length() for piece in pieces for line in (piece.edge, *piece.holes))
    lines = ezdxf.readfile(tmp_path / "gripper.dxf").modelspace().query("LWPOLYLINE")
    assert len(lines) == sum(1 + len(piece.holes) for piece in pieces)
    read = 0.0
    for line in lines:
        corners = list(line.get_points("xyb"))
        for (x0, y0, bulge), (x1, y1, _) in zip(corners, [*corners[1:], corners[0]], strict=True):
            chord = math.hypot(x1 - x0, y1 - y0)
            angle = 4 * math.atan(abs(bulge))
            read += chord if bulge == 0 else chord * angle / (2 * math.sin(angle / 2))
    assert read == pytest.approx(wanted, rel=1e-6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--thickness", "1"), "from a sheet of 2 to 6 mm"),
        (("--rows", "3"), "--rows: is of a sensor"),
        (("--sheet", "100x100"), "the parts need"),
    ],
)
def test_what_does_not_fit_a_gripper_is_refused(
    options: tuple[str, ...],
    message: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    arguments = ("pattern", "--gripper", "--out", str(tmp_path / "new"), *options)
    assert run(build_app(), arguments, name="palpate") == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "new").exists()
