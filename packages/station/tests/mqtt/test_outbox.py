"""The store's outbox: ordered, persistent and bounded."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate_station.records import Item
from palpate_station.store import Store


def drain_outbox(store: Store) -> list[str]:
    found = []
    while (oldest := store.oldest_message("one")) is not None:
        found.append(oldest[1])
        store.remove_message(oldest[0])
    return found


@pytest.mark.slow
@given(sizes=st.lists(st.integers(0, 5), max_size=12), most=st.integers(1, 6))
def test_full_outbox_retains_the_newest_messages_in_order_and_counts_dropped_ones(
    sizes: list[int], most: int
) -> None:
    """Messages arrive in bursts; one message is removed after each burst."""
    retained: list[str] = []
    number = dropped = counted = 0
    with Store.open("sqlite://") as store:
        for size in sizes:
            for _ in range(size):
                number += 1
                retained.append(str(number))
                counted += store.add_message(retained[-1], receiver="one", most=most)
                dropped += max(0, len(retained) - most)
                retained = retained[-most:]
            oldest = store.oldest_message("one")
            assert (None if oldest is None else oldest[1]) == (retained[0] if retained else None)
            if oldest is not None:
                store.remove_message(oldest[0])
                retained.pop(0)
        assert (drain_outbox(store), counted) == (retained, dropped)


def test_outbox_messages_and_items_persist_after_the_store_is_closed(tmp_path: Path) -> None:
    for text in ("one", "two"):
        with Store.open(tmp_path / "items.sqlite") as store:
            store.add_message(text, receiver="one", most=10)
            store.add_message("of another", receiver="two", most=1)
            store.add_item(Item(item_id=text))
    with Store.open(tmp_path / "items.sqlite") as store:
        assert drain_outbox(store) == ["one", "two"]
        assert len(store.items()) == 2
