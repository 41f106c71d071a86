"""SQLAlchemy for the store, or one line that says how to install it."""

from __future__ import annotations

from palpate.errors import needing

with needing("the store of items", extra="produce"):
    import sqlalchemy as sa
    from sqlalchemy.dialects import postgresql, sqlite

__all__ = ["postgresql", "sa", "sqlite"]
