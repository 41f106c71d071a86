"""Configuration of the hand."""

from __future__ import annotations

from dataclasses import dataclass, field

from lerobot.cameras import CameraConfig
from lerobot.robots import RobotConfig

from palpate.grasp.safety import FORCE_CEILING_N


@RobotConfig.register_subclass("palpate")
@dataclass(kw_only=True)
class PalpateHandConfig(RobotConfig):
    """A hand with its sensor and its force limit.

    Attributes
    ----------
    rig : str
        A rig file, or the name of a simulated rig.
    limit_n : float
        Force limit of the object, N. Actions cannot close the hand beyond it.
    damage : str or None
        A file of `palpate calibrate damage`, which may lower the limit.
    kind : str
        Kind of object in the damage file; empty if unknown.
    cameras : dict
        Cameras by name; the observations do not need `lerobot_camera_palpate`.
    """

    rig: str = "rig.toml"
    limit_n: float = FORCE_CEILING_N
    damage: str | None = None
    kind: str = ""
    cameras: dict[str, CameraConfig] = field(default_factory=dict)
