"""Predictions of many holds, compared with the settled values."""
