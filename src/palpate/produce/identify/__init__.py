"""What an item is, by what its grasps measured, or that it is like nothing taught."""
