"""Verbs of the station, joined to `palpate` by entry points."""
