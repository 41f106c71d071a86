"""Fixtures for the verbs of the station."""

from tests.unit.cli.conftest import folder

__all__ = ["folder"]
