"""FlexiTac's frames over a real pseudo-terminal, with a manual clock."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from tests.other_boards import FLEXITAC, SendingBoard, SendingClock, heard_at, marked

from palpate.errors import WireError
from palpate.sensor.flexitac import FlexitacDecoder


@pytest.fixture
def clock() -> Iterator[SendingClock]:
    clock = SendingClock()
    yield clock
    clock.close()


@pytest.fixture
def board(clock: SendingClock) -> SendingBoard:
    return SendingBoard(clock, layout=FLEXITAC, encode=marked)


def test_flexitac_marker_bytes_inside_a_frame_do_not_start_a_frame(board: SendingBoard) -> None:
    board.spoil = lambda _, data: data[:100] + b"\xaa\x55" + data[102:]
    array = board.array(FlexitacDecoder(rows=12))
    for _ in range(100):
        assert array.read(timeout_s=0.1).counts.ravel()[98:100].tolist() == [0xAA, 0x55]
    assert (array.counters.lost, array.counters.corrupt) == (0, 0)


@pytest.mark.parametrize(
    ("damage", "rejected", "lost"),
    [
        (lambda data: b"", 0, 1),
        (lambda data: data[:200], 1, 1),
        (lambda data: data[:50] + data[51:], 1, 1),
        (lambda data: data + b"\xaa", 1, 1),
        # The end of one frame and the beginning of the next.
        (lambda data: b"\x00" + data[1:], 1, 2),
        (lambda data: b"\xaa\x55" + data, 1, 0),
    ],
)
def test_flexitac_lost_or_damaged_frame_is_counted(
    board: SendingBoard, damage: Callable[[bytes], bytes], rejected: int, lost: int
) -> None:
    board.spoil = lambda number, data: damage(data) if number in (80, 120) else data
    array = board.array(FlexitacDecoder(rows=12))
    frames = [array.read(timeout_s=0.1) for _ in range(170)]
    missing = set(range(frames[-1].sequence)) - {frame.sequence for frame in frames}
    assert len(missing) == array.counters.lost == 2 * lost
    assert array.counters.corrupt == 2 * rejected


def frames_of(rows: int, cols: int, *, count: int = 20) -> list[bytes]:
    """Return frames of changing pixels, as a board sends them."""
    rng = np.random.default_rng(rows)
    return [
        b"\xaa\x55" + rng.integers(0, 160, rows * cols, np.uint8).tobytes() for _ in range(count)
    ]


def feed_in_chunks(decoder: FlexitacDecoder, data: bytes) -> list[list[list[int]]]:
    rng, found = np.random.default_rng(3), []
    while data:
        size = int(rng.integers(1, 300))
        found += [frame.tolist() for frame in decoder.feed(data[:size])]
        data = data[size:]
    return found


@pytest.mark.parametrize(("rows", "cols"), [(16, 16), (12, 32), (16, 32), (32, 32), (5, 7)])
def test_flexitac_frames_of_another_size_are_read_or_named(rows: int, cols: int) -> None:
    sent = frames_of(rows, cols)
    stream = b"".join(sent)[100:]
    read = feed_in_chunks(FlexitacDecoder(rows=rows, cols=cols), stream)
    assert read == [
        np.frombuffer(data[2:], np.uint8).reshape(rows, cols).tolist()
        for data in sent[100 // len(sent[0]) + 1 : -1]
    ]
    wrong = FlexitacDecoder(rows=10, cols=30)
    assert not feed_in_chunks(wrong, stream)
    size = f"every {rows * cols + 2} bytes: set rows"
    known = f"{size} = {rows}, cols = {cols}" if cols > 7 else f"{size} and cols to a matrix of 35"
    assert known in wrong.fault


def test_flexitac_steady_pixels_with_a_marker_do_not_shift_the_frame() -> None:
    """Without a change of these pixels it is uncertain where a frame starts."""
    sent = [data[:52] + b"\xaa\x55" + data[54:] for data in frames_of(12, 32, count=30)]
    decoder = FlexitacDecoder(rows=12)
    assert not feed_in_chunks(decoder, b"".join(sent)[30:])
    assert "press one of these pixels" in decoder.fault
    changed = frames_of(12, 32, count=3)
    read = feed_in_chunks(decoder, b"".join(changed + sent))
    assert read[-1] == np.frombuffer(sent[-2][2:], np.uint8).reshape(12, 32).tolist()
    assert len(read) == pytest.approx(32, abs=3)
    assert not decoder.fault


@pytest.mark.parametrize(
    ("received", "words"),
    [
        (
            heard_at(marked(np.arange(384)) * 2, sent_baud=2_000_000, read_baud=115200) * 30,
            "no marker every 386 bytes; check rows, cols and baud",
        ),
        (
            b"ms=12 mux=4 col=0 raw10_mean=512.00 min=510 raw8=128\r\n" * 30,
            "sends text .*text_lines:",
        ),
    ],
    ids=["other baud rate", "text"],
)
def test_flexitac_error_names_why_there_is_no_frame(
    board: SendingBoard, received: bytes, words: str
) -> None:
    board.spoil = lambda *_: received[:1500]
    with pytest.raises(WireError, match=rf"no frame of 12 x 32 .*{words}") as caught:
        board.array(FlexitacDecoder(rows=12))
    assert "\n" not in str(caught.value)
