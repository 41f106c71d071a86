"""The studies' tests use the same folder of real recordings as the product's."""

from tests.conftest import real_data

__all__ = ["real_data"]
