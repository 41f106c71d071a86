"""The store of items and grasps, in an SQLite file or PostgreSQL."""

from palpate.produce.store.database import Store

__all__ = ["Store"]
