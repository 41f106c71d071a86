"""What a user states of the hand."""

from __future__ import annotations

from dataclasses import dataclass, field

from lerobot.cameras import CameraConfig
from lerobot.robots import RobotConfig

from palpate.grasp.safety import FORCE_CEILING_N


@RobotConfig.register_subclass("palpate")
@dataclass(kw_only=True)
class PalpateHandConfig(RobotConfig):
    """A hand with its sensor, and what it may press.

    Attributes
    ----------
    rig : str
        A rig file, or a simulated rig.
    limit_n : float
        What the object withstands, N. No action closes the hand beyond it.
    damage : str or None
        A file of `palpate calibrate damage`: what it teaches lowers the limit.
    kind : str
        Kind of object that the file knows; empty if unknown.
    cameras : dict
        By name; `lerobot_camera_palpate` is not needed for the numbers.
    """

    rig: str = "rig.toml"
    limit_n: float = FORCE_CEILING_N
    damage: str | None = None
    kind: str = ""
    cameras: dict[str, CameraConfig] = field(default_factory=dict)
