"""Damaged recordings are read up to the damage, or refused in one line."""

from __future__ import annotations

import importlib.util
import resource
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import NonSeekingReader, make_reader

from palpate.errors import RecordingError
from palpate.recording import RecordingReader

BENCHMARK = Path(__file__).resolve().parents[2] / "benchmarks" / "fuzz_recordings.py"
specification = importlib.util.spec_from_file_location("fuzz_recordings", BENCHMARK)
fuzz = importlib.util.module_from_spec(specification)
specification.loader.exec_module(fuzz)


@pytest.mark.slow
def test_damaged_recordings_are_read_or_refused_in_bounded_memory(tmp_path: Path) -> None:
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    ended = [
        fuzz.read_case(content, path=tmp_path / "case.mcap")
        for content in fuzz.draw_cases(2000, seed=5)
    ]
    assert set(ended) == {"read", "refused"}
    assert ended.count("read") > 500
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 100_000


@pytest.mark.slow
def test_recovered_recordings_are_complete(tmp_path: Path) -> None:
    recovered = tmp_path / "recovered.mcap"
    count = 0
    for content in fuzz.draw_cases(150, seed=6):
        ended = fuzz.read_case(content, path=tmp_path / "case.mcap", recovered=recovered)
        if not ended.endswith(", recovered"):
            continue
        count += 1
        with recovered.open("rb") as stream:
            seeking = sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages())
        with recovered.open("rb") as stream:
            linear = sum(1 for _ in NonSeekingReader(stream, validate_crcs=True).iter_messages())
        assert seeking == linear
    assert count > 50


@settings(max_examples=200)
@given(noise=st.binary(max_size=300), magic=st.booleans())
def test_reader_refuses_random_bytes(
    noise: bytes, magic: bool, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.getbasetemp() / "noise.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" * magic + noise)
    with pytest.raises(RecordingError, match="MCAP"):
        RecordingReader(path)
