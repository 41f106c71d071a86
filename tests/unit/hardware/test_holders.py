"""Printable holders: closed solids, which their pad and finger fit into with the stated gaps."""

from __future__ import annotations

import re
import runpy
from pathlib import Path
from typing import Any

import pytest
from tests.commands import Command
from tests.pages import ROOT

m = pytest.importorskip("manifold3d", reason="needs trimesh and manifold3d")
trimesh = pytest.importorskip("trimesh", reason="needs trimesh and manifold3d")

SCRIPT: dict[str, Any] = runpy.run_path(str(ROOT / "hardware" / "holders.py"))
HOLDERS, make_holder, lay_out = (SCRIPT[key] for key in ("HOLDERS", "make_holder", "lay_out"))
#: Changes with which each holder is made once more, as after measuring a gripper.
MEASURED = {
    "widowx": {"finger_width_mm": 31.0, "finger_thickness_mm": 4.5, "cushion_mm": 1.0},
    "so101": {"tie_spacing_mm": 9.0, "tie_width_mm": 2.6},
    "parallel": {"screw_spacing_mm": 45.0, "screw_mm": 4.5, "head_mm": 9.0},
}
CASES = [(name, changes) for name in HOLDERS for changes in ({}, MEASURED[name])]


def overlap_mm3(solid: Any, low: tuple[float, ...], high: tuple[float, ...]) -> float:
    """Return the volume that a box and a solid share."""
    volume: float = (solid ^ SCRIPT["box"](m, low, high)).volume()
    return volume


@pytest.mark.parametrize(("name", "changes"), CASES)
def test_holder_file_is_one_closed_solid(
    name: str, changes: dict[str, float], tmp_path: Path
) -> None:
    SCRIPT["save_stl"](make_holder(name, changes), tmp_path / "part.stl")
    mesh = trimesh.load_mesh(tmp_path / "part.stl")
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.body_count == 1
    assert 1e3 < mesh.volume < 60e3
    assert max(mesh.extents) < 100.0


@pytest.mark.parametrize(("name", "changes"), CASES)
def test_pad_fits_into_the_recess_with_the_stated_gap(name: str, changes: dict[str, float]) -> None:
    solid, plate = make_holder(name, changes), lay_out(name, changes)
    (width, length), gap = plate.pad_mm, plate.size["clearance_mm"]
    stack = plate.size["cushion_mm"] + plate.size["sensor_mm"]

    def pad(more: float) -> float:
        # Towards the open end, the tail continues the pad.
        x, y = width / 2 + more, length / 2 + more
        return overlap_mm3(solid, (-x, -y - 20.0, 0.0), (x, y, stack))

    assert pad(0.9 * gap) == pytest.approx(0.0, abs=1e-6)
    assert pad(1.1 * gap) > 1.0
    # The pad lies on the floor, and an object touches the sensor and not the rim.
    assert overlap_mm3(solid, (-5.0, -5.0, -0.1), (5.0, 5.0, 0.0)) == pytest.approx(10.0)
    top = solid.bounding_box()[5]
    assert stack - top == pytest.approx(plate.size["recess_mm"])


@pytest.mark.parametrize("changes", [{}, MEASURED["widowx"]])
def test_finger_slides_through_the_sleeve(changes: dict[str, float]) -> None:
    solid, size = make_holder("widowx", changes), lay_out("widowx", changes).size
    fit, back = size["fit_mm"], -size["floor_mm"]

    def finger(more: float) -> float:
        half = size["finger_width_mm"] / 2 + more
        deep = back - fit - size["finger_thickness_mm"] - more
        return overlap_mm3(solid, (-half, -50.0, deep), (half, 50.0, back - fit + more))

    assert finger(0.9 * fit) == pytest.approx(0.0, abs=1e-6)
    assert finger(1.1 * fit) > 1.0


