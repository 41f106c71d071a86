"""The outbox: in order, on the disk, and bounded."""

from __future__ import annotations

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from palpate.mqtt.outbox import Outbox


def emptied(outbox: Outbox) -> list[bytes]:
    found = []
    while (oldest := outbox.oldest()) is not None:
        found.append(oldest[1])
        outbox.remove(oldest[0])
    return found


@given(sizes=st.lists(st.integers(0, 5), max_size=12), most=st.integers(1, 6))
def test_it_gives_the_newest_in_their_order_and_counts_the_others(
    sizes: list[int], most: int
) -> None:
    """Messages come in bursts, and one goes after each."""
    outbox, kept, number, dropped = Outbox(":memory:", most=most), [], 0, 0
    for size in sizes:
        for _ in range(size):
            number += 1
            kept.append(b"%d" % number)
            outbox.add(kept[-1])
            dropped += max(0, len(kept) - most)
            kept = kept[-most:]
        if kept:
            oldest = outbox.oldest()
            assert oldest is not None
            assert oldest[1] == kept.pop(0)
            outbox.remove(oldest[0])
    assert (emptied(outbox), outbox.dropped) == (kept, dropped)
    outbox.close()


def test_it_outlives_the_program(tmp_path: Path) -> None:
    path = tmp_path / "new" / "outbox.sqlite"
    first = Outbox(path)
    first.add(b"one")
    first.add(b"two")
    first.close()
    second = Outbox(path)
    assert emptied(second) == [b"one", b"two"]
    second.close()
