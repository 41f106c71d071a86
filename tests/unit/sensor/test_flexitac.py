"""FlexiTac's frames over a real pseudo-terminal, with a manual clock."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from tests.other_boards import FLEXITAC, SendingBoard, SendingClock, heard_at, marked

from palpate.errors import DeviceNotFoundError, InputError, WireError
from palpate.sensor.flexitac import FlexitacDecoder, open_board


@pytest.fixture
def clock() -> Iterator[SendingClock]:
    clock = SendingClock()
    yield clock
    clock.close()


@pytest.fixture
def board(clock: SendingClock) -> SendingBoard:
    return SendingBoard(clock, layout=FLEXITAC, encode=marked)


def test_flexitac_frame_counts_equal_the_sent_bytes(board: SendingBoard) -> None:
    sent = []
    board.spoil = lambda _, data: sent.append(data) or data
    array = board.array(FlexitacDecoder(rows=12))
    frames = [array.read(timeout_s=0.1) for _ in range(100)]
    assert [frame.counts.astype(np.uint8).tobytes() for frame in frames] == [
        data[2:] for data in sent[:100]
    ]
    counters = array.counters
    assert (counters.frames, counters.lost, counters.corrupt) == (100, 0, 0)


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


@pytest.mark.parametrize(
    ("rows", "garbage"), [(16, False), (12, True)], ids=["other rows", "other baud rate"]
)
def test_flexitac_frames_of_wrong_size_raise_an_error_that_names_rows_and_baud(
    board: SendingBoard, rows: int, garbage: bool
) -> None:
    if garbage:
        received = heard_at(marked(board.counts(0.0)), sent_baud=2_000_000, read_baud=115200)
        board.spoil = lambda *_: received
    with pytest.raises(WireError, match=r"no frame of .* no marker .*check rows and baud"):
        board.array(FlexitacDecoder(rows=rows))


def test_open_flexitac_board_with_invalid_options_raises(board: SendingBoard) -> None:
    with pytest.raises(InputError, match="sends 1 to 16"):
        open_board(port=board.port, rows=17)
    with pytest.raises(InputError, match="above 0 ohm"):
        open_board(port=board.port, reference_ohm=0.0)
    with pytest.raises(DeviceNotFoundError, match="no port"):
        open_board(port="/dev/ttyUSB99")
