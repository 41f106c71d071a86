"""palpate in ROS 2: nodes that use palpate's Python API."""
