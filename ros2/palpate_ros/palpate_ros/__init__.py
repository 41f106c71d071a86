"""palpate in ROS 2; it uses palpate's Python API, and palpate knows nothing of it."""
