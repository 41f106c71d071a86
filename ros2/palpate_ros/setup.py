"""colcon installs this package; palpate itself comes from pip (`pip install palpate`)."""

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
