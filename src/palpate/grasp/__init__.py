"""The grasp: a pure controller, its safety checks, and the loop that runs it."""
