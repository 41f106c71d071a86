"""On damaged bytes the decoder accepts only sent messages and resynchronizes quickly.

`PALPATE_FULL=1` runs every change, deletion and insertion in 200 frames, 100 000 random changes of
each length and a million fuzzed chunks (ten minutes). Otherwise a fixed fraction is run.
"""

from __future__ import annotations

import os
import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.sensor.wire import MAX_ENCODED_BYTES, Decoder, decode_cobs, encode_cobs
from palpate.sensor.wire_messages import BoardMessage, CellSample, FrameMessage
from palpate_studies.board_bytes import encode_message

FULL = os.environ.get("PALPATE_FULL") == "1"
AROUND = 3


def _encode_frames(count: int, *, seed: int = 3, pixels: int = 1023) -> list[bytes]:
    rng = np.random.default_rng(seed)
    return [
        encode_message(
            FrameMessage(
                sequence=number,
                time_us=1000 + 4000 * number,
                stream=9,
                oversampling=1,
                status=0,
                counts=rng.integers(0, pixels, (4, 2), endpoint=True).astype(np.uint16),
            )
        )
        for number in range(count)
    ]


def _key(message: BoardMessage) -> tuple[int, int, bytes]:
    assert isinstance(message, FrameMessage)
    return message.sequence, message.time_us, message.counts.tobytes()


def _check(
    data: bytes, *, around: list[bytes], hit: int, true: set[tuple[int, int, bytes]]
) -> None:
    """Check that accepted frames were sent, and that at most two are lost and counted."""
    decoder = Decoder()
    got = [_key(message) for message in decoder.feed(data)]
    assert set(got) <= true
    assert len(got) == len(set(got))
    assert len(got) >= len(around) - 2
    missing = [n for n in range(got[0][0], got[-1][0] + 1) if n not in {key[0] for key in got}]
    assert decoder.counters.lost == len(missing)
    assert got[-1][0] == hit + AROUND, "the decoder must resynchronize after the damage"


def _variants(frame: bytes, *, every: int, offset: int) -> list[bytes]:
    changed = [
        frame[:at] + bytes([value]) + frame[at + 1 :]
        for at in range(len(frame))
        for value in range(256)
        if value != frame[at]
    ]
    deleted = [frame[:at] + frame[at + 1 :] for at in range(len(frame))]
    inserted = [
        frame[:at] + bytes([value]) + frame[at:] for at in range(len(frame)) for value in range(256)
    ]
    return (changed + inserted)[offset::every] + deleted


@pytest.mark.slow
def test_decoder_rejects_every_single_byte_change_deletion_or_insertion() -> None:
    frames = _encode_frames(200 + 2 * AROUND)
    true = {_key(message) for message in Decoder().feed(b"".join(frames))}
    tried = 0
    for hit in range(AROUND, 200 + AROUND):
        before, after = frames[hit - AROUND : hit], frames[hit + 1 : hit + 1 + AROUND]
        around = [*before, frames[hit], *after]
        for damaged in _variants(frames[hit], every=1 if FULL else 599, offset=hit % 599):
            data = b"".join([*before, damaged, *after])
            _check(data, around=around, hit=hit, true=true)
            tried += 1
    assert tried > (3_000_000 if FULL else 10_000)


