"""Pixel arrays: frames, samples, the wire, boards and health."""
