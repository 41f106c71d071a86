"""Predictors of the value that a hold settles to."""
