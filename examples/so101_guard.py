"""Guard the gripper of an SO-101 that LeRobot drives: servo 6 stops before the force passes 3 N.

    palpate demo so101                       # simulated; in another terminal
    python examples/so101_guard.py demo-so101

The folder has the rig file `simulated.toml` or `rig.toml`, of which the sensor is used, and the
port `arm`; on a real arm that is LeRobot's own port. Needs `lerobot[feetech]`.
"""

from __future__ import annotations

import sys
import threading
import time
from pathlib import Path

from lerobot.motors import Motor, MotorNormMode
from lerobot.motors.feetech import FeetechMotorsBus

import palpate

#: A step of the servo (4096 a turn), about 0.1 mm, and the time between steps: the force still
#: rises while the stop is under way, by the more the faster the jaw is. Closing lowers the ticks.
STEP_TICKS, STEP_S = 1, 0.05
LIMIT_N, MOST_STEPS = 3.0, 800
# The guard stops from its own thread, and a bus has one user at a time.
BUS_LOCK = threading.Lock()


class Jaw:
    """Servo 6 on LeRobot's bus, as the guard needs it."""

    def __init__(self, bus: FeetechMotorsBus) -> None:
        self.bus = bus

    def stop(self) -> None:
        with BUS_LOCK:
            here = self.bus.read("Present_Position", "gripper", normalize=False)
            self.bus.write("Goal_Position", "gripper", here, normalize=False)


def main(folder: Path) -> None:
    """Close servo 6 step by step until the guard stops it, then open it."""
    rig_file = next(
        folder / name for name in ("simulated.toml", "rig.toml") if (folder / name).exists()
    )
    motor = Motor(6, "sts3215", MotorNormMode.RANGE_0_100)
    bus = FeetechMotorsBus(port=str(folder / "arm"), motors={"gripper": motor})
    bus.connect()
    try:
        with palpate.open_rig(str(rig_file)) as rig:
            start = goal = bus.read("Present_Position", "gripper", normalize=False)
            bus.enable_torque()
            with palpate.ForceGuard(rig, limit_n=LIMIT_N, gripper=Jaw(bus)) as guard:
                print(guard)
                for _ in range(MOST_STEPS):
                    goal -= STEP_TICKS
                    with BUS_LOCK:
                        if guard.is_tripped:
                            break
                        bus.write("Goal_Position", "gripper", goal, normalize=False)
                    time.sleep(STEP_S)
                print(guard.reason or "nothing between the jaws")
            bus.write("Goal_Position", "gripper", start, normalize=False)
            time.sleep(1.0)
    finally:
        bus.disconnect(disable_torque=False)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "demo-so101"))