@pytest.mark.parametrize("burst", [1, 4, 40])
def test_decoder_counts_losses_from_random_damage_in_a_long_stream(burst: int) -> None:
    frames = _encode_frames(400_000 if FULL else 5000, seed=burst)
    true = {_key(message) for message in Decoder().feed(b"".join(frames))}
    chance = random.Random(burst)
    stream = b"".join(frames)
    pieces, at, hits = [], 0, 0
    while at < len(stream):
        step = chance.randrange(20, 200)
        pieces.append(stream[at : at + step])
        at += step
        noise = chance.randbytes(chance.randrange(burst + 1))
        pieces.append(noise)
        at += chance.randrange(burst + 1)
        hits += 1
    decoder = Decoder()
    got = [_key(message) for message in decoder.feed(b"".join(pieces))]
    counters = decoder.counters
    assert set(got) <= true
    assert len(got) == len(set(got)) == counters.frames
    assert counters.lost == got[-1][0] - got[0][0] + 1 - len(got)
    assert hits > (100_000 if FULL else 1000)
    # Each damage loses the affected frames and the frame merged with them.
    assert counters.corrupt <= counters.lost + hits
    assert 0 < counters.lost <= hits * (2 + burst // len(frames[0]))


@pytest.mark.slow
@settings(max_examples=150)
@given(st.data())
def test_decoder_result_does_not_depend_on_the_chunks(data: st.DataObject) -> None:
    stream = b"\x07garbage\0" + b"".join(_encode_frames(12))
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=30)))
    whole, pieces = Decoder(), Decoder()
    wanted = [_key(message) for message in whole.feed(stream)]
    got = []
    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        got += [_key(message) for message in pieces.feed(stream[start:end])]
    assert got == wanted
    assert len(got) == 12
    assert pieces.counters == whole.counters


@settings(max_examples=300)
@given(st.binary(max_size=1200))
def test_cobs_roundtrips_any_bytes_without_zeros(data: bytes) -> None:
    encoded = encode_cobs(data)
    assert 0 not in encoded
    assert decode_cobs(encoded) == data
    assert len(encoded) <= len(data) + 1 + len(data) // 254


def test_decoder_accepts_no_frame_from_random_bytes() -> None:
    chance = random.Random(5)
    decoder = Decoder()
    frames = _encode_frames(50)
    for _ in range(1_000_000 if FULL else 20_000):
        if chance.random() < 0.5:
            piece = chance.randbytes(chance.randrange(80))
        else:
            mutated = bytearray(chance.choice(frames))
            mutated[chance.randrange(len(mutated))] ^= chance.randrange(1, 256)
            piece = bytes(mutated)
        decoder.feed(piece)
    assert decoder.counters.corrupt > 1000
    assert decoder.counters.frames == 0, "no complete frame was sent"


def test_decoder_memory_is_bounded_without_a_zero() -> None:
    decoder = Decoder()
    for _ in range(1000):
        decoder.feed(b"\x55" * 1000)
    assert len(decoder._pending) <= MAX_ENCODED_BYTES
    tail = b"\0" + b"".join(_encode_frames(2))
    assert len(decoder.feed(tail)) == 2


@settings(max_examples=100)
@given(
    rows=st.integers(1, 16),
    cols=st.integers(1, 16),
    oversampling=st.integers(1, 64),
    loads=st.booleans(),
    pressure=st.none() | st.integers(0, 50_000),
    seed=st.integers(0, 2**32 - 1),
)
def test_frame_messages_roundtrip_through_encoder_and_decoder(
    rows: int, cols: int, oversampling: int, loads: bool, pressure: int | None, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    kpa = None if pressure is None else pressure / 1e3
    cells = (CellSample(raw=-8388608, sample=0), CellSample(raw=8388607, sample=255))
    frame = FrameMessage(
        sequence=seed,
        time_us=2**32 - 1 - seed,
        stream=int(rng.integers(1, 256)),
        oversampling=oversampling,
        status=int(rng.integers(0, 64)),
        counts=rng.integers(0, 1023 * oversampling, (rows, cols), endpoint=True).astype(np.uint16),
        load_cells=cells if loads else (),
        pressure_set_kpa=kpa,
        pressure_kpa=kpa,
    )
    (got,) = Decoder().feed(encode_message(frame))
    assert isinstance(got, FrameMessage)
    assert np.array_equal(got.counts, frame.counts)
    for name in ("sequence", "time_us", "stream", "oversampling", "status", "load_cells"):
        assert getattr(got, name) == getattr(frame, name)
    assert (got.pressure_set_kpa, got.pressure_kpa) == (kpa, kpa)
