"""Firmness of an item, softening of its kind, and days to ripe."""
