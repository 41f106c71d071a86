"""True peak force of the guarded jaw of the simulated SO-101, by limit and speed of the leader.

    python benchmarks/jaw_guard.py

A program closes the jaw of `palpate demo so101` around its strawberry, 30 times a second, until the
jaw has been held for 1 s, or for 12 s. It prints the highest true force and that at the end, in
real time. Needs `palpate[gripper]` and `packages/lerobot-dataset`.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from itertools import product
from pathlib import Path

import palpate
from palpate.demo.so101 import SimulatedSo101, simulate_so101
from palpate.gripper import sts_series as sts
from palpate.gripper.no_gripper import NoGripper
from palpate.gripper.packets import PROTOCOL_1
from palpate.gripper.servo_line import ServoLine
from palpate_lerobot.touch import Touch

LIMITS_N, SPEEDS_MM_PER_S, REPEATS = (2.0, 3.0), (3.0, 10.0, 1000.0), 1
PERIOD_S, CLOSING_S, HELD_S = 1 / 30, 12.0, 1.0


class Servo:
    """Servo 6; positions are ticks."""

    mm_per_unit = 70.0 * sts.RAD_PER_TICK

    def __init__(self, line: ServoLine) -> None:
        self.line = line

    def read(self) -> float:
        """Return the position."""
        return self.line.read(sts.PRESENT_POSITION)

    def write(self, position: float) -> None:
        """Command a position."""
        self.line.write(sts.GOAL_POSITION, round(position))


def close_jaw(robot: SimulatedSo101, folder: Path, limit_n: float, speed: float) -> list[float]:
    """Close until the jaw is held; return the true forces."""
    line = ServoLine(
        str(folder / "hand"), servo_id=6, baud=1_000_000, packets=PROTOCOL_1, reply_s=1.0
    )
    jaw = Servo(line)
    rig = palpate.open_rig(str(folder / "simulated.toml"), gripper=NoGripper())
    touch = Touch(rig, jaw=jaw, limit_n=limit_n)
    line.write(sts.TORQUE_ENABLE, 1)
    wanted = jaw.read() - 320.0
    jaw.write(wanted)
    time.sleep(1.0)
    touch.start()
    touch.observe()
    forces_n, start_s, held_s = list[float](), time.monotonic(), 0.0
    while held_s < HELD_S and time.monotonic() < start_s + CLOSING_S:
        wanted = max(wanted - speed * PERIOD_S / jaw.mm_per_unit, 1000.0)
        with touch.lock:
            jaw.write(touch.limit(wanted))
        for _ in range(8):
            forces_n.append(robot.truth()[0])
            time.sleep(PERIOD_S / 8)
        held_s += PERIOD_S * bool(touch.reason)
    touch.close()
    line.close()
    return forces_n


def run_one(limit_n: float, speed: float) -> None:
    """Close once, and print a row."""
    with tempfile.TemporaryDirectory() as name, simulate_so101(Path(name)) as robot:
        threading.Thread(target=robot.run, daemon=True).start()
        forces_n = close_jaw(robot, Path(name), limit_n, speed)
        print(f"{limit_n:g}, {speed:g}, {max(forces_n):.2f}, {forces_n[-1]:.2f}", flush=True)
        shutil.rmtree(name)
        # The demo runs until its process ends.
        os._exit(0)


def main() -> None:
    """Print a table; each closing is a process."""
    print("limit N, leader mm/s, peak N, at the end N", flush=True)
    for limit_n, speed, _ in product(LIMITS_N, SPEEDS_MM_PER_S, range(REPEATS)):
        command = [sys.executable, __file__, str(limit_n), str(speed)]
        subprocess.run(command, check=True)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        run_one(float(sys.argv[1]), float(sys.argv[2]))
    else:
        main()
