"""Fixtures that every test of every package may use."""

pytest_plugins = ["tests.fixtures", "packages.station.tests.fixtures"]
