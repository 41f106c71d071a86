"""The command as a user types it."""

from tests.fixtures import palpate

__all__ = ["palpate"]
