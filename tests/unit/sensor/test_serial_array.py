"""`SerialArray` over real pseudo-terminals, with a simulated board on the same manual clock."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from tests.pty_port import PtyPort

from palpate.clock import ManualClock
from palpate.errors import DeviceError, DeviceNotFoundError, DeviceTimeoutError, WireError
from palpate.sensor.array import RIGID_LAYOUT, SOFT_LAYOUT, LinkCounters
from palpate.sensor.board_link import LISTEN_S, RESTART_S, BoardLink
from palpate.sensor.byte_stream import SerialStream
from palpate.sensor.ports import Port, find_port
from palpate.sensor.serial_array import SerialArray
from palpate.sensor.wire import unpack
from palpate.sensor.wire_messages import (
    Ack,
    BoardIdentity,
    FrameMessage,
    Identify,
    Ping,
    Result,
    SetCeiling,
    SetLayout,
    SetOversampling,
    SetPressure,
    SetRate,
    Start,
    Stop,
)
from palpate_studies.board_bytes import encode_message

PERIOD_US = 4000


class PtyBoard(PtyPort):
    """A board at the other end of a pseudo-terminal; it runs in calls of `advance`."""

    drift_ppm, first_us, first_sequence = 0.0, 0, 0
    silent, commands_to_ignore = False, 0
    resets_at_command: int | None = None
    highest_rate_hz, protocol, full_scale = 600.0, 1, 1024
    rows, cols, stream, sent = 1, 1, 0, 0
    started_us: int | None = None
    _pending, _expected = b"", 0

    def __init__(self, now_s: float = 0.0, **state: float) -> None:
        self.booted_s, self.seen = now_s, list[int]()
        vars(self).update(state)
        super().__init__()

    def reset(self, now_s: float) -> None:
        self.booted_s, self.started_us, self.first_us, self.stream = now_s, None, 0, self.stream + 7
        self.send(b"\0" + encode_message(self.identity(tag=0)))

    def expect(self, count: int) -> None:
        """Expect `count` bytes from the host, which the kernel can deliver later."""
        self._expected += count

    def device_us(self, now_s: float) -> int:
        return self.first_us + round((now_s - self.booted_s) * 1e6 / (1 + self.drift_ppm * 1e-6))

    def advance(self, now_s: float) -> None:
        if self.master < 0 or self.silent:
            return
        while self._expected:
            try:
                data = os.read(self.master, 4096)
            except BlockingIOError:
                os.sched_yield()
                continue
            self._expected -= len(data)
            *packets, self._pending = (self._pending + data).split(b"\0")
            for packet in packets:
                self.handle_packet(packet, now_s)
        while self.started_us is not None and self.next_us() <= self.device_us(now_s):
            self.send(encode_message(self.frame()))
            self.sent += 1

    def next_us(self) -> int:
        return self.started_us + self.sent * PERIOD_US

    def frame(self) -> FrameMessage:
        sequence = self.first_sequence + self.sent
        counts = np.full((self.rows, self.cols), sequence % 1000, dtype=np.uint16)
        place = {"sequence": sequence, "time_us": self.next_us(), "stream": self.stream}
        return FrameMessage(**place, oversampling=1, status=0, counts=counts)

    def handle_packet(self, packet: bytes, now_s: float) -> None:
        if self.commands_to_ignore:
            self.commands_to_ignore -= 1
            return
        unpacked = unpack(packet)
        kind, (tag, *rest) = unpacked[0], unpacked[1]
        self.seen.append(kind)
        if len(self.seen) == self.resets_at_command:
            self.rows = self.cols = 1
            self.reset(now_s)
            return
        result = Result.OK
        if kind == Identify.kind:
            self.send(encode_message(self.identity(tag=tag)))
            return
        if kind == SetLayout.kind:
            self.rows, self.cols = rest[:2]
        if kind == SetRate.kind:
            (rate_mhz,) = struct.unpack("<I", bytes(rest))
            result = Result.TOO_FAST if rate_mhz > self.highest_rate_hz * 1e3 else Result.OK
        if kind == Start.kind:
            self.stream = self.stream % 255 + 1
            self.started_us, self.sent = self.device_us(now_s), 0
        if kind == Stop.kind:
            self.started_us = None
        ack = Ack(command=kind, tag=tag, result=result, highest_rate_hz=self.highest_rate_hz)
        self.send(encode_message(ack))

    def identity(self, *, tag: int) -> BoardIdentity:
        return BoardIdentity(
            tag=tag, protocol=self.protocol, version=(1, 0, 0), features=3, rows=self.rows,
            cols=self.cols, oversampling=1, max_rows=16, max_cols=16, max_oversampling=64,
            settle_us=20,
            heartbeat_ms=500, reset_cause=1, streaming=self.started_us is not None,
            conversion_us=104, baud=1_000_000, rate_hz=250.0,
            highest_rate_hz=self.highest_rate_hz, board="pty",
            full_scale=self.full_scale,
        )  # fmt: skip


class Bench(ManualClock):
    """A clock that runs the boards and opens their ports."""

    def __init__(self) -> None:
        super().__init__(100.0)
        self.boards: list[PtyBoard] = []
        self.streams: list[WatchedStream] = []

    def board(self, **state: float) -> PtyBoard:
        """Plug in a board; `state` sets its attributes."""
        self.boards.append(PtyBoard(self.now_s(), **state))
        return self.boards[-1]

    def sleep_s(self, duration_s: float) -> None:
        super().sleep_s(duration_s)
        for board in self.boards:
            board.advance(self.now_s())

    def open(self, port: str) -> SerialStream:
        (board,) = (board for board in self.boards if board.port == port)
        self.streams.append(WatchedStream(port))
        self.streams[-1].report = board.expect
        return self.streams[-1]


class WatchedStream(SerialStream):
    """The real stream, which also reports the number of written bytes to the board."""

    report: Callable[[int], None]

    def write(self, data: bytes) -> None:
        super().write(data)
        self.report(len(data))


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    for stream in bench.streams:
        stream.close()
    for board in bench.boards:
        if board.master >= 0:
            board.unplug()


def connect(bench: Bench, board: PtyBoard) -> SerialArray:
    def reopen() -> SerialStream:
        if board.master < 0:
            raise DeviceNotFoundError("still unplugged")
        return bench.open(board.port)

    return SerialArray(bench.open(board.port), clock=bench, layout=RIGID_LAYOUT, reopen=reopen)


def sequences(array: SerialArray, count: int = 10**9, *, timeout_s: float = 0.1) -> list[int]:
    """Return the numbers of the next frames; read without a count until an error is raised."""
    return [array.read(timeout_s=timeout_s).sequence for _ in range(count)]


def test_serial_array_returns_all_frames_in_order(bench: Bench) -> None:
    array = connect(bench, bench.board())
    frames = [array.read(timeout_s=0.1) for _ in range(500)]
    assert [frame.sequence for frame in frames] == list(range(500))
    assert [int(frame.counts[3, 1]) for frame in frames] == list(range(500))
    assert np.diff([frame.time_s for frame in frames]) == pytest.approx(0.004, abs=1e-3)
    assert array.counters == LinkCounters(frames=500, drift_ppm=array.counters.drift_ppm)
    array.close()
    array.close()


@pytest.mark.parametrize(("protocol", "full_scale", "bits"), [(1, 4096, 10), (2, 4096, 12)])
def test_serial_array_layout_uses_the_full_scale_of_the_board(
    bench: Bench, protocol: int, full_scale: int, bits: int
) -> None:
    array = connect(bench, bench.board(protocol=protocol, full_scale=full_scale))
    assert array.layout.divider.adc_bits == bits, "version 1 has no full scale"


def test_serial_array_sends_the_setup_commands_in_order(bench: Bench) -> None:
    board = bench.board()
    array = connect(bench, board)
    setup = (Stop, SetLayout, SetOversampling, SetRate, Identify, SetCeiling, Start)
    assert board.seen == [one.kind for one in setup]
    assert array.identity.board == "pty"
    array.send(SetPressure(target_kpa=10.0, slew_kpa_per_s=20.0))
    bench.sleep_s(0.001)
    assert board.seen[-1] == SetPressure.kind


def test_serial_array_restarts_the_setup_after_a_reset_during_setup(bench: Bench) -> None:
    board = bench.board(resets_at_command=4)
    array = connect(bench, board)
    assert sequences(array, 50) == list(range(50))
    assert board.seen.count(Start.kind) == 1
    assert array.counters.restarts == 0


def test_serial_array_resends_lost_commands(bench: Bench) -> None:
    array = connect(bench, bench.board(commands_to_ignore=3))
    assert sequences(array, 1) == [0]
    assert bench.now_s() == pytest.approx(100.9 + LISTEN_S, abs=0.05)


def test_board_link_sends_nothing_before_the_first_packet_of_the_board(bench: Bench) -> None:
    """A byte in the first second would keep the board in its bootloader."""
    board = bench.board()
    link = BoardLink(bench.open(board.port), clock=bench)
    link.start_commands([Identify()])
    while bench.now_s() < 101.2:
        bench.sleep_s(0.01)
        link.poll()
    assert board.seen == []
    board.reset(bench.now_s())
    link.poll()
    link.poll()
    bench.sleep_s(0.01)
    assert board.seen == [Identify.kind]
    while link.is_busy:
        bench.sleep_s(0.01)
        link.poll()
    assert bench.now_s() < 101.3


def test_serial_array_does_not_ping_a_silent_board(bench: Bench) -> None:
    board = bench.board()
    array = connect(bench, board)
    array.read(timeout_s=0.1)
    array.send(Ping())
    bench.sleep_s(0.01)
    assert board.seen[-1] == Ping.kind
    board.started_us = None
    count, until_s = len(board.seen), bench.now_s() + RESTART_S
    while bench.now_s() < until_s:
        bench.sleep_s(0.05)
        array.read_newest()
        array.send(Ping())
        # Pings are still allowed shortly after the last frame.
        if bench.now_s() < until_s - RESTART_S + 0.11:
            count = len(board.seen)
    assert len(board.seen) == count
    assert array.read(timeout_s=1.0).sequence > 0


def test_serial_array_counts_late_and_lost_frames_after_a_host_stall(bench: Bench) -> None:
    board = bench.board()
    array = connect(bench, board)
    sequences(array, 50)
    bench.sleep_s(5.0)
    frames = [array.read(timeout_s=0.1)]
    while frames[-1].sequence < board.sent - 1:
        frames.append(array.read(timeout_s=0.1))
    counters = array.counters
    assert counters.lost == board.sent - counters.frames
    assert 1100 < counters.lost < 1250
    assert counters.late > 80
    assert array.read(timeout_s=0.1).time_s == pytest.approx(bench.now_s(), abs=0.01)
    assert array.counters.late == counters.late


def test_serial_array_continues_after_the_board_is_replugged(bench: Bench) -> None:
    board = bench.board()
    array = connect(bench, board)
    before = [array.read(timeout_s=0.1) for _ in range(20)]
    board.unplug()
    with pytest.raises(DeviceTimeoutError, match=r"is unplugged .*Plug it in again"):
        sequences(array)
    with pytest.raises(DeviceError, match="is unplugged"):
        array.send(SetPressure(target_kpa=0.0, slew_kpa_per_s=20.0))
    board.plug()
    board.reset(bench.now_s())
    after = [array.read(timeout_s=LISTEN_S + 1.0) for _ in range(20)]
    assert after[0].sequence > before[-1].sequence
    assert np.diff([frame.sequence for frame in after]).tolist() == [1] * 19
    assert after[0].time_s == pytest.approx(bench.now_s(), abs=0.1)
    assert (array.counters.reconnects, array.counters.restarts) == (1, 1)


def test_serial_array_without_reopen_raises_after_a_disconnection(bench: Bench) -> None:
    board = bench.board()
    array = SerialArray(bench.open(board.port), clock=bench, layout=RIGID_LAYOUT)
    array.read(timeout_s=0.1)
    board.unplug()
    with pytest.raises(DeviceError, match="is gone: the cable was pulled"):
        sequences(array)


def test_serial_array_sets_up_a_reset_board_again(bench: Bench) -> None:
    board = bench.board(drift_ppm=100.0)
    array = connect(bench, board)
    frames = [array.read(timeout_s=0.1) for _ in range(100)]
    board.reset(bench.now_s())
    frames += [array.read(timeout_s=0.5) for _ in range(100)]
    assert np.all(np.diff([frame.sequence for frame in frames]) > 0)
    assert np.all(np.diff([frame.time_s for frame in frames]) >= 0)
    assert frames[-1].time_s == pytest.approx(bench.now_s(), abs=0.01)
    assert array.counters.restarts == 1


def test_serial_array_recovers_from_a_reset_without_identity_packet(bench: Bench) -> None:
    board = bench.board()
    array = connect(bench, board)
    array.read(timeout_s=0.1)
    board.started_us = None
    assert array.read(timeout_s=RESTART_S + 1.0).sequence > 0
    assert array.counters.restarts == 1


def test_serial_array_error_distinguishes_a_wrong_baud_rate_from_silence(bench: Bench) -> None:
    board = bench.board(silent=True)
    stream = bench.open(board.port)
    with pytest.raises(DeviceTimeoutError, match=r"no answer from the board in 4 s"):
        SerialArray(stream, clock=bench, layout=RIGID_LAYOUT)
    stream = bench.open(board.port)
    board.send(np.random.default_rng(0).bytes(1500))
    with pytest.raises(WireError, match=r"1500 bytes but no valid packet .* baud rate differs"):
        SerialArray(stream, clock=bench, layout=SOFT_LAYOUT)


def test_serial_stream_without_permission_raises_with_the_required_group(bench: Bench) -> None:
    port = bench.board().port
    os.chmod(port, 0o600 if os.getuid() == 0 else 0)
    was = os.geteuid()
    if was == 0:
        os.seteuid(65534)
    try:
        with pytest.raises(DeviceError, match=r"permission denied\. Run `sudo usermod -aG \w+"):
            SerialStream(port)
    finally:
        os.seteuid(was)


def test_find_port_uses_the_usb_id_or_finds_the_board_that_answers(bench: Bench) -> None:
    ports = [
        Port(device="/dev/ttyS0", description="built in"),
        Port(device="/dev/ttyACM0", description="Mega", board="Arduino"),
    ]
    assert find_port(ports, clock=ManualClock()) == "/dev/ttyACM0"
    mute, board = bench.board(silent=True), bench.board()
    ports = [Port(device=each.port, description="") for each in (mute, board)]
    assert find_port(ports, clock=bench, open_stream=bench.open) == board.port


def test_find_port_with_two_boards_raises(bench: Bench) -> None:
    ports = [Port(device=bench.board().port, description="", board="Arduino") for _ in range(2)]
    with pytest.raises(DeviceError, match=r"2 boards answer: .*; choose one with --port"):
        find_port(ports, clock=bench, open_stream=bench.open)


def test_find_port_without_a_board_raises_with_the_tried_ports(bench: Bench) -> None:
    with pytest.raises(DeviceNotFoundError, match="no serial port"):
        find_port([], clock=bench, open_stream=bench.open)
    mute = bench.board(silent=True)
    with pytest.raises(DeviceNotFoundError, match=r"no board answers: /dev/pts/.* no answer"):
        find_port([Port(device=mute.port, description="")], clock=bench, open_stream=bench.open)
