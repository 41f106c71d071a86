"""Recorded grasps as a data set of LeRobot (its format v3.0), to learn grasping from.

Needs LeRobot neither to write nor to test it.
"""
