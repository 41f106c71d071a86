"""Figures and report pages of items."""
