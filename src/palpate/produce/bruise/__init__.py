"""Bruise examination of an item against its history, other sides and sound items."""
