"""The same runner in a browser."""
