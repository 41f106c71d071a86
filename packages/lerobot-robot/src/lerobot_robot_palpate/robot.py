"""The robot: opening and force as observations, opening and speed as the action."""

from __future__ import annotations

import logging
from functools import cached_property
from pathlib import Path
from typing import Any

from lerobot.cameras.utils import make_cameras_from_configs
from lerobot.robots import Robot
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

from lerobot_robot_palpate.config import PalpateHandConfig
from palpate.rig import Rig, open_rig
from palpate_lerobot.episode import action_names, state_names
from palpate_lerobot.hand import PolicyHand, read_learned_limit_n


class PalpateHand(Robot):
    """A hand with palpate's sensor that implements LeRobot's robot interface.

    Parameters
    ----------
    config : PalpateHandConfig
        The rig and the force limit.
    """

    config_class = PalpateHandConfig
    name = "palpate"

    def __init__(self, config: PalpateHandConfig) -> None:
        super().__init__(config)
        self.config = config
        self.cameras = make_cameras_from_configs(config.cameras)
        self._hand: PolicyHand | None = None

    @cached_property
    def _rig(self) -> Rig:
        """The devices, opened at first use."""
        rig = open_rig(self.config.rig)
        if rig.is_simulated:
            logging.getLogger(__name__).warning("%s is SIMULATED", self)
        return rig

    @property
    def observation_features(self) -> dict[str, Any]:
        """Names as in the data sets of `palpate export --lerobot`, and the cameras' images."""
        names = state_names(self._rig.array.layout, self._rig.gripper.limits.drive)
        images = {name: (one.height, one.width, 3) for name, one in self.cameras.items()}
        return dict.fromkeys(names, float) | images

    @property
    def action_features(self) -> dict[str, type]:
        """Names of target and speed."""
        return dict.fromkeys(action_names(self._rig.gripper.limits.drive), float)

    @property
    def is_connected(self) -> bool:
        """Whether the hand is connected."""
        return self._hand is not None

    @property
    def is_calibrated(self) -> bool:
        """Always true; a rig without calibration does not open."""
        return True

    def calibrate(self) -> None:
        """Do nothing; use `palpate calibrate`."""

    def configure(self) -> None:
        """Do nothing; the rig file contains the configuration."""

    def connect(self, calibrate: bool = True) -> None:
        """Measure the rest of the open hand, and connect the cameras."""
        if self._hand is not None:
            raise DeviceAlreadyConnectedError(f"{self} is already connected")
        limit_n = self.config.limit_n
        if self.config.damage is not None:
            learned_n = read_learned_limit_n(Path(self.config.damage), kind=self.config.kind)
            limit_n = min(limit_n, learned_n)
        rig = self._rig
        for camera in self.cameras.values():
            camera.connect()
        self._hand = PolicyHand(
            rig.array, rig.gripper, calibration=rig.calibration, limit_n=limit_n
        )

    def get_observation(self) -> dict[str, Any]:
        """Return the hand's observation and the cameras' images."""
        images = {name: camera.read_latest() for name, camera in self.cameras.items()}
        return self._require_hand().observe() | images

    def send_action(self, action: dict[str, Any]) -> dict[str, float]:
        """Move within the force limit; return the command sent."""
        return self._require_hand().send({name: float(value) for name, value in action.items()})

    def disconnect(self) -> None:
        """Stop the fingers where they are, and close the devices."""
        hand, self._hand = self._require_hand(), None
        try:
            hand.close()
        finally:
            # Close the cameras and reset the rig even if the hand does not respond.
            del self._rig
            for camera in self.cameras.values():
                camera.disconnect()

    def _require_hand(self) -> PolicyHand:
        if self._hand is None:
            raise DeviceNotConnectedError(f"{self} is not connected; call connect() first")
        return self._hand
