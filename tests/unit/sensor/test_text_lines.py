"""Boards that print numbers, over a real pseudo-terminal with a manual clock."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.other_boards import (
    PADS,
    SendingBoard,
    SendingClock,
    block_of,
    heard_at,
    line_of,
    ohm_line_of,
)

from palpate.errors import DeviceError, DeviceTimeoutError, InputError, WireError
from palpate.sensor.array import ArrayLayout
from palpate.sensor.one_way_array import OneWayArray
from palpate.sensor.pixel_resistance import pixel_resistance_ohm
from palpate.sensor.text_lines import LineDecoder, open_board
from palpate.signal.circuit import Divider

IN_OHM = replace(PADS, divider=Divider(adc_bits=24))
PAIR = ArrayLayout(name="pair", rows=1, cols=2, finger_of_row=(0,))


@pytest.fixture
def clock() -> Iterator[SendingClock]:
    clock = SendingClock()
    yield clock
    clock.close()


def read_forever(array: OneWayArray) -> None:
    """Read frames until an error is raised."""
    while True:
        array.read(timeout_s=0.5)


@pytest.mark.parametrize("encode", [line_of, block_of])
def test_line_decoder_converts_lines_of_counts_to_frames(
    clock: SendingClock, encode: Callable[[NDArray[np.int32]], bytes]
) -> None:
    board = SendingBoard(clock, layout=PADS, encode=encode)
    array = board.array(LineDecoder(PADS))
    frames = [array.read(timeout_s=0.1) for _ in range(200)]
    assert [frame.sequence for frame in frames] == list(range(200))
    assert np.diff([frame.time_s for frame in frames]) == pytest.approx(0.01, abs=1.1e-3)
    expected = board.layout.divider.full_scale * 4700 / (4700 + 1 / board.sheet.conductance_s(0.0))
    assert frames[0].counts == pytest.approx(expected, abs=3)
    counters = array.counters
    assert (counters.frames, counters.lost, counters.corrupt, counters.late) == (200, 0, 0, 0)


def test_line_decoder_reads_resistances_from_selected_columns(clock: SendingClock) -> None:
    board = SendingBoard(clock, layout=PADS, encode=ohm_line_of(PADS.divider))
    decoder = LineDecoder(IN_OHM, columns=list(range(2, 10)), in_ohm=True)
    array = board.array(decoder)
    ohm = pixel_resistance_ohm(array.read(timeout_s=0.1).counts, layout=IN_OHM)
    printed = [float(part) for part in board.encode(board.counts(clock.now_s())).split(b";")[1:]]
    assert ohm.ravel() == pytest.approx(printed, rel=0.01)


@pytest.mark.parametrize(
    ("text", "counts"),
    [
        ("1 2", [1, 2]),
        ("1\t2\t", [1, 2]),
        ("A0:1 A1:2", [1, 2]),
        ("left = 1; right = 2", [1, 2]),
        ("[1, 2]", [1, 2]),
        ("1.0,2.4", [1, 2]),
    ],
)
def test_line_decoder_reads_common_line_formats(text: str, counts: list[int]) -> None:
    (frame,) = LineDecoder(PAIR).feed(f"\n{text}\r\n".encode())
    assert frame.tolist() == [counts]


@pytest.mark.parametrize("text", ["inf,3", "ovf,3", "1e12,3"])
def test_line_decoder_reads_an_open_pixel_as_infinite(text: str) -> None:
    pair = replace(PAIR, divider=IN_OHM.divider)
    (frame,) = LineDecoder(pair, in_ohm=True).feed(f"\n{text}\n".encode())
    ohm = pixel_resistance_ohm(frame, layout=pair)
    assert np.isinf(ohm[0, 0])
    assert ohm[0, 1] == pytest.approx(3.0, rel=1e-3)


@pytest.mark.parametrize(
    ("damage", "rejected"),
    [
        (lambda data: b"", 0),  # the complete line is lost
        (lambda data: data[: len(data) // 2], 2),  # its end is lost: it merges with the next line
        (lambda data: data.replace(b"\r\n", b""), 2),
        (lambda data: data.replace(b",", b"", 1), 1),
        (lambda data: b"\xf8\x80\xfe" + data, 1),
        (lambda data: b"-" + data, 1),
        (lambda data: b"9" + data, 1),  # out of range
    ],
)
def test_line_decoder_lost_or_damaged_line_is_counted(
    clock: SendingClock, damage: Callable[[bytes], bytes], rejected: int
) -> None:
    board = SendingBoard(clock, layout=PADS, encode=line_of)
    # Numbered from the first complete line, which is the board's second line.
    torn = {100, 200, 201}
    board.spoil = lambda number, data: damage(data) if number - 1 in torn else data
    array = board.array(LineDecoder(PADS))
    frames = [array.read(timeout_s=0.1) for _ in range(250)]
    missing = set(range(frames[-1].sequence)) - {frame.sequence for frame in frames}
    # A line without its end also spoils the next line. A loss is counted up to ten frames later.
    assert len(missing) == array.counters.lost
    assert len(torn) <= len(missing) <= len(torn) + 2 * (rejected == 2)
    assert all(min(abs(number - gone) for gone in torn) <= 10 for number in missing)
    assert (array.counters.corrupt > 0) == bool(rejected)


def test_one_way_array_counts_no_loss_for_frames_that_arrive_together(clock: SendingClock) -> None:
    board = SendingBoard(clock, layout=PADS, encode=line_of)
    array = board.array(LineDecoder(PADS))
    times = []
    for _ in range(40):
        clock.sleep_s(0.05)  # the program is busy, and five frames accumulate
        times += [array.read(timeout_s=0.1).time_s for _ in range(5)]
    assert array.counters.lost == 0
    assert np.diff(times)[10:].min() > 0
    assert np.diff(times)[10:] == pytest.approx(0.01, abs=0.0101)


def test_one_way_array_counts_no_loss_for_delayed_frames(clock: SendingClock) -> None:
    board = SendingBoard(clock, layout=PADS, encode=line_of)
    array = board.array(LineDecoder(PADS))
    for _ in range(100):
        array.read(timeout_s=0.1)
    board.due_s += 0.06
    behind_s, board.period_s = 0.06, 0.002  # six frames in the time of one
    while behind_s > 0:
        behind_s -= 0.008
        array.read(timeout_s=0.1)
    board.period_s = 0.01
    for _ in range(50):
        array.read(timeout_s=0.1)
    assert array.counters.lost == 0


def test_one_way_array_counts_late_frames(clock: SendingClock) -> None:
    board = SendingBoard(clock, layout=PADS, encode=line_of)
    array = board.array(LineDecoder(PADS))
    for _ in range(50):
        array.read(timeout_s=0.1)
    clock.sleep_s(0.3)
    for _ in range(30):
        array.read(timeout_s=0.1)
    assert array.counters.late == pytest.approx(20, abs=2)


@pytest.mark.parametrize(
    ("sent_baud", "read_baud"), [(9600, 115200), (115200, 9600), (57600, 115200)]
)
def test_line_decoder_at_wrong_baud_rate_raises_an_error_that_names_baud(
    clock: SendingClock, sent_baud: int, read_baud: int
) -> None:
    board = SendingBoard(clock, layout=PADS, encode=line_of)
    lines = line_of(board.counts(clock.now_s())) * 3
    garbage = heard_at(lines, sent_baud=sent_baud, read_baud=read_baud)
    board.spoil = lambda *_: garbage
    with pytest.raises(WireError, match=r"bytes but no frame of 4 x 2 .*baud") as caught:
        board.array(LineDecoder(PADS))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("layout", "words"),
    [
        (replace(PADS, rows=3, finger_of_row=(0,) * 3), r"has 8 numbers.* needs 6"),
        (replace(PADS, divider=Divider(adc_bits=6)), "is outside 0 to 63, the range of 6 bits"),
    ],
)
def test_line_decoder_with_wrong_layout_raises_with_the_fault(
    clock: SendingClock, layout: ArrayLayout, words: str
) -> None:
    board = SendingBoard(clock, layout=PADS, encode=line_of)
    with pytest.raises(WireError, match=words):
        board.array(LineDecoder(layout))


def test_line_decoder_rows_without_blank_lines_raise(clock: SendingClock) -> None:
    board = SendingBoard(clock, layout=PADS, encode=lambda c: block_of(c)[:-1])
    with pytest.raises(WireError, match="no blank line marks the start of a frame"):
        board.array(LineDecoder(PADS))


def test_one_way_array_error_distinguishes_silence_from_a_disconnection(
    clock: SendingClock,
) -> None:
    board = SendingBoard(clock, layout=PADS, encode=line_of)
    array = board.array(LineDecoder(PADS))
    for _ in range(20):
        array.read(timeout_s=0.1)
    board.silent = True
    with pytest.raises(DeviceTimeoutError, match=r"no data in 0.5 s. Check the board.s power"):
        read_forever(array)
    board.silent = False
    board.unplug()
    with pytest.raises(DeviceTimeoutError, match=r"is unplugged \(0.5 s .* Plug it in again"):
        read_forever(array)
    last = board.sent
    board.plug()
    frame = array.read(timeout_s=0.5)
    assert array.counters.reconnects == 1
    assert board.sent - last < 50
    assert frame.time_s == pytest.approx(clock.now_s(), abs=0.02)
    array.close()
    array.close()
    with pytest.raises(DeviceError, match="was closed"):
        array.read(timeout_s=0.1)


def test_open_board_with_invalid_options_raises_before_opening_the_port() -> None:
    with pytest.raises(InputError, match="8 different positive integers"):
        open_board(port="/dev/none", layout="4x2", columns=[1, 2, 2])
    with pytest.raises(InputError, match="needs counts"):
        open_board(port="/dev/none", layout="4x2", unit="ohm", idle_lines="held")
    with pytest.raises(InputError, match="1 to 24 bits"):
        open_board(port="/dev/none", layout="4x2", adc_bits=40)
    with pytest.raises(InputError, match="from 1x1 to 64x64"):
        open_board(port="/dev/none", layout="4x65")
