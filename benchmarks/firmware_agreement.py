"""Agreement of grasps through the real firmware with grasps through the twin's ideal readout.

    python benchmarks/firmware_agreement.py --seeds 5 --draws 8

For each seed (object, sheet, gripper, calibration) the same grasp is repeated on both readouts.
Each repeat has new noise of sheet and converter, a random phase of the frame clock, and an object
that is 0 to 2 mm larger (`--larger-mm 0`: the same object, so that only noise differs). The
criterion applies to settled change, size error, grip force, and times of contact and answer: the
readouts must not differ significantly, neither in one direction over all seeds nor in any direction
within seeds (permutation rank tests within seeds, p > 0.01 each), and their mean difference must be
below the standard deviation of one draw.

The array is scanned at 16 Hz by default. At the rigs' 15 Hz (`--rate-hz 15`) the frame times of
twin and board (66.667 and 66.665 ms on the host's clock) are sometimes on different sides of the
end of a waiting time. A step is then one frame later, while the sheet creeps. In one run, settled
change and size agreed, and force failed the test within seeds (p = 0.009) with a mean offset of
0.02 sd. Everything is simulated; the readouts differ in firmware, converter, clock and link.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from palpate.calibration import Calibration
from palpate.grasp.planning import plan_grasp
from palpate.grasp.runner import run_grasp
from palpate.sensor.array import PressureArray
from palpate.sensor.serial_array import SerialArray
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.firmware import FirmwareBoard, FirmwareStream
from palpate.twin.objects import draw_object
from palpate.twin.ranges import ranges_of
from palpate.twin.rig import calibrate_twin
from palpate.twin.world import World

MEASURED = ("settled_percent", "size_error_mm", "force_n")
#: Moments that are compared by their time after the start of the grasp.
MOMENTS = ("contact", "answer")
QUANTITIES = (*MEASURED, *(f"{name}_s" for name in MOMENTS))
_LEVEL = "lab"
_PERMUTATIONS = 20_000

Floats = NDArray[np.float64]


def open_firmware_array(world: World, *, draw: int) -> PressureArray:
    """Return an array that reads the world through the firmware, with this draw's noise."""
    divider = world.layout.divider
    board = FirmwareBoard(seed=1000 * world.seed + draw)
    count_mv = 1e3 * divider.supply_v / divider.full_scale
    board.set_noise_mv(count_mv * ranges_of(_LEVEL).adc_noise_counts)
    return SerialArray(
        FirmwareStream(world, board=board),
        clock=world.clock,
        layout=world.layout,
        rate_hz=world.frame_rate_hz,
    )


def grasp(
    calibration: Calibration,
    *,
    seed: int,
    draw: int,
    firmware: bool,
    rate_hz: float,
    larger_mm: float,
) -> list[float]:
    """Grasp once; return settled change, size error, force, times of contact and answer."""
    obj = draw_object(np.random.default_rng([seed, 10]))
    rng = np.random.default_rng([seed, draw, firmware])
    phase, enlargement = rng.uniform(size=2)
    obj = replace(obj, size_mm=obj.size_mm + enlargement * larger_mm)
    world = World(obj, seed=seed, sheet_seed=seed, level=_LEVEL, frame_rate_hz=rate_hz)
    world.clock.sleep_s(phase / world.frame_rate_hz)
    for _ in range(2 * draw + firmware):
        world.pixel_voltage_v(world.clock.now_s())  # consumes noise, so that the next draw differs
    array = open_firmware_array(world, draw=draw) if firmware else TwinArray(world)
    gripper = TwinGripper(world)
    plan = plan_grasp(calibration, gripper=gripper)
    began_s = world.clock.now_s()
    result = run_grasp(plan, array=array, gripper=gripper, clock=world.clock)
    array.close()
    size_mm, force_n, settled = result.size_mm, result.force_n, result.settled_percent
    after_start_s = {moment.name: moment.time_s - began_s for moment in result.moments}
    return [
        np.nan if settled is None else settled.value,
        np.nan if size_mm is None else size_mm.value - obj.size_mm,
        np.nan if force_n is None else force_n.value,
        # In whole frames, because clocks may differ within one frame.
        *(
            round(after_start_s[name] * rate_hz) / rate_hz if name in after_start_s else np.nan
            for name in MOMENTS
        ),
    ]


def compare_draws(twin: Floats, firmware: Floats, *, rng: np.random.Generator) -> dict[str, Any]:
    """Compare draws of one quantity, both of shape (seeds, draws)."""
    spread = np.sqrt((twin.var(axis=1, ddof=1) + firmware.var(axis=1, ddof=1)) / 2)
    offset = firmware.mean(axis=1) - twin.mean(axis=1)
    # Times are multiples of a frame, so draws may tie; ties share their rank.
    ranks = rankdata(np.concatenate([firmware, twin], axis=1), axis=1)
    half = firmware.shape[1]
    middle = (ranks.shape[1] + 1) / 2

    def statistics(ordered: Floats) -> Floats:
        """Return the rank statistics over all seeds and within seeds."""
        shift = (ordered[:, :half] - middle).sum(axis=1)
        return np.array([abs(shift.sum()), (shift**2).sum()])

    chance = np.array([statistics(rng.permuted(ranks, axis=1)) for _ in range(_PERMUTATIONS)])
    p = (1 + np.sum(chance >= statistics(ranks), axis=0)) / (1 + _PERMUTATIONS)
    # Without spread, any offset is infinite in standard deviations.
    with np.errstate(divide="ignore", invalid="ignore"):
        in_sd = np.where(offset == 0.0, 0.0, offset / spread)
    standardised = float(np.mean(in_sd))
    return {
        "twin": twin.mean(axis=1).round(3).tolist(),
        "firmware": firmware.mean(axis=1).round(3).tolist(),
        "sd_of_one_draw": spread.round(3).tolist(),
        "offset_in_sd": in_sd.round(2).tolist(),
        "mean_offset_in_sd": round(standardised, 3),
        "p_one_way": round(float(p[0]), 4),
        "p_within_seeds": round(float(p[1]), 4),
        "agrees": bool(p.min() > 0.01 and abs(standardised) < 1),
    }


def compare(*, seeds: int, draws: int, rate_hz: float, larger_mm: float) -> dict[str, Any]:
    """Run all grasps; return the comparison of each quantity."""
    values = np.empty((2, seeds, draws, len(QUANTITIES)))
    for index in range(seeds):
        seed = index + 1
        name = draw_object(np.random.default_rng([seed, 10])).name
        calibration = calibrate_twin(seed=seed, level=_LEVEL, apart_from=name)
        for draw in range(draws):
            for firmware in (False, True):
                values[int(firmware), index, draw] = grasp(
                    calibration,
                    seed=seed,
                    draw=draw,
                    firmware=firmware,
                    rate_hz=rate_hz,
                    larger_mm=larger_mm,
                )
        print(f"seed {seed}: {name} done", file=sys.stderr)
    rng = np.random.default_rng(0)
    return {
        name: compare_draws(values[0, :, :, k], values[1, :, :, k], rng=rng)
        for k, name in enumerate(QUANTITIES)
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--draws", type=int, default=8)
    parser.add_argument("--rate-hz", type=float, default=16.0)
    parser.add_argument("--larger-mm", type=float, default=2.0)
    about = vars(parser.parse_args())
    found = compare(**about)
    print(json.dumps({"simulated": True, **about, **found}, indent=1))
    sys.exit(0 if all(each["agrees"] for each in found.values()) else 1)


if __name__ == "__main__":
    main()
