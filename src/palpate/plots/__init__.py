"""Plots in a common style; matplotlib is imported only for drawing."""
