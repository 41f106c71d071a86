"""LeRobot's SO-101 follower with the touch of a sensor in its observations, and a guarded jaw."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from lerobot.robots import Robot, RobotConfig
from lerobot.robots.so_follower import SO101Follower, SO101FollowerConfig
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

from palpate.gripper.no_gripper import NoGripper
from palpate.gripper.settings import check_number
from palpate.gripper.sts_series import RAD_PER_TICK
from palpate.rig import open_rig
from palpate.rig.guard import check_limit
from palpate_lerobot.touch import TOUCH_NAMES, Touch

_GRIPPER = "gripper"


@RobotConfig.register_subclass("palpate_so101")
@dataclass(kw_only=True)
class PalpateSO101Config(SO101FollowerConfig):
    """Options of LeRobot's `so101_follower`, and the sensor.

    Attributes
    ----------
    rig : str
        A rig file with the sensor; its gripper, if any, is left to LeRobot.
    guard_n : float or None
        Force limit of the jaw, N; no guard without it.
    guard_n_per_mm : float or None
        Largest rise of the force per mm of closing; by default on a rigid object
        (`palpate_lerobot.touch.Touch`).
    guard_below : float
        Opening in percent below which the jaw may meet an object, and is slowed.
    jaw_mm : float
        Distance from the servo's axis to the middle of the pad, mm.
    """

    rig: str = "sensor.toml"
    guard_n: float | None = None
    guard_n_per_mm: float | None = None
    guard_below: float = 100.0
    jaw_mm: float = 100.0


class _Servo:
    """Servo 6 in LeRobot's units, 0 (closed) to 100 (open)."""

    def __init__(self, bus: Any, *, jaw_mm: float) -> None:
        self._bus, self._jaw_mm = bus, jaw_mm

    @property
    def mm_per_unit(self) -> float:
        known = self._bus.calibration[_GRIPPER]
        ticks: int = known.range_max - known.range_min
        return 0.01 * ticks * RAD_PER_TICK * self._jaw_mm

    def read(self) -> float:
        # LeRobot rounds goals down to steps of the servo: half a step more, so that holding does
        # not close.
        known = self._bus.calibration[_GRIPPER]
        half_step: float = 50.0 / (known.range_max - known.range_min)
        position: float = self._bus.read("Present_Position", _GRIPPER)
        return position + half_step

    def write(self, position: float) -> None:
        self._bus.write("Goal_Position", _GRIPPER, position)


class PalpateSO101(Robot):
    """An SO-101 follower whose observations include the touch.

    The guard bounds how far the jaw closes (`palpate_lerobot.touch.Touch`). Other joints follow.

    Parameters
    ----------
    config : PalpateSO101Config
        The follower, the sensor and the force limit.
    """

    config_class = PalpateSO101Config
    name = "palpate_so101"

    def __init__(self, config: PalpateSO101Config) -> None:
        super().__init__(config)
        self.config = config
        #: LeRobot's own robot, with the calibration file of its own name.
        self.arm = SO101Follower(config)
        self.cameras = self.arm.cameras
        self._touch: Touch | None = None

    @property
    def observation_features(self) -> dict[str, Any]:
        """Those of the follower, and the touch."""
        return {**self.arm.observation_features, **dict.fromkeys(TOUCH_NAMES, float)}

    @property
    def action_features(self) -> dict[str, Any]:
        """Those of the follower."""
        features: dict[str, Any] = self.arm.action_features
        return features

    @property
    def is_connected(self) -> bool:
        """Whether the arm and the sensor are connected."""
        return self._touch is not None and bool(self.arm.is_connected)

    @property
    def is_calibrated(self) -> bool:
        """Whether LeRobot has calibrated the arm."""
        return bool(self.arm.is_calibrated)

    def calibrate(self) -> None:
        """Calibrate the arm as LeRobot does."""
        self.arm.calibrate()

    def configure(self) -> None:
        """Configure the arm as LeRobot does."""
        self.arm.configure()

    def connect(self, calibrate: bool = True) -> None:
        """Open the sensor, connect the arm, and guard the jaw."""
        if self._touch is not None:
            raise DeviceAlreadyConnectedError(f"{self} is already connected")
        config = self.config
        if config.guard_n is not None:
            check_limit("guard_n", config.guard_n)
        if config.guard_n_per_mm is not None:
            check_number("guard_n_per_mm", config.guard_n_per_mm, low=0.1, high=100.0, unit="N/mm")
        check_number("guard_below", config.guard_below, low=0.0, high=100.0, unit="%")
        check_number("jaw_mm", config.jaw_mm, low=10.0, high=300.0, unit="mm")
        rig = open_rig(config.rig, gripper=NoGripper())
        try:
            touch = Touch(
                rig,
                jaw=_Servo(self.arm.bus, jaw_mm=config.jaw_mm),
                limit_n=config.guard_n,
                stiffest_n_per_mm=config.guard_n_per_mm,
                free_above=config.guard_below,
            )
            self.arm.connect(calibrate)
        except BaseException:
            rig.close()
            raise
        touch.start()
        self._touch = touch

    def get_observation(self) -> dict[str, Any]:
        """Return joints, touch and images."""
        touch = self._require_touch()
        with touch.lock:
            seen = self.arm.get_observation()
        return {**seen, **touch.observe(float(seen[f"{_GRIPPER}.pos"]))}

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Send an action with the jaw within the guard; return the action sent."""
        touch, wanted = self._require_touch(), f"{_GRIPPER}.pos"
        with touch.lock:
            if wanted in action:
                action = {**action, wanted: touch.limit(float(action[wanted]))}
            sent: dict[str, Any] = self.arm.send_action(action)
        return sent

    def disconnect(self) -> None:
        """End the guard, and disconnect sensor and arm."""
        touch, self._touch = self._require_touch(), None
        try:
            touch.close()
        finally:
            self.arm.disconnect()

    def _require_touch(self) -> Touch:
        if self._touch is None:
            raise DeviceNotConnectedError(f"{self} is not connected; call connect() first")
        return self._touch
