"""A hand with its sensor: `ros2 launch palpate_ros gripper.launch.py rig:=my-rig.toml`."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    """Return one gripper node; the rig is an argument."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("rig", default_value="sim-rigid"),
            Node(
                package="palpate_ros",
                executable="gripper",
                name="palpate_gripper",
                output="screen",
                parameters=[{"rig": LaunchConfiguration("rig")}],
            ),
        ]
    )
