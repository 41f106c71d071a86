"""The grasp: a pure controller, what keeps it safe, and the loop that runs it."""
