"""From frames and gripper states to force, size, stiffness and damage, each with an interval."""
