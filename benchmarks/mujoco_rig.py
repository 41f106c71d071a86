"""Grasps in MuJoCo compared with the twin: equal objects and sheets, two physics engines.

    python benchmarks/mujoco_rig.py --grasps 40
    python benchmarks/mujoco_rig.py --grasps 40 --rigs mujoco-so101

For each seed one object is drawn and grasped on each rig with its own calibration. Prints mean and
standard deviation of the errors relative to the rig's truth, and the coverage of the 90 %
intervals. Requires `pip install -e packages/mujoco`. There is no limit.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from statistics import fmean, median, stdev
from typing import TypeAlias

from palpate.grasp.planning import plan_grasp
from palpate.grasp.runner import run_grasp
from palpate.measurement import Measurement
from palpate.rig import open_rig

RIGS = ("sim-rigid", "mujoco")
#: Frame rate of the MuJoCo rigs, Hz.
RATE_HZ = 15.0
QUANTITIES = ("size_mm", "force_n", "stiffness_n_per_mm", "settled_percent")
#: Measured and true value of each quantity that was measured, and the outcome.
Grasp: TypeAlias = tuple[str, dict[str, tuple[Measurement, float]]]


def grasp_drawn(rig_name: str, *, seed: int) -> Grasp:
    """Grasp the object of a seed."""
    rig = open_rig(rig_name, seed=seed, rate_hz=RATE_HZ if rig_name == "sim-rigid" else None)
    plan = plan_grasp(rig.calibration, gripper=rig.gripper)
    result = run_grasp(plan, array=rig.array, gripper=rig.gripper, clock=rig.clock)
    assert rig.truth is not None
    truth = rig.truth()
    pairs = {name: (getattr(result, name), truth[name]) for name in QUANTITIES}
    return str(result.outcome), {
        name: (measured, float(true))
        for name, (measured, true) in pairs.items()
        if measured is not None and isinstance(true, float)
    }


def error_of(name: str, measured: Measurement, true: float) -> float | None:
    """Return an error (mm, points, ln ratio in percent); None without a number."""
    if not measured.has_value:
        return None
    if name in ("size_mm", "settled_percent"):
        return measured.value - true
    return 100.0 * math.log(measured.value / true)


def covers_truth(measured: Measurement, true: float) -> bool:
    """Return whether the known limits of the interval include the truth."""
    low, high = measured.known_ends
    return (low is None or low <= true) and (high is None or true <= high)


def report(rig_name: str, grasps: Sequence[Grasp]) -> None:
    """Print the results of one rig."""
    held = sum(outcome == "held" for outcome, _ in grasps)
    print(f"{rig_name}: {held} of {len(grasps)} held")
    for name in QUANTITIES:
        pairs = [measured[name] for _, measured in grasps if name in measured]
        errors = [found for pair in pairs if (found := error_of(name, *pair)) is not None]
        inside = [covers_truth(*pair) for pair in pairs if any(pair[0].known_ends)]
        print(
            f"  {name:20} n {len(errors):3}  mean {fmean(errors):+7.2f}  sd {stdev(errors):6.2f}  "
            f"median |error| {median(map(abs, errors)):6.2f}  "
            f"in interval {sum(inside)} of {len(inside)}"
        )


def main() -> None:
    """Grasp on all rigs and print the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--grasps", type=int, default=40)
    parser.add_argument("--first-seed", type=int, default=1000)
    parser.add_argument("--rigs", nargs="+", default=RIGS)
    options = parser.parse_args()
    seeds = range(options.first_seed, options.first_seed + options.grasps)
    print("errors: size in mm, settled in percent points, force and stiffness in % (of ln)")
    for rig_name in options.rigs:
        report(rig_name, [grasp_drawn(rig_name, seed=seed) for seed in seeds])


if __name__ == "__main__":
    main()
