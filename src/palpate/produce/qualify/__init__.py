"""Agreement of grasps with a reference instrument, and its ceiling."""