@pytest.mark.parametrize("changes", [{}, MEASURED["so101"]])
def test_ties_pass_through_the_slots(changes: dict[str, float]) -> None:
    solid, plate = make_holder("so101", changes), lay_out("so101", changes)
    size = plate.size
    x, middle = plate.width_mm / 2 + size["rim_width_mm"], sum(plate.ends_mm) / 2
    for side in (-1, 1):
        for along in (-1, 1):
            y = middle + along * size["tie_spacing_mm"] / 2
            across = sorted((side * (x + 0.01), side * (x + size["tie_thickness_mm"] - 0.01)))
            low = (across[0], y - size["tie_width_mm"] / 2 + 0.01, -20.0)
            high = (across[1], y + size["tie_width_mm"] / 2 - 0.01, 20.0)
            assert overlap_mm3(solid, low, high) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("changes", [{}, MEASURED["parallel"]])
def test_screws_pass_and_their_heads_do_not_protrude(changes: dict[str, float]) -> None:
    solid, plate = make_holder("parallel", changes), lay_out("parallel", changes)
    size = plate.size
    for x in (-size["screw_spacing_mm"] / 2, size["screw_spacing_mm"] / 2):
        shank = SCRIPT["bore"](m, x, 0.0, (-20.0, 20.0), 0.98 * size["screw_mm"])
        head = SCRIPT["bore"](m, x, 0.0, (0.0, 20.0), 0.98 * size["head_mm"])
        assert (solid ^ shank).volume() == pytest.approx(0.0, abs=1e-6)
        assert (solid ^ head).volume() == pytest.approx(0.0, abs=1e-6)
        # Below the countersink there is material to hold the head.
        collar = SCRIPT["bore"](m, x, 0.0, (-size["floor_mm"], 0.0), size["head_mm"])
        assert (solid ^ collar).volume() > 5.0


@pytest.mark.parametrize("preset", SCRIPT["PADS_MM"])
def test_pads_are_those_of_the_cut_files(preset: str, palpate: Command, tmp_path: Path) -> None:
    palpate("pattern", "--preset", preset, "--out", tmp_path)
    drawing = (tmp_path / f"{preset}-1-base.svg").read_text(encoding="utf-8")
    outline = re.search(r'<path d="([^"]+)"', drawing)[1]
    # The ends of the lines: the arcs of the corners have three more numbers and two flags.
    ends = re.findall(r"[ML] ([\d.]+) ([\d.]+)|A (?:[\d.]+ ){5}([\d.]+) ([\d.]+)", outline)
    points = [(float(a or c), float(b or d)) for a, b, c, d in ends]
    top, left = min(y for _, y in points), min(x for x, _ in points)
    right = max(x for x, _ in points)
    # The body ends at the corner of its left edge, where the tail begins.
    bottom = max(y for x, y in points if x == left) + 1.0
    width, length = SCRIPT["PADS_MM"][preset]
    assert (right - left, bottom - top) == pytest.approx((width, length), abs=0.006)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["so101", "--set", "jaw_mm=3"], "so101 has no dimension jaw_mm; available: clearance_mm"),
        (["claw"], "no holder claw; available: widowx, so101, parallel"),
        (["parallel", "--set", "screw_spacing_mm=20"], "screw_spacing_mm: at least 38.2"),
        (["so101", "--set", "tie_spacing_mm=40"], "tie_spacing_mm: 4.6 to"),
        (["widowx", "--set", "cushion_mm=0.1"], "recess_mm: the rim would vanish"),
        (["widowx", "--set", "fit_mm=wide"], "could not convert"),
    ],
)
def test_bad_dimensions_are_refused_in_one_line(
    arguments: list[str], named: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert SCRIPT["main"]([*arguments, "--out", str(tmp_path / "new")]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"holders.py: {named}")
    assert error.count("\n") == 1
    assert not (tmp_path / "new").exists()


def test_every_guess_is_marked_to_be_measured(capsys: pytest.CaptureFixture[str]) -> None:
    for holder in HOLDERS.values():
        for dimension in holder.dimensions.values():
            assert dimension.measure or not dimension.source.startswith("guess")
    assert SCRIPT["main"](["--list"]) == 0
    shown = capsys.readouterr().out
    assert re.search(r"finger_width_mm +20 +measure +guess", shown)
