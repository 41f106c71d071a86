"""Pixel arrays: frames, the wire, recordings, health and calibration."""
