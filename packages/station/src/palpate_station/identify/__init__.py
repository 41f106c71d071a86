"""Identification of an item's kind from its grasps."""
