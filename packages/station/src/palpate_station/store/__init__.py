"""The store of items and grasps, in an SQLite file or PostgreSQL."""

from palpate_station.store.database import Store

__all__ = ["Store"]
