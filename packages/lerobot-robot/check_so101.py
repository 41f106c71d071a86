"""Check that LeRobot and palpate share an SO-101, simulated: its line, and its observations.

Run `python packages/lerobot-robot/check_so101.py` in an environment with `lerobot[feetech]`,
`palpate[gripper]` and `lerobot_robot_palpate`. It starts `palpate demo so101`. LeRobot moves the
arm while palpate grasps, and goes on while the jaw is held (`examples/so101*.py`). Then the
function of `lerobot-record` records two episodes of the robot `palpate_so101`, whose jaw is
commanded to close while its shoulder turns, with a guard at 3 N. The exit status is 1 if a check
fails.
"""

from __future__ import annotations

import math
import re
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from functools import partialmethod
from pathlib import Path
from typing import Any

import numpy as np
from check_record_loop import H264, check
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.motors.feetech import FeetechMotorsBus
from lerobot.robots import RobotConfig
from lerobot.scripts.lerobot_record import DatasetRecordConfig, RecordConfig, record
from lerobot.teleoperators import Teleoperator, TeleoperatorConfig
from lerobot.utils.import_utils import register_third_party_plugins

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
LIMIT_N, FPS, EPISODES, EPISODE_S = 3.0, 15, 2, 14.0
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
#: Opening at the start of an episode, just wider than the fruit, and its change, about 2 mm/s.
OPEN_PERCENT, PERCENT_PER_S = 60.0, 2.5
#: LeRobot waits 50 ms for a reply, once; simulated servos on a busy computer can be later.
ATTEMPTS = 6
for method in ("sync_read", "read", "write"):
    patient = partialmethod(getattr(FeetechMotorsBus, method), num_retry=ATTEMPTS)
    setattr(FeetechMotorsBus, method, patient)
#: The first seconds of an episode open the jaw.
OPENING_S = 1.0


@TeleoperatorConfig.register_subclass("leading")
@dataclass(kw_only=True)
class LeadingConfig(TeleoperatorConfig):
    """Configuration of `Leading`."""


class Leading(Teleoperator):
    """A leader arm that turns its shoulder, and opens and closes its gripper in each episode."""

    config_class = LeadingConfig
    name = "leading"
    is_connected = is_calibrated = True
    action_features = dict.fromkeys((f"{name}.pos" for name in JOINTS), float)
    feedback_features: dict[str, type] = {}  # noqa: RUF012

    def __init__(self, config: LeadingConfig) -> None:
        super().__init__(config)
        self._start_s: float | None = None

    def connect(self, calibrate: bool = True) -> None: ...
    def calibrate(self) -> None: ...
    def configure(self) -> None: ...
    def send_feedback(self, feedback: dict[str, Any]) -> None: ...
    def disconnect(self) -> None: ...
    def get_action(self) -> dict[str, float]:
        """Return the action."""
        self._start_s = self._start_s or time.monotonic()
        now_s = time.monotonic() - self._start_s
        closing_s = max(now_s % EPISODE_S - OPENING_S, 0.0)
        action = dict.fromkeys(self.action_features, 0.0)
        action["shoulder_pan.pos"] = 10.0 * math.sin(now_s)
        action["gripper.pos"] = OPEN_PERCENT - PERCENT_PER_S * closing_s
        return action


def run_example(name: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run an example, again if a simulated servo was late, and show what it prints."""
    for _ in range(ATTEMPTS):
        done = subprocess.run(
            [sys.executable, EXAMPLES / name, folder], capture_output=True, text=True, check=False
        )
        print(done.stdout, done.stderr, sep="", end="")
        if "no status packet" not in done.stderr:
            break
    return done


def record_episodes(folder: Path, root: Path) -> None:
    """Record the demo's robot with LeRobot."""
    register_third_party_plugins()
    robot = RobotConfig.get_choice_class("palpate_so101")(
        id="lerobot",
        calibration_dir=folder,
        port=str(folder / "arm"),
        rig=str(folder / "simulated.toml"),
        guard_n=LIMIT_N,
    )
    dataset = DatasetRecordConfig(
        repo_id="palpate/check",
        single_task="squeeze",
        root=root,
        fps=FPS,
        episode_time_s=EPISODE_S,
        reset_time_s=0,
        num_episodes=EPISODES,
        push_to_hub=False,
        **H264,
    )
    record(RecordConfig(robot=robot, teleop=LeadingConfig(), dataset=dataset, play_sounds=False))


def check_episodes(root: Path) -> None:
    """Load the episodes with LeRobot, and check names, newtons and the held jaw."""
    data = LeRobotDataset("palpate/check", root=root)
    names = data.meta.names["observation.state"]
    touch = ["force_n", "force_low_n", "force_high_n", "change_percent"]
    check(names == [*(f"{name}.pos" for name in JOINTS), *touch], "joints and touch by name")
    state = np.stack([np.asarray(row) for row in data.hf_dataset["observation.state"][:]])
    episode = np.asarray(data.hf_dataset["episode_index"][:])
    check(data.num_episodes == EPISODES, f"{EPISODES} episodes, {len(data)} frames")
    for number in range(EPISODES):
        part = state[episode == number]
        force_n, jaw, pan = (
            part[:, names.index(name)] for name in ("force_n", "gripper.pos", "shoulder_pan.pos")
        )
        check(1.0 < force_n.max() < 1.5 * LIMIT_N, f"largest force {force_n.max():.2f} N")
        # Not the end: the episodes drift from the leader's time.
        last = slice(-4 * FPS, -2 * FPS)
        check(np.ptp(jaw[last]) < 0.5, f"the jaw was held at {jaw[last][0]:.1f} %")
        check(np.ptp(pan[last]) > 3.0, f"the shoulder turned by {np.ptp(pan[last]):.1f} degrees")


def main() -> None:
    with tempfile.TemporaryDirectory() as parent:
        folder, root = Path(parent) / "demo", Path(parent) / "recorded"
        command = [sys.executable, "-m", "palpate", "demo", "so101", "--out", str(folder)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as demo:
            try:
                assert demo.stdout is not None
                for line in iter(demo.stdout.readline, ""):
                    print(line, end="")
                    if line.startswith("SIMULATED"):
                        break
                done = run_example("so101.py", folder)
                raised = re.search(r"raised by (\d+) of 120 steps", done.stdout)
                check(raised is not None and int(raised[1]) >= 60, "the arm moved")
                check(not done.returncode and "held" in done.stdout, "held while the arm moved")
                done = run_example("so101_guard.py", folder)
                check(not done.returncode and ", held" in done.stdout, "the guard held the jaw")
                record_episodes(folder, root)
            finally:
                demo.send_signal(signal.SIGTERM)
        check_episodes(root)
        for name in ("so101.py", "so101_guard.py"):
            done = run_example(name, Path(parent) / "none")
            one_line = len(done.stderr.splitlines()) == 1 and "demo so101" in done.stderr
            check(done.returncode != 0 and one_line, f"{name} names a wrong folder in one line")


if __name__ == "__main__":
    main()
