"""How far to trust a grasp's intervals: gentle grasps of the named objects of the twin.

    python benchmarks/named_objects.py --grasps 25

Rigid fingers at 250 frames/s on sheets that are drawn and calibrated anew for every five grasps, as
`palpate grasp --rig sim-rigid` does. For each object it prints the fraction of 90 % intervals that
contain the truth, and the median ratio of stiffness to its truth; at the end the smallest and the
largest fraction on one sheet. Everything is simulated.
"""

from __future__ import annotations

import argparse
from collections import defaultdict

import numpy as np

from palpate.grasp.planning import plan_grasp
from palpate.grasp.requests import Requests
from palpate.grasp.runner import run_grasp
from palpate.measurement import Measurement
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import draw_object
from palpate.twin.velostat import Environment
from palpate.twin.world import World
from palpate_studies.force_control_world import SIZES_MM, calibration_of, draw_random_object

NAMES = (
    "strawberry",
    "tomato",
    "avocado-day-2",
    "avocado-day-4",
    "kiwi",
    "banana",
    "mango",
    "springs-4",
    None,
)
GRASPS_PER_SHEET = 5
#: Movements of the sheet since its calibration.
CYCLES = 20


def grasp_object(name: str | None, *, seed: int, sheet: int, level: str) -> list[float]:
    """Grasp one object; return whether force, size and stiffness are covered, and their errors.

    `name`: None draws an object. The errors are those of ln force, size in mm and ln stiffness. All
    are NaN if the object was not held.
    """
    rng = np.random.default_rng([seed, 77])
    obj = draw_object(rng, name) if name else draw_random_object(rng, size_mm=SIZES_MM["rigid"])
    world = World(
        obj,
        seed=seed,
        sheet_seed=sheet,
        level=level,
        gripper="rigid",
        frame_rate_hz=250.0,
        environment=Environment(cycles=CYCLES),
    )
    gripper = TwinGripper(world)
    plan = plan_grasp(calibration_of(sheet, level, "rigid"), gripper=gripper)
    result = run_grasp(
        plan, array=TwinArray(world), gripper=gripper, clock=world.clock, requests=Requests()
    )
    truth = world.truth()
    if result.force_n is None or result.size_mm is None or result.stiffness_n_per_mm is None:
        return [np.nan] * 6
    assert truth.size_mm is not None
    assert truth.stiffness_n_per_mm is not None
    pairs = (
        (result.force_n, truth.force_n),
        (result.size_mm, truth.size_mm),
        (result.stiffness_n_per_mm, truth.stiffness_n_per_mm),
    )
    covered = [float(covers(found, true)) for found, true in pairs]
    force, size, stiffness = (found.middle / true for found, true in pairs)
    return [*covered, float(np.log(force)), (size - 1.0) * truth.size_mm, float(np.log(stiffness))]


def covers(found: Measurement, true: float) -> bool:
    """Return whether an interval, or a bound, contains the true value."""
    return not (true < found.low or true > found.high)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--grasps", type=int, default=25, help="of each object (25)")
    parser.add_argument("--level", choices=("lab", "field"), default="lab")
    parser.add_argument("--seed", type=int, default=610_000, help="of the first grasp")
    parser.add_argument("--objects", nargs="+", metavar="NAME", help="only these; drawn for any")
    parser.add_argument(
        "--same-sheets", action="store_true", help="every object once on each of the same sheets"
    )
    options = parser.parse_args()
    by_sheet: dict[int, list[list[float]]] = defaultdict(list)
    print("object, n: force, size, stiffness covered; size error, mm; force, stiffness over truth")
    for number, name in enumerate(NAMES):
        if options.objects and (name or "drawn") not in options.objects:
            continue
        seeds = options.seed + 1000 * number + np.arange(options.grasps)
        if options.same_sheets:
            sheets = options.seed + np.arange(options.grasps)
        else:
            sheets = seeds // GRASPS_PER_SHEET
        rows = np.array(
            [
                grasp_object(name, seed=int(seed), sheet=int(sheet), level=options.level)
                for seed, sheet in zip(seeds, sheets, strict=True)
            ]
        )
        is_held = ~np.isnan(rows[:, 0])
        held = rows[is_held]
        for sheet, row in zip(sheets[is_held], held, strict=True):
            by_sheet[int(sheet)].append(row[:3].tolist())
        force, size, stiffness = held[:, :3].mean(axis=0)
        error = np.median(held[:, 3:], axis=0)
        print(
            f"{name or 'drawn'}, {len(held)} of {len(rows)}: {force:.2f}, {size:.2f}, "
            f"{stiffness:.2f}; {error[1]:+.2f}; {np.exp(error[0]):.2f}, {np.exp(error[2]):.2f}",
            flush=True,
        )
    covered = np.array([np.mean(rows, axis=0) for rows in by_sheet.values()])
    ranges = ", ".join(
        f"{quantity} {low:.2f} to {high:.2f}"
        for quantity, low, high in zip(
            ("force", "size", "stiffness"), covered.min(axis=0), covered.max(axis=0), strict=True
        )
    )
    grasps = max(map(len, by_sheet.values()))
    print(f"covered by sheet ({len(covered)} sheets of up to {grasps} grasps): {ranges}")


if __name__ == "__main__":
    main()
