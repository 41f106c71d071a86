"""Holds files of users: accepted variants, and one-line errors that name the place."""

from __future__ import annotations

import gzip
import tracemalloc
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from palpate.errors import InputError
from palpate.holds import Hold, read_holds
from palpate.holds.table_files import read_table_file

HEADER = "hold_id,time_s,value\n"
RANDOM_BYTES = np.random.default_rng(7).bytes(5000)
NOISE = "".join(f"a,{i},{i * 7919 % 1000}\n" for i in range(20000))


def write_file(folder: Path, name: str, content: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def as_lists(holds: list[Hold]) -> list[tuple[str, str | None, list[float], list[float]]]:
    return [(h.hold_id, h.channel, h.time_s.tolist(), h.values.tolist()) for h in holds]


@pytest.mark.parametrize(
    "text",
    [
        HEADER + "a,0,5\na,0.5,4\nb,-1,7\n",
        "\ufeff" + HEADER + "a,0,5\na,0.5,4\nb,-1,7",
        (HEADER + "a,0,5\na,0.5,4\nb,-1,7\n").replace("\n", "\r\n"),
        HEADER + "\na,0,5\n\n  \na,0.5,4\nb,-1,7\n\n",
        'value,"hold_id", time_s\n5,"a",0\n"4",a,0.5\n7,b,-1e0\n',
        (HEADER + "a,0,5\na,0.5,4\nb,-1,7\n").replace(",", ";"),
        "\ufeffhold_id;time_s;value\r\na;0,0;5,0\r\na;0,5;4\r\nb;-1;7\r\n",
        "hold_id\ttime_s\tvalue\tnote\na\t0\t5\tx,y\na\t0,5\t4\t\nb\t-1\t7\t1.5\n",
    ],
    ids=[
        *("plain", "byte-order mark", "crlf", "blank lines", "quotes and another order"),
        *("semicolons", "decimal commas from Excel", "tabs"),
    ],
)
def test_read_holds_csv_variants_contain_same_holds(tmp_path: Path, text: str) -> None:
    wanted = [("a", None, [0.0, 0.5], [5.0, 4.0]), ("b", None, [-1.0], [7.0])]
    assert as_lists(list(read_holds(write_file(tmp_path, "holds.csv", text)))) == wanted
    packed = write_file(tmp_path, "holds.csv.gz", gzip.compress(text.encode()))
    assert as_lists(list(read_holds(packed))) == wanted


@pytest.mark.parametrize("encoding", ["cp1252", "utf-16"])
def test_read_holds_decodes_windows_encodings(tmp_path: Path, encoding: str) -> None:
    [hold] = read_holds(write_file(tmp_path, "holds.csv", (HEADER + "café,0,1\n").encode(encoding)))
    assert hold.hold_id == "café"


def test_read_holds_separates_interleaved_and_sequential_channels(tmp_path: Path) -> None:
    text = "hold_id,channel,time_s,value\na,l,0,1\na,r,0,2\na,l,1,3\na,r,2,4\nb,r,0,5\nb,,0,6\n"
    assert as_lists(list(read_holds(write_file(tmp_path, "holds.csv", text)))) == [
        ("a", "l", [0.0, 1.0], [1.0, 3.0]),
        ("a", "r", [0.0, 2.0], [2.0, 4.0]),
        ("b", "r", [0.0], [5.0]),
        ("b", None, [0.0], [6.0]),
    ]


BAD_TEXT = {
    "decimal commas between commas": (HEADER + 'a,"0,5",1\n', "line 2: time_s is '0,5'"),
    "thousands": ("hold_id;time_s;value\na;0.5;1\na;1;1,234\n", "line 3: value is '1,234'"),
    "a point after commas": (
        "hold_id;time_s;value\na;0,5;1\na;1,5;1.5\n",
        "line 3: value is '1.5'",
    ),
    "column twice": ("hold_id,time_s,value,value\na,1,2,3\n", "column value occurs twice"),
    "underscore": (HEADER + "a,0,1_000\n", "line 2: value is '1_000'"),
    "repeated": (HEADER + "a,0,1\na,0,2\n", "line 3: time is repeated in hold a"),
    "nan": (HEADER + "a,0,1\na,1,nan\n", "line 3: value is 'nan', not a finite number"),
    "backwards": (HEADER + "a,0,1\na,1,2\na,0.5,2\n", "line 4: time decreases in hold a"),
    "comes back": (
        HEADER + "a,0,1\nb,0,1\na,1,1\n",
        "line 4: the rows of hold a are not contiguous",
    ),
    "unclosed quote": (HEADER + 'a,0,1\n"b,0,1\nb,1,1\n', "line 3: not CSV"),
    "bad after a name of two lines": (HEADER + 'a,0,"\n1"\na,x,1\n', "line 4: time_s is 'x'"),
}


@pytest.mark.parametrize(("text", "message"), BAD_TEXT.values(), ids=BAD_TEXT.keys())
def test_read_holds_invalid_text_error_names_line(tmp_path: Path, text: str, message: str) -> None:
    path = write_file(tmp_path, "holds.csv", text)
    with pytest.raises(InputError) as caught:
        list(read_holds(path))
    assert message in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


BAD_BYTES = {
    "random.csv": (RANDOM_BYTES, "not a text file"),
    "cut.csv.gz": (gzip.compress((HEADER + NOISE).encode())[:-5000], "the gzip data are truncated"),
    "late.csv": (
        HEADER.encode() + NOISE.encode() + b"caf\xe9,0,1\n",
        "20002: hold_id 'caf\\ufffd'",
    ),
    "mine.mcap": (b"\x89MCAP0\r\n", "`palpate export"),
    "book.csv": (
        b"PK\x03\x04" + bytes(26) + b"[Content_Types].xml",
        "an Excel workbook; save it as CSV",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "content", "message"), [(n, *b) for n, b in BAD_BYTES.items()], ids=BAD_BYTES.keys()
)
def test_read_holds_invalid_bytes_are_refused(
    tmp_path: Path, name: str, content: bytes, message: str
) -> None:
    with pytest.raises(InputError) as caught:
        list(read_holds(write_file(tmp_path, name, content)))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert str(caught.value).isprintable()


def table(**columns: object) -> pa.Table:
    columns_of_holds = {"hold_id": ["a", "a"], "time_s": [0.0, 1.0], "value": [3.0, 2.0]}
    return pa.table(
        {name: cells for name, cells in (columns_of_holds | columns).items() if cells is not None}
    )


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"time_s": ["0", "1"]}, "column time_s is string; it must be numbers"),
        ({"value": [1.0, None]}, "row 2: value is missing"),
        ({"time_s": [1.0, 0.0]}, "row 2: time decreases"),
    ],
)
def test_read_holds_invalid_parquet_error_names_row(
    tmp_path: Path, columns: dict, message: str
) -> None:
    path = tmp_path / "holds.parquet"
    pq.write_table(table(**columns), path)
    with pytest.raises(InputError, match=message):
        list(read_holds(path))


