"""Bruise detection by comparison with earlier grasps, sound items and other sides."""
