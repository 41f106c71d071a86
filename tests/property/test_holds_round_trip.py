"""A written holds file is read back exactly, in any split of its text."""

from __future__ import annotations

import csv
import gzip
import tempfile
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.holds import Hold, read_holds, table

#: Without U+FFFD, which represents lost bytes and is refused.
CHARACTERS = st.characters(
    codec="utf-8", exclude_categories=("C", "Z"), exclude_characters="\ufffd"
)
NAMES = st.text(CHARACTERS, min_size=1, max_size=6)
#: Larger numbers are refused.
NUMBERS = st.floats(-1e150, 1e150)
SAMPLES = st.dictionaries(NUMBERS.map(lambda number: number + 0.0), NUMBERS, min_size=1, max_size=8)
#: hold -> channel -> time -> value
FILES = st.dictionaries(
    NAMES, st.dictionaries(NAMES, SAMPLES, min_size=1, max_size=3), min_size=1, max_size=5
)


def rows_of(file: dict) -> list[tuple[str, str, float, float]]:
    """Interleave the channels of each hold by time."""
    rows = []
    for hold_id, channels in file.items():
        samples = [(t, c, v) for c, points in channels.items() for t, v in points.items()]
        rows += [(hold_id, channel, t, value) for t, channel, value in sorted(samples)]
    return rows


def write(path: Path, rows: list) -> None:
    columns = ("hold_id", "channel", "time_s", "value")
    if path.suffix == ".parquet":
        pq.write_table(pa.table(dict(zip(columns, zip(*rows, strict=True), strict=True))), path)
        return
    opener = gzip.open if path.suffix == ".gz" else open
    with opener(path, "wt", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(columns)
        writer.writerows(rows)


def collect_samples(holds: list[Hold]) -> dict:
    read: dict = {}
    for hold in holds:
        points = dict(zip(hold.time_s.tolist(), hold.values.tolist(), strict=True))
        read.setdefault(hold.hold_id, {})[hold.channel] = points
    return read


@pytest.mark.slow
@settings(max_examples=40)
@given(
    file=FILES,
    ending=st.sampled_from([".csv", ".csv.gz", ".parquet"]),
    rows_at_a_time=st.integers(1, 7),
)
def test_holds_file_roundtrip_for_any_chunk_size(
    file: dict, ending: str, rows_at_a_time: int
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"holds{ending}"
        write(path, rows_of(file))
        with patch.object(table, "ROWS_AT_A_TIME", rows_at_a_time):
            holds = list(read_holds(path))
    assert collect_samples(holds) == file
    assert [hold.hold_id for hold in holds] == [h for h, cs in file.items() for _ in cs]
    assert all(np.all(hold.time_s[1:] > hold.time_s[:-1]) for hold in holds)
