"""Calibration procedures, shared by the command line and the dashboard."""
