"""Procedures of calibration, shared by the command line and the page."""
