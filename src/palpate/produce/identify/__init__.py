"""The kind of an item, identified from its grasps, or unknown."""
