"""Readable rules, and the bin that they choose for an item."""
