"""How firm grasps found an item, how its kind softens, and when it will be ripe."""
