"""Agreement of grasps with a reference instrument."""
