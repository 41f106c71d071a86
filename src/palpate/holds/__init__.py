"""Holds: stretches of one channel after the gripper stopped, as files and as arrays."""

from __future__ import annotations

from palpate.holds.hold import Hold
from palpate.holds.read import read_holds

__all__ = ["Hold", "read_holds"]
