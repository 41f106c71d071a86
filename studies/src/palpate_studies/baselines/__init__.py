"""Baselines that ours has to beat: one a file, each in its strongest plain form."""
