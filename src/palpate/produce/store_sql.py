"""SQLAlchemy for the store, or one line that says how to install it."""

from __future__ import annotations

from palpate.errors import MissingExtraError

try:
    import sqlalchemy as sa
    from sqlalchemy.dialects import postgresql, sqlite
except ModuleNotFoundError as error:
    raise MissingExtraError(
        "the store of items needs SQLAlchemy: run `pip install 'palpate[produce]'`"
    ) from error

__all__ = ["postgresql", "sa", "sqlite"]
