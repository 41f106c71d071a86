"""The memory of items and grasps: one SQLite file, or PostgreSQL."""

from palpate.produce.store.database import Store

__all__ = ["Store"]