@pytest.mark.parametrize("rows", [20, 100])
def test_small_parquet_file_with_huge_repeated_text_is_refused(tmp_path: Path, rows: int) -> None:
    """Compression stores a repeated text of megabytes in a few bytes."""
    path = tmp_path / "holds.parquet"
    names = pa.DictionaryArray.from_arrays(pa.array([0] * rows), pa.array(["a" * 3_000_000]))
    times = [float(row) for row in range(rows)]
    table = pa.table({"hold_id": names, "time_s": times, "value": times})
    pq.write_table(table, path, compression="zstd", store_schema=False)
    assert path.stat().st_size < 10_000
    for read in (read_holds, read_table_file):
        with pytest.raises(InputError, match=r"hold_id has a text of more than 65536 characters"):
            read(path)
    values = pa.table({"hold_id": ["a" * 65_536], "time_s": [0.0], "value": [1.0]})
    pq.write_table(values, path)
    assert read_table_file(path).rows == len(read_holds(path)) == 1


def test_read_holds_parquet_dictionaries_integers_and_float32(tmp_path: Path) -> None:
    path = tmp_path / "holds.parquet"
    columns = {
        "hold_id": pa.array(["a", "a"]).dictionary_encode(),
        "time_s": pa.array([0, 1]),
        "value": pa.array([3.5, 2.5], pa.float32()),
        "channel": pa.array([7, 7]),
    }
    pq.write_table(table(**columns), path)
    assert as_lists(list(read_holds(path))) == [("a", "7", [0.0, 1.0], [3.5, 2.5])]


def test_read_holds_samples_after_until_s_are_checked_but_dropped(tmp_path: Path) -> None:
    rows = "".join(f"a,{i},{i}\n" for i in range(10))
    path = write_file(tmp_path, "holds.csv", HEADER + rows)
    [hold] = read_holds(path, until_s=3.5)
    assert hold.time_s.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    [long] = read_holds(write_file(tmp_path, "long.csv", HEADER + NOISE), until_s=3.5)
    assert long.time_s.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    bad = write_file(tmp_path, "bad.csv", HEADER + rows + "a,9,1\n")
    with pytest.raises(InputError, match="line 12: time is repeated"):
        list(read_holds(bad, until_s=3.5))


def peak_memory(path: Path) -> int:
    tracemalloc.start()
    try:
        for _ in read_holds(path, until_s=20.0):
            pass
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.slow
@pytest.mark.parametrize("one_hold", [False, True], ids=["many holds", "one endless hold"])
def test_read_holds_memory_is_independent_of_file_size(tmp_path: Path, one_hold: bool) -> None:
    peaks = []
    for count in (20, 80):
        path = tmp_path / f"{count}.csv.gz"
        with gzip.open(path, "wt", compresslevel=1) as file:
            file.write(HEADER)
            for hold in range(count):
                name, start = ("a", hold * 40.0) if one_hold else (f"h{hold}", 0.0)
                file.writelines(f"{name},{start + i * 0.1:.1f},{i}\n" for i in range(400))
        peaks.append(peak_memory(path))
    assert peaks[1] < 1.2 * peaks[0]


def test_read_holds_ignores_other_columns(tmp_path: Path) -> None:
    text = tmp_path / "holds.csv"
    text.write_text(",hold_id,time_s,value,note,note\n0,a,0,3,x_1,\n1,a,1,2,,y\n")
    packed = tmp_path / "holds.parquet"
    pq.write_table(table(index=[0, 1], parts=[[1], [2, 3]]), packed)
    for path in (text, packed):
        [hold] = read_holds(path)
        assert (hold.hold_id, hold.channel) == ("a", None)
        assert (hold.time_s.tolist(), hold.values.tolist()) == ([0.0, 1.0], [3.0, 2.0])
