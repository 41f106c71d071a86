"""The kind of an item, identified from its grasps, or that it is like nothing taught."""
