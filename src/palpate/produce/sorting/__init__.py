"""Readable rules, and what bin they send an item to."""
