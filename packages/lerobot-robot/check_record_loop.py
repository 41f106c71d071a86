"""Check that LeRobot records with palpate's robot and camera, on the twin.

Run `python packages/lerobot-robot/check_record_loop.py` in an environment with LeRobot 0.4 or 0.6,
palpate, `lerobot_robot_palpate` and `lerobot_camera_palpate`. The function of `lerobot-record`
records two episodes in which the hand is commanded to close fully, with a force limit of 3 N. The
exit status is 1 if a check fails.
"""

from __future__ import annotations

import os
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ["HF_HUB_OFFLINE"] = "1"

import av
import numpy as np
from lerobot.cameras import CameraConfig
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.robots import RobotConfig
from lerobot.scripts.lerobot_record import DatasetRecordConfig, RecordConfig, record
from lerobot.teleoperators import Teleoperator, TeleoperatorConfig
from lerobot.utils.import_utils import register_third_party_plugins

LIMIT_N, FPS, EPISODES, EPISODE_S = 3.0, 15, 2, 30.0
#: Options of LeRobot 0.6 and 0.4 for a codec that every player supports.
try:
    from lerobot.configs.video import RGBEncoderConfig

    H264: dict[str, Any] = {"rgb_encoder": RGBEncoderConfig(vcodec="h264"), "no_stamp": True}
except ImportError:
    H264 = {"vcodec": "h264"}


@TeleoperatorConfig.register_subclass("closing")
@dataclass(kw_only=True)
class ClosingConfig(TeleoperatorConfig):
    """Configuration of `Closing`."""


class Closing(Teleoperator):
    """A teleoperator that always closes fully."""

    config_class = ClosingConfig
    name = "closing"
    is_connected = is_calibrated = True
    action_features = {"width_mm": float, "rate_mm_per_s": float}  # noqa: RUF012
    feedback_features: dict[str, type] = {}  # noqa: RUF012

    def connect(self, calibrate: bool = True) -> None: ...
    def calibrate(self) -> None: ...
    def configure(self) -> None: ...
    def send_feedback(self, feedback: dict[str, Any]) -> None: ...
    def disconnect(self) -> None: ...
    def get_action(self) -> dict[str, float]:
        """Return the action."""
        return {"width_mm": 5.0, "rate_mm_per_s": 20.0}


def check(passed: bool, what: str) -> None:
    print(("ok  " if passed else "BAD ") + what)
    if not passed:
        sys.exit(1)


def main() -> None:
    register_third_party_plugins()
    camera = CameraConfig.get_choice_class("palpate")(
        rig="sim-rigid", width=64, height=128, fps=FPS
    )
    robot = RobotConfig.get_choice_class("palpate")(
        id="twin", rig="sim-rigid", limit_n=LIMIT_N, cameras={"touch": camera}
    )
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "recorded"
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
        record(
            RecordConfig(robot=robot, teleop=ClosingConfig(), dataset=dataset, play_sounds=False)
        )
        data = LeRobotDataset("palpate/check", root=root)
        names = data.meta.names["observation.state"]
        state = np.stack([np.asarray(row) for row in data.hf_dataset["observation.state"][:]])
        with av.open(next(root.glob("videos/observation.images.touch/*/*.mp4"))) as film:
            images = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    check(data.num_episodes == EPISODES, f"{EPISODES} episodes, {len(data)} frames")
    check(
        names[:4] == ["width_mm", "force_n", "force_low_n", "force_high_n"],
        "names of position and force",
    )
    force_n = state[:, names.index("force_n")]
    check(1.0 < force_n.max() <= 1.1 * LIMIT_N, f"largest force {force_n.max():.2f} N")
    check(len(images) == len(data), "one image of the pixels per frame")
    check({image.shape for image in images} == {(128, 64, 3)}, "images of the requested size")


if __name__ == "__main__":
    main()
