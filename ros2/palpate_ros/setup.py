"""Setup of the package for colcon; palpate itself is installed with `pip install palpate`."""

from setuptools import setup

PACKAGE = "palpate_ros"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=[PACKAGE],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/launch", ["launch/gripper.launch.py"]),
    ],
    install_requires=["palpate>=0.1"],
    entry_points={
        "console_scripts": [
            "sensor = palpate_ros.sensor_node:main",
            "gripper = palpate_ros.gripper_node:main",
            "bag_to_recording = palpate_ros.bag:main",
        ]
    },
)
