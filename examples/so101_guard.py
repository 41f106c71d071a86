"""Teleoperate an SO-101 whose jaw is held before the force passes 3 N, while the arm goes on.

    palpate demo so101                       # simulated; in another terminal
    python examples/so101_guard.py demo-so101

The robot is `palpate_so101` of `packages/lerobot-robot`: LeRobot's own follower with the touch in
its observations. Here a program takes the place of the leader arm: it turns the shoulder and closes
the gripper. On a real arm use `lerobot-teleoperate` (docs/so101.md). Needs `lerobot[feetech]` and
that package.
"""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path

from lerobot_robot_palpate import PalpateSO101, PalpateSO101Config

#: Percent of the jaw's opening per frame, about 2 mm/s; the guard slows a faster one.
STEP_PERCENT, FRAME_S, FRAMES = 0.15, 0.05, 600
LIMIT_N, SWAY_DEGREES = 3.0, 10.0


def main(folder: Path) -> None:
    """Turn the shoulder and close the jaw until it is held, go on for 2 s, and open it."""
    rig_file = folder / "simulated.toml"
    if not (folder / "arm").exists():
        sys.exit(f"{folder}: no demo runs there; start `palpate demo so101`, and name its folder")
    robot = PalpateSO101(
        PalpateSO101Config(
            id="lerobot",  # the demo's calibration file, lerobot.json
            calibration_dir=folder,
            port=str(folder / "arm"),
            rig=str(rig_file),
            guard_n=LIMIT_N,
        )
    )
    robot.connect(calibrate=False)
    try:
        start = {name: robot.get_observation()[name] for name in robot.action_features}
        goal, held = dict(start), 0
        for frame in range(FRAMES):
            goal["shoulder_pan.pos"] = SWAY_DEGREES * math.sin(frame * FRAME_S)
            goal["gripper.pos"] -= STEP_PERCENT
            sent = robot.send_action(goal)
            seen = robot.get_observation()
            held += sent["gripper.pos"] > goal["gripper.pos"]
            if frame % 20 == 0 or held == 1:
                print(
                    f"gripper {seen['gripper.pos']:.1f} %, shoulder "
                    f"{seen['shoulder_pan.pos']:+.1f} degrees, {seen['force_n']:.2f} N"
                    f"{', held' if held else ''}"
                )
            if held * FRAME_S > 2.0:
                break
            time.sleep(FRAME_S)
        robot.send_action(start)
        time.sleep(1.0)
        print(f"opened, {robot.get_observation()['force_n']:.2f} N")
    finally:
        robot.disconnect()


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "demo-so101"))
