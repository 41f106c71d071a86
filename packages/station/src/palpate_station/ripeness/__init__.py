"""Ripeness of an item: firmness, course of softening, stage and days to ripe."""
