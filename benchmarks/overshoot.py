"""Largest true force of healthy simulated grasps, compared with 1.5 x target + 0.5 N.

    python benchmarks/overshoot.py --seed 910000 --objects 104 --processes 2

The grasps use all built-in objects in turn, levels lab and field, rigid fingers at 15 and 250
frames/s and soft fingers at 15. Each grasp has its own object, sheet and calibration.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, dataclass
from functools import partial
from multiprocessing import Pool
from pathlib import Path
from statistics import median

import numpy as np

from palpate.grasp.planning import plan_grasp
from palpate.grasp.runner import run_grasp
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import OBJECTS, draw_object
from palpate.twin.rig import calibrate_twin
from palpate.twin.world import GripperKind, World

HANDS: tuple[tuple[GripperKind, float], ...] = (("rigid", 15.0), ("rigid", 250.0), ("soft", 15.0))


@dataclass(frozen=True, kw_only=True)
class Grasp:
    """One grasp; true forces in newtons, times from the first frame in seconds."""

    number: int
    name: str
    level: str
    kind: str
    rate_hz: float
    target_n: float
    outcome: str
    damaged: bool
    peak_n: float
    touch_s: float | None
    answer_s: float | None

    @property
    def exceeds(self) -> bool:
        return self.peak_n > 1.5 * self.target_n + 0.5


def grasp(job: tuple[int, float], *, seed: int) -> Grasp:
    """Run one grasp."""
    number, target_n = job
    names = list(OBJECTS)
    name, turn = names[number % len(names)], number // len(names)
    level = ("lab", "field")[turn % 2]
    kind, rate_hz = HANDS[turn // 2 % len(HANDS)]
    drawn = seed + number
    obj = draw_object(np.random.default_rng([drawn, 10]), name)
    calibration = calibrate_twin(seed=drawn, level=level, apart_from=name, kind=kind)
    world = World(
        obj, seed=drawn, sheet_seed=drawn, level=level, gripper=kind, frame_rate_hz=rate_hz
    )
    gripper = TwinGripper(world)
    plan = plan_grasp(calibration, gripper=gripper, target_force_n=target_n)
    result = run_grasp(plan, array=TwinArray(world), gripper=gripper, clock=world.clock)
    began_s = {moment.name: moment.time_s for moment in reversed(result.moments)}
    truth = world.truth()
    return Grasp(
        number=number,
        name=name,
        level=level,
        kind=kind,
        rate_hz=rate_hz,
        target_n=target_n,
        outcome=str(result.outcome),
        damaged=truth.damaged,
        peak_n=truth.peak_force_n,
        touch_s=began_s.get("contact"),
        answer_s=began_s.get("answer"),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=910_000)
    parser.add_argument("--objects", type=int, default=104, help="grasps at each target")
    parser.add_argument("--targets", type=float, nargs="+", default=[2.0, 3.0, 4.0])
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=Path, help="file for JSON lines, one per grasp")
    options = parser.parse_args()
    jobs = [(number, target) for number in range(options.objects) for target in options.targets]
    with Pool(options.processes) as pool:
        found = pool.map(partial(grasp, seed=options.seed), jobs, chunksize=3)
    if options.out is not None:
        options.out.write_text("".join(json.dumps(asdict(one)) + "\n" for one in found))
    for level in ("lab", "field"):
        for target_n in options.targets:
            mine = [one for one in found if (one.level, one.target_n) == (level, target_n)]
            held = [one for one in mine if one.outcome == "held"]
            touches = [one.touch_s for one in held if one.touch_s is not None]
            answers = [one.answer_s for one in held if one.answer_s is not None]
            print(
                f"{level} {target_n:g} N: {sum(one.exceeds for one in mine)} of {len(mine)} above "
                f"{1.5 * target_n + 0.5:g} N, largest {max(one.peak_n for one in mine):.1f}; held "
                f"{len(held)}, damaged {sum(one.damaged for one in mine)}, touch "
                f"{median(touches):.1f} s, answer {median(answers):.1f} s"
            )


if __name__ == "__main__":
    main()
