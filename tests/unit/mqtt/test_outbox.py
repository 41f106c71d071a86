"""Messages that wait for the broker: in order, on the disk, and bounded."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.produce.records import Item
from palpate.produce.store import Store


def empty(store: Store) -> list[str]:
    found = []
    while (oldest := store.oldest_message("one")) is not None:
        found.append(oldest[1])
        store.remove_message(oldest[0])
    return found


@pytest.mark.slow
@settings(deadline=None)
@given(sizes=st.lists(st.integers(0, 5), max_size=12), most=st.integers(1, 6))
def test_outbox_keeps_the_newest_in_order_and_counts_the_others(
    sizes: list[int], most: int
) -> None:
    """Messages come in bursts, and one goes after each."""
    kept: list[str] = []
    number = dropped = counted = 0
    with Store.open("sqlite://") as store:
        for size in sizes:
            for _ in range(size):
                number += 1
                kept.append(str(number))
                counted += store.add_message(kept[-1], receiver="one", most=most)
                dropped += max(0, len(kept) - most)
                kept = kept[-most:]
            oldest = store.oldest_message("one")
            assert (None if oldest is None else oldest[1]) == (kept[0] if kept else None)
            if oldest is not None:
                store.remove_message(oldest[0])
                kept.pop(0)
        assert (empty(store), counted) == (kept, dropped)


def test_messages_outlive_the_program_next_to_records(tmp_path: Path) -> None:
    for text in ("one", "two"):
        with Store.open(tmp_path / "items.sqlite") as store:
            store.add_message(text, receiver="one", most=10)
            store.add_message("of another", receiver="two", most=1)
            store.add_item(Item(item_id=text))
    with Store.open(tmp_path / "items.sqlite") as store:
        assert empty(store) == ["one", "two"]
        assert len(store.items()) == 2
