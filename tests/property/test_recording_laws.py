"""Properties of recordings: independence of format and unit, no tracebacks."""

from __future__ import annotations

import gzip
import random
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.touches import resistance_ohm

import palpate
from palpate.errors import PalpateError
from palpate.holds.contacts import find_contacts
from palpate.holds.cutting import cut_columns
from palpate.holds.recordings import read_recordings

TIME_S = np.round(np.arange(0, 60, 0.05), 3)
OHM = np.round(resistance_ohm(TIME_S, touches=((3.0, 20.0), (26.0, 55.0))), 3)
EXPECTED = palpate.cut_holds(TIME_S, OHM)

PER_SECOND = {"time_s": 1, "ms": 1000, "micros": 1_000_000}


@pytest.mark.slow
@settings(max_examples=40)
@given(
    clock=st.sampled_from(sorted(PER_SECOND)),
    separator=st.sampled_from([",", ";", "\t", "|", "  "]),
    comma=st.booleans(),
    end=st.sampled_from(["\n", "\r\n"]),
    notes=st.integers(0, 3),
    packed=st.booleans(),
    first=st.integers(0, 30),
)
def test_holds_are_independent_of_table_format(
    tmp_path_factory: pytest.TempPathFactory,
    clock: str,
    separator: str,
    comma: bool,
    end: str,
    notes: int,
    packed: bool,
    first: int,
) -> None:
    chunk = slice(first, None)
    scale = PER_SECOND[clock]
    rows = [
        f"{time_s * scale:.3f}{separator}{ohm:.3f}"
        for time_s, ohm in zip(TIME_S[chunk], OHM[chunk], strict=True)
    ]
    if comma and separator != ",":
        rows = [row.replace(".", ",") for row in rows]
    lines = ["# a note"] * notes + [f"{clock}{separator}R_ohm", *rows]
    content = (end.join(lines) + end).encode()
    path = tmp_path_factory.mktemp("form") / ("r.csv.gz" if packed else "r.csv")
    path.write_bytes(gzip.compress(content, mtime=0) if packed else content)
    found = palpate.cut_holds(palpate.read_recording(path))
    expected = palpate.cut_holds(TIME_S[chunk], OHM[chunk])
    assert len(found) == len(expected) == len(EXPECTED) == 2
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one.values, other.values)
        np.testing.assert_allclose(one.time_s, other.time_s, atol=1e-6)


@settings(max_examples=40)
@given(
    factor=st.floats(1e-6, 1e6),
    start_s=st.floats(-1e4, 1e4),
    seed=st.integers(0, 1000),
)
def test_find_contacts_is_invariant_to_scale_and_time_shift(
    factor: float, start_s: float, seed: int
) -> None:
    ohm = resistance_ohm(TIME_S, touches=((3.0, 20.0), (26.0, 55.0)), seed=seed)
    plain = find_contacts(TIME_S, ohm).holds
    moved = find_contacts(TIME_S + start_s, factor * ohm).holds
    assert len(plain) == len(moved) == 2
    for one, other in zip(plain, moved, strict=True):
        # A later start may put a reading into the next cell.
        assert other.start_s - start_s == pytest.approx(one.start_s, abs=0.11)
        assert other.end_s - start_s == pytest.approx(one.end_s, abs=0.11)


@settings(max_examples=30)
@given(factor=st.floats(-1e3, -1e-3) | st.floats(1e-3, 1e3), shift=st.floats(-1e4, 1e4))
def test_find_contacts_in_percent_is_invariant_to_scale_shift_and_sign(
    factor: float, shift: float
) -> None:
    percent = 100 * (OHM / 2000 - 1)
    turned = factor * percent + shift
    if turned.min() > 0:
        turned = turned - 2 * turned.max()
    expected = find_contacts(TIME_S, percent - 2 * percent.max()).holds
    found = find_contacts(TIME_S, turned).holds
    assert [hold.end_s for hold in found] == [hold.end_s for hold in expected]


def draw_damaged_file(chance: random.Random) -> bytes:
    """Return the contents of a damaged recording file."""
    rows = [f"{t:.2f},{v:.1f}" for t, v in zip(TIME_S[:200], OHM[:200], strict=True)]
    content = ("time_s,R\n" + "\n".join(rows)).encode()
    kind = chance.randrange(8)
    if kind == 0:
        return bytes(chance.randrange(256) for _ in range(chance.randrange(200)))
    if kind == 1:
        return content[: chance.randrange(len(content))]
    if kind == 2:
        return gzip.compress(content, mtime=0)[: chance.randrange(400)]
    if kind == 3:
        starts = [b"PAR1", b"PK\x03\x04", b"\x89MCAP0\r\n", b"\xd0\xcf\x11\xe0", b"\xff\xfe"]
        return chance.choice(starts) + content[: chance.randrange(300)]
    changed = bytearray(content)
    for _ in range(chance.choice([1, 5, 100])):
        place = chance.randrange(len(changed))
        if kind == 4:
            changed[place] = chance.randrange(256)
        elif kind == 5:
            changed[place : place + chance.randrange(9)] = b""
        elif kind == 6:
            changed[place:place] = chance.choice(
                [b'"', b",", b"\n", b"\r", b";", b"\t", b"nan", b"_"]
            )
        else:
            changed[place:place] = chance.choice([b"1e400", b"-", b"9" * 400, b"\0", b"2024-01-01"])
    return bytes(changed)


@pytest.mark.slow
def test_damaged_table_yields_holds_or_one_line_error(tmp_path: Path) -> None:
    chance, refused = random.Random(20), []
    for number in range(800):
        path = tmp_path / f"f{number % 7}{chance.choice(['.csv', '.xlsx', '.parquet', '.gz'])}"
        path.write_bytes(draw_damaged_file(chance))
        try:
            for readings in read_recordings(path):
                cut_columns(readings)
        except PalpateError as error:
            refused.append((str(path), str(error)))
    assert 80 < len(refused) < 760
    assert all(path in message and "\n" not in message for path, message in refused)
