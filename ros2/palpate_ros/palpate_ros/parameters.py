"""Parameters of the nodes, with descriptions (`ros2 param describe`)."""

from __future__ import annotations

from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node

#: Name -> default and description, of every node.
SHARED: dict[str, tuple[Any, str]] = {
    "rig": ("sim-rigid", "Name of a rig, or path of a rig file; sim-... are simulated."),
    "seed": (0, "Simulated rigs: decides what chance does."),
    "speed": (1.0, "Simulated rigs: seconds of their time in a second on the wall."),
    "frame_id": ("palpate_pad", "Frame of the pad; force points along its z axis."),
}
#: Of the gripper node.
HAND: dict[str, tuple[Any, str]] = {
    "object": ("", "Simulated rigs: what to grasp; drawn from the seed by default."),
    "joint": ("palpate_gripper", "Name of the hand's joint in joint_states: its opening in m."),
    "hold_s": (60.0, "How long an object is held for before it is released unasked, s."),
    "damage": ("", "Stay below what such produce bears: a file of `palpate calibrate damage`."),
}


def declare(node: Node, wanted: dict[str, tuple[Any, str]]) -> None:
    """Declare parameters that are read once, when the node begins."""
    for name, (default, text) in wanted.items():
        node.declare_parameter(name, default, ParameterDescriptor(description=text, read_only=True))
