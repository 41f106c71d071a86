"""Predictions of many holds, compared with the values that they settled to."""
