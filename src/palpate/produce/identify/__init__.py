"""The kind of an item, identified from its grasps, or that it is none of the labelled ones."""
