"""The command as a user types it."""

from tests.conftest import palpate

__all__ = ["palpate"]
