"""Grasps with a hobby servo and the real firmware, compared with `sim-rigid`.

    python benchmarks/board_grasps.py --board mega2560 --grasps 40 --out docs/boards/mega2560.json

The firmware runs on the AVR simulator, with its serial line and servo pulses. Sheet, object and
fingers are simulated by the twin. The servo has the dead band and the speed of an MG996R. The
calibration is that of `sim-rigid` (same sheet and fingers, another session) without the servo
current, which a hobby servo does not report. `--board twin` runs `sim-rigid` itself.
"""

from __future__ import annotations

import argparse
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from palpate.files import atomic_path
from palpate.firmware_image import BOARDS
from palpate.grasp.planning import plan_grasp
from palpate.grasp.runner import run_grasp
from palpate.gripper.hobby_servo import HobbyServoGripper, ServoTravel
from palpate.rig import Rig, open_rig
from palpate.sensor.serial_array import SerialArray
from palpate.sensor.wire_messages import Contents
from palpate.twin.firmware import FirmwareBoard, FirmwareStream
from palpate.twin.objects import draw_object
from palpate.twin.ranges import ranges_of
from palpate.twin.rig import calibrate_twin
from palpate.twin.world import World

#: As in the rig file of `palpate init --gripper servo`.
TRAVEL = ServoTravel(open_us=690, closed_us=2310, open_mm=74.0, closed_mm=5.0)
TWIN, _LEVEL = "twin", "lab"
#: Frame rate of all rigs, Hz: that of the paper.
RATE_HZ = 15.0


def open_board_rig(board: str, *, seed: int) -> Rig:
    """Return the rig of `sim-rigid` with this seed, connected to a board's firmware."""
    obj = draw_object(np.random.default_rng([seed, 10]), None)
    world = World(obj, seed=seed, sheet_seed=seed, level=_LEVEL, frame_rate_hz=RATE_HZ)
    calibration = calibrate_twin(seed=seed, level=_LEVEL, apart_from=obj.name)
    machine = FirmwareBoard(board, seed=seed)
    divider = world.layout.divider
    count_mv = 1e3 * divider.supply_v / divider.full_scale
    machine.set_noise_mv(count_mv * ranges_of(_LEVEL).adc_noise_counts)
    array = SerialArray(
        FirmwareStream(world, board=machine, travel=TRAVEL),
        clock=world.clock,
        layout=world.layout,
        rate_hz=world.frame_rate_hz,
        contents=Contents.SERVO,
    )
    return Rig(
        name=board,
        array=array,
        gripper=HobbyServoGripper(array, clock=world.clock, travel=TRAVEL),
        clock=world.clock,
        calibration=replace(calibration, current=None),
        origin="firmware-simulated",
        subject=obj.name,
        truth=lambda: world.truth().to_dict(),
        seed=seed,
    )


def grasp_once(seed: int, *, board: str) -> dict[str, Any]:
    """Grasp once with a board or "twin"; return outcome, peak force, times and losses."""
    if board == TWIN:
        rig = open_rig("sim-rigid", seed=seed, rate_hz=RATE_HZ)
    else:
        rig = open_board_rig(board, seed=seed)
    with rig:
        begin_s = rig.clock.now_s()
        plan = plan_grasp(rig.calibration, gripper=rig.gripper)
        result = run_grasp(plan, array=rig.array, gripper=rig.gripper, clock=rig.clock)
        truth = rig.truth() if rig.truth is not None else {}
        lost = rig.array.counters.lost if isinstance(rig.array, SerialArray) else 0
        return {
            "seed": seed,
            "object": rig.subject,
            "outcome": str(result.outcome),
            "faults": [str(fault) for fault in result.faults],
            "peak_force_n": round(float(str(truth["peak_force_n"])), 3),
            "damaged": truth["damaged"],
            "decision_time_s": result.decision_time_s,
            "grasp_s": round(rig.clock.now_s() - begin_s, 2),
            "frames_lost": lost,
        }


def main() -> None:
    """Run the grasps, print one line per grasp, and write all results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--board", required=True, choices=(TWIN, *BOARDS))
    parser.add_argument("--grasps", type=int, default=40)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    rows = []
    with ProcessPoolExecutor(args.processes) as pool:
        for row in pool.map(partial(grasp_once, board=args.board), range(args.grasps)):
            rows.append(row)
            print(json.dumps(row), file=sys.stderr, flush=True)
    if args.out is not None:
        document = {"board": args.board, "simulated": True, "grasps": rows}
        with atomic_path(args.out) as partial_file:
            partial_file.write_text(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    main()
