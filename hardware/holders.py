"""Makes printable holders of the sensor's pad: for a WidowX 250s, an SO-101 and a parallel jaw.

    pip install trimesh manifold3d
    python hardware/holders.py --list
    python hardware/holders.py so101 --set tie_spacing_mm=14 --out holders

A holder is a plate with a recess, into which the pad is glued on its cushion; the tail leaves at
the open end. No such finger has been measured for these parts: a dimension marked "measure" has a
default that is a guess, and must be measured on your gripper and set. None has been printed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Dimension:
    """A length in millimetres, and where it comes from.

    `measure`: whether the value is a guess, to be measured on the gripper and set.
    """

    mm: float
    source: str
    measure: bool = False


#: Body of the pads, width and length, mm: base and cover around the pixels, without the tail. Those
#: of the cut files of `palpate pattern`; a test compares them.
PADS_MM = {"paper-2x2": (27.61, 25.54), "so101": (18.61, 20.54)}

#: The same for every holder.
COMMON = {
    "clearance_mm": Dimension(0.3, "chosen: gap between pad and rim on each side"),
    "floor_mm": Dimension(2.4, "chosen: six layers of 0.4 mm"),
    "rim_width_mm": Dimension(1.6, "chosen: four lines of a 0.4 mm nozzle"),
    "cushion_mm": Dimension(2.0, "chosen: soft pad between holder and sensor", measure=True),
    "sensor_mm": Dimension(
        0.5, "README, bill of materials: two tapes, Velostat, two copper tapes of about 0.1 mm"
    ),
    "recess_mm": Dimension(0.8, "chosen: the sensor's surface is this far above the rim"),
}


@dataclass(frozen=True)
class Holder:
    """A holder: its pad, what it fits, and its own dimensions."""

    pad: str
    fits: str
    own: Mapping[str, Dimension]
    #: Makes the part that fixes the plate: solids to add, and solids to cut.
    fix: Callable[[Any, Plate], tuple[list[Any], list[Any]]]

    @property
    def dimensions(self) -> dict[str, Dimension]:
        """All dimensions by name."""
        return {**COMMON, **self.own}


@dataclass(frozen=True)
class Plate:
    """The plate of a holder: x across the finger, y towards the tip, z towards the object.

    The floor of the recess is at z = 0, its centre at x = y = 0.
    """

    pad_mm: tuple[float, float]
    size: Mapping[str, float] = field(repr=False)

    @property
    def recess_mm(self) -> tuple[float, float]:
        """Width and length of the recess."""
        gap = 2 * self.size["clearance_mm"]
        return self.pad_mm[0] + gap, self.pad_mm[1] + gap

    @property
    def width_mm(self) -> float:
        """Outer width."""
        return self.recess_mm[0] + 2 * self.size["rim_width_mm"]

    @property
    def ends_mm(self) -> tuple[float, float]:
        """Positions of the open end and of the tip along y."""
        half = self.recess_mm[1] / 2
        return -half, half + self.size["rim_width_mm"]

    @property
    def rim_mm(self) -> float:
        """Height of the rim above the floor."""
        return self.size["cushion_mm"] + self.size["sensor_mm"] - self.size["recess_mm"]


def box(m: Any, low: tuple[float, float, float], high: tuple[float, float, float]) -> Any:
    """Return a box between two corners; `m` is manifold3d."""
    return m.Manifold.cube([b - a for a, b in zip(low, high, strict=True)]).translate(list(low))


def bore(
    m: Any, x: float, y: float, z: tuple[float, float], mm: tuple[float, float] | float
) -> Any:
    """Return a vertical cylinder or cone: `mm` is its diameter, or those at its two ends."""
    low, high = mm if isinstance(mm, tuple) else (mm, mm)
    solid = m.Manifold.cylinder(z[1] - z[0], low / 2, high / 2, circular_segments=48)
    return solid.translate([x, y, z[0]])


def screwed(m: Any, plate: Plate) -> tuple[list[Any], list[Any]]:
    """Two countersunk M3 screws in ears beside the pad, for a plain parallel jaw."""
    size = plate.size
    half, floor = size["screw_spacing_mm"] / 2, size["floor_mm"]
    ear = size["head_mm"] / 2 + size["rim_width_mm"]
    inside = plate.width_mm / 2 - 1.0
    ears = [
        box(m, (-half - ear, -ear, -floor), (-inside, ear, 0.0)),
        box(m, (inside, -ear, -floor), (half + ear, ear, 0.0)),
    ]
    depth = (size["head_mm"] - size["screw_mm"]) / 2
    cuts = []
    for x in (-half, half):
        cuts.append(bore(m, x, 0.0, (-floor - 1.0, 1.0), size["screw_mm"]))
        cuts.append(bore(m, x, 0.0, (-depth, 0.0), (size["screw_mm"], size["head_mm"])))
    return ears, cuts


def tied(m: Any, plate: Plate) -> tuple[list[Any], list[Any]]:
    """Two cable ties around the jaw, through slots beside the recess."""
    size, floor = plate.size, plate.size["floor_mm"]
    half_width = plate.width_mm / 2
    wing = size["tie_thickness_mm"] + 2 * size["rim_width_mm"]
    low, high = plate.ends_mm
    wings = [
        box(m, (-half_width - wing, low, -floor), (-half_width, high, 0.0)),
        box(m, (half_width, low, -floor), (half_width + wing, high, 0.0)),
    ]
    cuts = []
    middle = (low + high) / 2
    for y in (middle - size["tie_spacing_mm"] / 2, middle + size["tie_spacing_mm"] / 2):
        y_low, y_high = y - size["tie_width_mm"] / 2, y + size["tie_width_mm"] / 2
        for side in (-1, 1):
            inner = side * (half_width + size["rim_width_mm"])
            outer = inner + side * size["tie_thickness_mm"]
            x_low, x_high = min(inner, outer), max(inner, outer)
            cuts.append(box(m, (x_low, y_low, -floor - 1.0), (x_high, y_high, 1.0)))
    return wings, cuts


def sleeved(m: Any, plate: Plate) -> tuple[list[Any], list[Any]]:
    """A sleeve over a straight finger, with a screw that clamps it from behind."""
    size, floor = plate.size, plate.size["floor_mm"]
    fit, wall = size["fit_mm"], size["wall_mm"]
    half = size["finger_width_mm"] / 2 + fit
    depth = size["finger_thickness_mm"] + 2 * fit
    low, high = plate.ends_mm
    half_width = max(half + wall, plate.width_mm / 2)
    back = -floor - depth - wall
    solid = box(m, (-half_width, low, back), (half_width, high, 0.0))
    finger = box(m, (-half, low - 1.0, -floor - depth), (half, high + 1.0, -floor))
    middle = (low + high) / 2
    screw = bore(m, 0.0, middle, (back - 1.0, -floor - depth + 1.0), size["tap_mm"])
    return [solid], [finger, screw]


HOLDERS = {
    "widowx": Holder(
        pad="paper-2x2",
        fits="a straight finger, such as of a WidowX 250s",
        own={
            "finger_width_mm": Dimension(20.0, "guess: width of the finger at the pad", True),
            "finger_thickness_mm": Dimension(8.0, "guess: thickness of the finger there", True),
            "fit_mm": Dimension(0.2, "chosen: gap of a printed sliding fit"),
            "wall_mm": Dimension(3.0, "chosen: enough thread for the clamping screw"),
            "tap_mm": Dimension(2.5, "ISO 2306: tap drill of M3"),
        },
        fix=sleeved,
    ),
    "so101": Holder(
        pad="so101",
        fits="the fixed or the moving jaw of an SO-101",
        own={
            "tie_width_mm": Dimension(3.0, "chosen: a cable tie of 2.5 mm with a gap", True),
            "tie_thickness_mm": Dimension(1.6, "chosen: a cable tie of 1.1 mm with a gap", True),
            "tie_spacing_mm": Dimension(12.0, "guess: straight part of the jaw's edges", True),
        },
        fix=tied,
    ),
    "parallel": Holder(
        pad="paper-2x2",
        fits="a plain jaw with two M3 threads",
        own={
            "screw_spacing_mm": Dimension(40.0, "guess: distance of the jaw's threads", True),
            "screw_mm": Dimension(3.4, "ISO 273: clearance hole of M3, medium"),
            "head_mm": Dimension(6.8, "ISO 10642: head of M3 at most 6.72 mm"),
        },
        fix=screwed,
    ),
}


def lay_out(name: str, changes: Mapping[str, float] | None = None) -> Plate:
    """Return the plate of a holder with changed dimensions.

    Raises `ValueError` if a dimension is unknown or not positive, or the parts would collide.
    """
    holder, changes = HOLDERS[name], changes or {}
    if unknown := changes.keys() - holder.dimensions.keys():
        known = ", ".join(holder.dimensions)
        raise ValueError(f"{name} has no dimension {sorted(unknown)[0]}; available: {known}")
    size = {key: one.mm for key, one in holder.dimensions.items()} | dict(changes)
    for key, mm in size.items():
        if not 0.0 < mm < 500.0:
            raise ValueError(f"{key}={mm:g}: must be above 0 and below 500 mm")
    plate = Plate(PADS_MM[holder.pad], size)
    if plate.rim_mm <= 0.0:
        raise ValueError("recess_mm: the rim would vanish; make it smaller than the stack")
    low, high = plate.ends_mm
    if "screw_spacing_mm" in size:
        least = plate.width_mm + size["head_mm"]
        if size["screw_spacing_mm"] < least:
            raise ValueError(f"screw_spacing_mm: at least {least:.1f}, or heads are under the rim")
    if "tie_spacing_mm" in size:
        most = high - low - size["tie_width_mm"] - 2 * size["rim_width_mm"]
        least = size["tie_width_mm"] + size["rim_width_mm"]
        if not least <= size["tie_spacing_mm"] <= most:
            raise ValueError(f"tie_spacing_mm: {least:.1f} to {most:.1f} fit into the plate")
    return plate


def make_holder(name: str, changes: Mapping[str, float] | None = None) -> Any:
    """Return a holder as a `manifold3d.Manifold`, mm.

    Raises `ValueError` as `lay_out`; `ImportError` without manifold3d.
    """
    import manifold3d as m

    plate = lay_out(name, changes)
    half, (low, high) = plate.width_mm / 2, plate.ends_mm
    recess = plate.recess_mm[0] / 2
    floor, rim = plate.size["floor_mm"], plate.rim_mm
    added, cut = HOLDERS[name].fix(m, plate)
    solid = box(m, (-half, low, -floor), (half, high, rim))
    for other in added:
        solid += other
    # The recess is open towards the arm, where the tail leaves.
    solid -= box(m, (-recess, low - 1.0, 0.0), (recess, high - plate.size["rim_width_mm"], rim + 1))
    for other in cut:
        solid -= other
    return solid


def save_stl(solid: Any, path: Path) -> None:
    """Write a solid as a binary STL file."""
    import numpy as np
    import trimesh

    mesh = solid.to_mesh()
    vertices = np.asarray(mesh.vert_properties)[:, :3]
    trimesh.Trimesh(vertices, np.asarray(mesh.tri_verts)).export(path)


def describe() -> str:
    """Return all dimensions with their sources, those to be measured first."""
    lines = []
    for name, holder in HOLDERS.items():
        width, length = PADS_MM[holder.pad]
        lines.append(f"{name}: {holder.fits}; pad {holder.pad}, {width:g} x {length:g} mm")
        rows = sorted(holder.dimensions.items(), key=lambda row: not row[1].measure)
        for key, one in rows:
            mark = "measure" if one.measure else ""
            lines.append(f"  {key:<22} {one.mm:>6g}  {mark:<8} {one.source}")
    return "\n".join(lines)


def main(arguments: list[str]) -> int:
    """Run the command line; return the exit status."""
    parser = argparse.ArgumentParser(description="Printable holders of the sensor's pad.")
    parser.add_argument("names", nargs="*", help=f"of {', '.join(HOLDERS)}; all by default")
    parser.add_argument("--list", action="store_true", help="show the dimensions and sources")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=MM", dest="changes")
    parser.add_argument("--out", type=Path, default=Path("holders"), metavar="DIR")
    given = parser.parse_args(arguments)
    if given.list:
        sys.stdout.write(describe() + "\n")
        return 0
    try:
        changes = {key: float(mm) for key, _, mm in (one.partition("=") for one in given.changes)}
        if unknown := set(given.names) - set(HOLDERS):
            raise ValueError(f"no holder {sorted(unknown)[0]}; available: {', '.join(HOLDERS)}")
        made = {name: make_holder(name, changes) for name in given.names or HOLDERS}
    except ValueError as error:
        sys.stderr.write(f"holders.py: {error}\n")
        return 2
    except ImportError as error:
        sys.stderr.write(f"holders.py: needs {error.name}; pip install trimesh manifold3d\n")
        return 2
    given.out.mkdir(parents=True, exist_ok=True)
    for name, solid in made.items():
        save_stl(solid, given.out / f"{name}.stl")
        sys.stdout.write(f"{given.out / name}.stl: {solid.volume() / 1e3:.1f} cm3\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
