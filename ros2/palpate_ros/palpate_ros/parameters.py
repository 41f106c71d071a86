"""Parameters of the nodes, with descriptions (`ros2 param describe`)."""

from __future__ import annotations

from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node

#: Name -> default and description, for all nodes.
SHARED: dict[str, tuple[Any, str]] = {
    "rig": ("sim-rigid", "Name of a rig, or path of a rig file; sim-... are simulated."),
    "seed": (0, "Simulated rigs: random seed."),
    "speed": (1.0, "Simulated rigs: simulated seconds per real second."),
    "frame_id": ("palpate_pad", "Frame of the pad; force points along its z axis."),
}
#: Additional parameters of the gripper node.
HAND: dict[str, tuple[Any, str]] = {
    "object": ("", "Simulated rigs: object to grasp; drawn from the seed by default."),
    "joint": (
        "palpate_gripper",
        "Name of the hand's joint in joint_states; its position is the opening, m.",
    ),
    "hold_s": (60.0, "Duration of a hold without a request, s; the object is then released."),
    "damage": ("", "File of `palpate calibrate damage` with the damage limit of the produce."),
}


def declare(node: Node, wanted: dict[str, tuple[Any, str]]) -> None:
    """Declare parameters that are read once, at the start of the node."""
    for name, (default, text) in wanted.items():
        node.declare_parameter(name, default, ParameterDescriptor(description=text, read_only=True))
