"""Baselines of palpate's methods, one per file, each in its strongest simple form."""
