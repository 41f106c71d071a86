"""The gripper of a rig that has none."""

from __future__ import annotations

from palpate.errors import InputError
from palpate.gripper.interface import GripperCommand, GripperLimits, GripperState

#: What a user reads who grasps with a rig without a gripper.
NO_GRIPPER = (
    "this rig has no gripper: add a table [gripper] to its file (`palpate init --gripper`), or "
    "pass gripper=... in Python"
)


class NoGripper:
    """Nothing moves, and a command raises `InputError`."""

    limits = GripperLimits(drive="width", lowest=0.0, highest=0.0, fastest=0.0)

    def state(self) -> GripperState:
        """Raise `InputError`."""
        raise InputError(NO_GRIPPER)

    def command(self, wanted: GripperCommand) -> GripperCommand:
        """Raise `InputError`."""
        raise InputError(NO_GRIPPER)

    def stop(self) -> None:
        """Do nothing."""

    def release(self) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""
