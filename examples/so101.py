"""Grasp with an SO-101: LeRobot moves the arm, palpate the gripper, on one servo line.

    palpate demo so101                       # simulated; in another terminal
    python examples/so101.py demo-so101

The folder has the rig file `simulated.toml` or `rig.toml`, and the port `arm`, which shares a line
with the gripper's port. On a real arm, `python -m palpate.gripper.bus_share` makes both ports.
Needs `lerobot[feetech]`.
"""

from __future__ import annotations

import sys
from pathlib import Path

from lerobot.motors import Motor, MotorNormMode
from lerobot.motors.feetech import FeetechMotorsBus

import palpate

#: Without the gripper, servo 6, which belongs to palpate.
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
#: Steps of the servo (4096 a turn) that raise the object, and frames in which the arm does it. The
#: sign depends on how the arm was assembled: try it without an object.
RAISE_TICKS, RAISE_FRAMES = 120, 30
TARGET_N = 2.0


def open_arm(port: str) -> FeetechMotorsBus:
    """Connect to the arm's servos, and let them hold where they are."""
    motors = {
        name: Motor(number, "sts3215", MotorNormMode.DEGREES)
        for number, name in enumerate(JOINTS, start=1)
    }
    arm = FeetechMotorsBus(port=port, motors=motors)
    arm.connect()
    arm.sync_write(
        "Goal_Position", arm.sync_read("Present_Position", normalize=False), normalize=False
    )
    arm.enable_torque()
    return arm


def main(folder: Path) -> None:
    """Grasp, raise the object while the force is watched, lower it, and release it."""
    files = [folder / name for name in ("simulated.toml", "rig.toml")]
    rig_file = next((file for file in files if file.exists()), None)
    if rig_file is None or not (folder / "arm").exists():
        sys.exit(
            f"{folder}: has no rig file and port `arm` together; start `palpate demo so101` or "
            "`python -m palpate.gripper.bus_share`, and name its folder"
        )
    arm = open_arm(str(folder / "arm"))
    start = arm.sync_read("Present_Position", normalize=False)
    try:
        with palpate.open_rig(str(rig_file)) as rig:
            grip = rig.grasp(target_force_n=TARGET_N)
            print(grip)
            lift = start["shoulder_lift"]
            steps = [*range(1, RAISE_FRAMES + 1), *range(RAISE_FRAMES - 1, -1, -1)]
            for step in steps:
                if not grip.is_holding:
                    break
                goal = lift - round(RAISE_TICKS * step / RAISE_FRAMES)
                arm.sync_write("Goal_Position", {"shoulder_lift": goal}, normalize=False)
                reading = rig.read()
                if step == RAISE_FRAMES:
                    at = arm.read("Present_Position", "shoulder_lift", normalize=False)
                    force = reading.force_n.text(digits=2)
                    print(f"raised by {lift - at} of {RAISE_TICKS} steps, {force} N")
            result = grip.release()
            print(result.outcome)
    finally:
        # The servos keep holding: an arm without torque would fall.
        arm.disconnect(disable_torque=False)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "demo-so101"))
