"""Sorting of items into bins with rules from a file."""
