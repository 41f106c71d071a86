"""The option that every verb on the store shares."""

from __future__ import annotations

STORE_HELP = (
    "The store of items: a file, or a URL such as postgresql://user@host/database; by default "
    "$PALPATE_STORE, else palpate-items.sqlite in this folder."
)
