"""Grippers driven by width or by pressure."""
