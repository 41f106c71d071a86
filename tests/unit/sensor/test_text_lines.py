"""Boards that print numbers, over a real pseudo-terminal with a manual clock."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

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
from palpate.sensor.array import ArrayLayout, Frame
from palpate.sensor.one_way_array import OneWayArray
from palpate.sensor.sample import pixel_resistance_ohm
from palpate.sensor.text_lines import LineDecoder, open_board
from palpate.signal.circuit import Divider

IN_OHM = replace(PADS, divider=Divider(adc_bits=24))
PAIR = ArrayLayout(name="pair", rows=1, cols=2, finger_of_row=(0,))


@pytest.fixture
def clock() -> Iterator[SendingClock]:
    clock = SendingClock()
    yield clock
    clock.close()


@pytest.fixture
def board(clock: SendingClock) -> SendingBoard:
    return SendingBoard(clock, layout=PADS, encode=line_of)


def read_many(array: OneWayArray, count: int = 10**9, *, timeout_s: float = 0.1) -> list[Frame]:
    return [array.read(timeout_s=timeout_s) for _ in range(count)]


@pytest.mark.parametrize("encode", [line_of, block_of])
def test_line_decoder_converts_lines_of_counts_to_frames(
    clock: SendingClock, encode: Callable[[NDArray[np.int32]], bytes]
) -> None:
    board = SendingBoard(clock, layout=PADS, encode=encode)
    array = board.array(LineDecoder(PADS))
    frames = read_many(array, 200)
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
        ("0x1,0x02", [1, 2]),
        ("FSR 1 (GPIO36): 1 | FSR 2 (GPIO39): 2", [1, 2]),
        ("(0,0): 1, (0,1): 2", [1, 2]),
        ("left finger = 1, right finger = 2", [1, 2]),
        ("2024-05-01 12:34:56.789 -> 1 2", [1, 2]),
        ("\x1b[0;32mI (5321) fsr: 1, 2\x1b[0m", [1, 2]),
        ('{"A0":1,"A1":2}', [1, 2]),
        ('{"7":1,"8":2}', [1, 2]),
        ("{'7': 1, '8': 2}", [1, 2]),
        ('{"t":9,"id":"pad 3","p":[[1],[2]]}', [1, 2]),
        ('{"t":9,"data":{"n":2,"rows":[1,2]}}', [1, 2]),
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
    board: SendingBoard, damage: Callable[[bytes], bytes], rejected: int
) -> None:
    # Numbered from the first complete line, which is the board's second line.
    torn = {100, 200, 201}
    board.spoil = lambda number, data: damage(data) if number - 1 in torn else data
    array = board.array(LineDecoder(PADS))
    frames = read_many(array, 250)
    missing = set(range(frames[-1].sequence)) - {frame.sequence for frame in frames}
    # A line without its end also spoils the next line. A loss is counted up to ten frames later.
    assert len(missing) == array.counters.lost
    assert len(torn) <= len(missing) <= len(torn) + 2 * (rejected == 2)
    assert all(min(abs(number - gone) for gone in torn) <= 10 for number in missing)
    assert (array.counters.corrupt > 0) == bool(rejected)


def test_one_way_array_counts_no_loss_for_frames_that_arrive_together(
    clock: SendingClock, board: SendingBoard
) -> None:
    array, times = board.array(LineDecoder(PADS)), list[float]()
    for _ in range(40):
        clock.sleep_s(0.05)  # the program is busy, and five frames accumulate
        times += [frame.time_s for frame in read_many(array, 5)]
    assert array.counters.lost == 0
    assert np.diff(times)[10:].min() > 0
    assert np.diff(times)[10:] == pytest.approx(0.01, abs=0.0101)


def test_one_way_array_counts_late_frames(clock: SendingClock, board: SendingBoard) -> None:
    array = board.array(LineDecoder(PADS))
    read_many(array, 50)
    clock.sleep_s(0.3)
    read_many(array, 30)
    assert array.counters.late == pytest.approx(20, abs=2)


@pytest.mark.parametrize(
    ("sent_baud", "read_baud"), [(9600, 115200), (115200, 9600), (57600, 115200)]
)
def test_line_decoder_at_wrong_baud_rate_raises_an_error_that_names_baud(
    clock: SendingClock, board: SendingBoard, sent_baud: int, read_baud: int
) -> None:
    lines = line_of(board.counts(clock.now_s())) * 3
    garbage = heard_at(lines, sent_baud=sent_baud, read_baud=read_baud)
    board.spoil = lambda *_: garbage
    with pytest.raises(WireError, match=r"bytes but no frame of 4 x 2 .*baud") as caught:
        board.array(LineDecoder(PADS))
    assert "\n" not in str(caught.value)


def decode(
    text: str | bytes, *, layout: ArrayLayout = PADS, seed: int = 1, **options: Any
) -> tuple[list[list[float]], LineDecoder]:
    """Decode a text in chunks of random sizes, from the middle of its first line."""
    rng = np.random.default_rng(seed)
    data = (text if isinstance(text, bytes) else text.encode())[3:]
    decoder, readings = LineDecoder(layout, **options), []
    while data:
        size = int(rng.integers(1, 40))
        frames = decoder.feed(data[:size])
        readings += [(frame.ravel() / decoder.oversampling).tolist() for frame in frames]
        data = data[size:]
    return readings, decoder


def sweep(count: int) -> list[list[int]]:
    """Return different readings of eight pixels."""
    return [[(37 * k + 101 * n) % 900 + 20 for n in range(8)] for k in range(count)]


def join_rows(values: list[int], *, end: str, between: str = ",") -> str:
    rows = [between.join(map(str, values[n : n + 2])) for n in range(0, 8, 2)]
    return "".join(row + end for row in rows)


FRAMES: dict[str, Callable[[list[int]], str]] = {
    "CR": lambda v: ",".join(map(str, v)) + "\r",
    "LF CR": lambda v: ",".join(map(str, v)) + "\n\r",
    "line and blank line": lambda v: ",".join(map(str, v)) + "\r\n\r\n",
    "rows, CR": lambda v: join_rows(v, end="\r") + "\r",
    "rows, LF CR": lambda v: join_rows(v, end="\n\r") + "\n\r",
    "rows, trailing tabs": lambda v: join_rows(v, end="\t\r\n", between="\t") + "\r\n",
    "rows under a heading": lambda v: f"=== frame {v[0]} ===\n" + join_rows(v, end="\n"),
    "rows between words": lambda v: "START\n" + join_rows(v, end="\n") + "END\n",
    "numbered rows": lambda v: (
        "".join(f"{n}: {v[2 * n]} {v[2 * n + 1]}\n" for n in range(4)) + "\n"
    ),
    "a matrix of brackets": lambda v: "[[" + join_rows(v, end="]\n [") + "]\n\n",
    "a reading in a line": lambda v: "".join(f"A{n} = {x}\r\n" for n, x in enumerate(v)) + "\r\n",
}


@pytest.mark.parametrize("form", FRAMES)
def test_line_decoder_finds_all_frames_of_a_form(form: str) -> None:
    sent = sweep(30)
    readings, decoder = decode("".join(map(FRAMES[form], sent)) + "\n")
    assert readings == sent[1:]
    assert decoder.corrupt <= 1  # the first heading


@pytest.mark.parametrize(
    ("line", "options"),
    [
        (lambda k, v: f"{1000 + 20 * k},{v}", {}),
        (lambda k, v: f"{v};{1000 + 20 * k}", {}),
        (lambda k, v: f'{{"ms":{1000 + 20 * k},"n":{k},"v":[{v}]}}', {}),
        (lambda k, v: f'{{"ms":{20 * k},"a1":[{v}]}}', {"columns": list(range(2, 10))}),
        (lambda k, v: f"{20 * k} {v} {k}", {"columns": list(range(2, 10))}),
    ],
)
def test_line_decoder_ignores_a_clock(line: Callable[[int, str], str], options: Any) -> None:
    sent = sweep(40)
    text = "".join(line(k, ",".join(map(str, v))) + "\r\n" for k, v in enumerate(sent))
    readings, _ = decode(text, **options)
    assert readings == sent[-len(readings) :]
    assert len(readings) >= 30


def line(values: list[int], spell: Callable[[int], str] = str) -> str:
    return ",".join(map(spell, values)) + "\r\n"


REFUSED: list[tuple[Callable[[int, list[int]], str], str]] = [
    (lambda _, v: "\t".join(map(str, v)), r"no line end: add Serial.println\(\)"),
    (lambda k, v: "\n" * (k == 0) + "<" + line(v)[:-2] + ">", "no line end"),
    (lambda k, v: f"{k}," + line(v), r"the first is a clock, set columns = \[2, 3, .*, 9\]"),
    (lambda _, v: line(v, lambda x: f"{x / 205:.2f}"), 'set unit = "volt" and supply_v'),
    (lambda _, v: line(v, lambda x: f"{x / 1023:.4f}"), "supply_v .1 for fractions"),
    (lambda _, v: line(v, lambda x: f"{x},5"), "instead of decimal commas"),
    (lambda _, v: line(v, lambda x: f"{x}mV"), 'has "mV" after a number'),
    (lambda _, v: line(v, lambda x: f"{x:02X}"), "is hexadecimal; print decimal"),
    (lambda _, v: line(v, lambda x: str(x - 400)), "negative number; print readings"),
    (lambda _, v: "nan," + line(v[1:]), "nan as reading 1: the sketch divides by 0"),
    (lambda _, v: '{"p":[null,' + line(v[1:])[:-2] + "]}\n", "nan as reading 1"),
    (lambda _, v: line(v, lambda x: str(4 * x + 400)), "set adc_bits = 12"),
    (lambda _, v: line(v, lambda x: str(40 * x + 20000)), "set adc_bits = 16"),
    (lambda _, v: line([*v[::-1], 7]), "has 9 numbers, but layout 4x2 needs 8"),
    (lambda _, v: line(v)[:-2] + "*5F\n", r'not a line of numbers \("\d+\*5F"\)'),
    (lambda _, v: join_rows(v, end="\r\n"), "no blank line marks the start of a frame"),
    (lambda _, v: 2 * join_rows(v, end="\r\n") + "\r\n", "no blank line|ends a frame of"),
    (lambda _, v: "Calibrating ...\r\n", "has no numbers; .* set wait_s"),
    (lambda _, v: ".", "has no numbers; .* set wait_s"),
    (lambda k, v: line(v) if k == 0 else "", "if the sketch prints rarely, set wait_s"),
    (
        lambda _, v: line([*v, *v]).replace(",", "\t"),
        "has 16 numbers, .*; check layout and columns$",
    ),
    (lambda _, v: line([x + 256 for x in v], lambda x: f"{x:b}"), "without BIN"),
    (lambda _, v: "\xaa\x55" + "\x00\x01\n" * 50, "flexitac:open_board"),
]


@pytest.mark.parametrize(("spell", "fault"), REFUSED)
def test_line_decoder_names_the_cause_of_an_unreadable_form(
    spell: Callable[[int, list[int]], str], fault: str
) -> None:
    text = "".join(spell(k, values) for k, values in enumerate(sweep(60)))
    readings, decoder = decode(text.encode("latin-1"))
    assert not readings
    assert re.search(fault, decoder.fault)
    assert "\n" not in decoder.fault


def test_line_decoder_refuses_all_lines_of_a_wrong_form() -> None:
    """Most lines of these differences or hexadecimal numbers look like counts."""
    for wrong in ("5,-3", "1F,20"):
        text = "10,20\n" * 3 + "".join(f"{wrong}\n10,{n}\n11,{n}\n" for n in range(100))
        readings, decoder = decode(text, layout=PAIR)
        assert len(readings) <= 10
        assert decoder.fault


def test_line_decoder_reads_volts_and_mean_counts_without_rounding() -> None:
    counts = np.array([3.0, 512.25])
    fine = replace(PAIR, divider=IN_OHM.divider)
    expected = 4700.0 * (1024 / counts - 1.0)
    for supply_v in (5.0, 3.3, 1.0, 3300.0):
        text = "{:.9f},{:.9f}\n".format(*(counts / 1024 * supply_v))
        (frame, *_) = LineDecoder(fine, supply_v=supply_v).feed(f"\n{text}".encode())
        ohm = pixel_resistance_ohm(frame, layout=fine)
        assert ohm.ravel() == pytest.approx(expected, rel=1e-4)
    decoder = LineDecoder(PAIR)
    (frame,) = decoder.feed(b"\n3.00,512.25\n")
    ohm = pixel_resistance_ohm(frame, layout=PAIR, oversampling=decoder.oversampling)
    assert ohm.ravel() == pytest.approx(expected)


def test_line_decoder_ends_of_the_range_remain_open_and_short() -> None:
    for options, text, layout in (
        ({"supply_v": 5.0}, b"\n0.00,5.00\n", replace(PAIR, divider=IN_OHM.divider)),
        ({"in_counts": True}, b"\n0.00,1023.00\n", PAIR),
    ):
        decoder = LineDecoder(layout, **options)  # type: ignore[arg-type]
        (frame,) = decoder.feed(text)
        ohm = pixel_resistance_ohm(frame, layout=layout, oversampling=decoder.oversampling)
        assert ohm.ravel().tolist() == [np.inf, 0.0]


def test_line_decoder_a_volt_without_its_point_does_not_pass_as_a_count() -> None:
    readings, _ = decode("2.50,1.20\n" * 20 + "250,1.20\n" + "2.50,1.20\n" * 20, layout=PAIR)
    assert not readings
    readings, _ = decode("0.25,1.50\n" * 5, layout=PAIR, in_counts=True)
    assert readings == [[0.25, 1.5]] * 4


@pytest.mark.parametrize(
    ("text", "end"),
    [
        ("<{}>", ">"),
        ("{};", ";"),
        ("{}END", "END"),
        ('{{"p":[{}]}}', "}"),
        ("{}\0", "\0"),
        ("<{}>\r\n", ">"),
        ("{};\n", ";"),
    ],
)
def test_line_decoder_reads_frames_with_another_end(text: str, end: str) -> None:
    sent = sweep(20)
    stream = "".join(text.format(",".join(map(str, values))) for values in sent)
    readings, decoder = decode(stream, line_end=end)
    assert (readings, decoder.corrupt) == (sent[1:], 0)


def test_line_decoder_with_an_end_that_is_not_sent_names_it() -> None:
    readings, decoder = decode("".join(map(line, sweep(20))), line_end=";")
    assert not readings
    assert "has no ';'; check line_end" in decoder.fault


def test_halves_of_two_lines_around_a_disconnection_do_not_form_a_frame(
    clock: SendingClock,
) -> None:
    board = SendingBoard(clock, layout=PADS, encode=lambda _: b"1,2,3,4,5,6,7,8\n")
    array = board.array(LineDecoder(PADS))
    array.read(timeout_s=0.1)
    first, second = iter([b"99,99,99,99,"]), iter([b"5,6,7,8\n"])
    board.spoil = lambda _, data: next(first, b"")
    with pytest.raises(DeviceTimeoutError):
        array.read(timeout_s=0.05)
    board.unplug()
    with pytest.raises(DeviceTimeoutError):
        array.read(timeout_s=0.1)
    board.spoil = lambda _, data: next(second, data) if array.counters.reconnects else b""
    board.plug()
    assert array.read(timeout_s=1.0).counts.ravel().tolist() == [1, 2, 3, 4, 5, 6, 7, 8]


def test_begin_of_a_line_within_a_short_timeout_is_no_wrong_format(clock: SendingClock) -> None:
    board = SendingBoard(clock, layout=PADS, encode=lambda _: b"1,2,3,4,5,6,7,8\n")
    array = board.array(LineDecoder(PADS))
    read_many(array, 20)
    board.spoil = lambda _, data: data[:7]
    with pytest.raises(DeviceTimeoutError, match="no data in"):
        array.read(timeout_s=0.015)
    with pytest.raises(WireError, match="has no line end"):
        array.read(timeout_s=2.0)


def test_one_way_array_error_distinguishes_silence_from_a_disconnection(
    clock: SendingClock, board: SendingBoard
) -> None:
    array = board.array(LineDecoder(PADS))
    read_many(array, 20)
    board.silent = True
    with pytest.raises(DeviceTimeoutError, match=r"no data in 0.5 s. Check the board.s power"):
        read_many(array, timeout_s=0.5)
    board.silent = False
    board.unplug()
    with pytest.raises(DeviceTimeoutError, match=r"is unplugged \(0.5 s .* Plug it in again"):
        read_many(array, timeout_s=0.5)
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


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"columns": [1, 2, 2]}, "8 different positive integers"),
        ({"unit": "ohm", "idle_lines": "held"}, "needs counts"),
        ({"supply_v": 3.3}, "only for volts"),
        ({"baud": -9600}, "must be 50 to 12"),
        ({"layout": "4x65"}, "from 1x1 to 64x64"),
    ],
)
def test_open_board_with_invalid_options_raises_before_opening_the_port(
    options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        open_board(**({"port": "/dev/none", "layout": "4x2"} | options))
