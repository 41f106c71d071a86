"""Figures that only studies draw, in the style of `palpate.plots`."""
