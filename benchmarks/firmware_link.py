"""Losses, jitter and delay of the real firmware in long runs on the AVR simulator.

    python benchmarks/firmware_link.py --seconds 3600 --rate 250 --rows 4 --cols 2

The time is simulated; the program is the one flashed on the board. Every 200 ms a ping is sent and
all pixels get new random voltages. Every frame is compared with the voltages.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from typing import Any

import numpy as np

from palpate.firmware_image import BOARDS
from palpate.sensor.wire import Decoder, encode_command
from palpate.sensor.wire_messages import (
    Contents,
    FrameMessage,
    Ping,
    SetLayout,
    SetOversampling,
    SetRate,
    Start,
)
from palpate.twin.firmware import FirmwareBoard

_STEP_S = 0.2


def run_link(
    *,
    seconds: float,
    rate_hz: float,
    rows: int,
    cols: int,
    oversampling: int = 1,
    baud: int = 1_000_000,
    board: str = "mega2560",
    contents: Contents = Contents.PIXELS,
) -> dict[str, Any]:
    """Stream for `seconds` of simulated time; return counts and measurements."""
    machine = FirmwareBoard(board, baud=baud)
    decoder = Decoder()
    setup = (
        SetLayout(rows=rows, cols=cols),
        SetOversampling(conversions=oversampling),
        SetRate(rate_hz=rate_hz),
        Start(contents=contents),
    )
    for command in setup:
        machine.run_until(machine.now_s() + 0.1)
        machine.write_bytes(encode_command(command, tag=1))
    clock_s = _measure_clock_start_s(machine, decoder)
    began = time.perf_counter()
    start_s = machine.now_s()
    rng = np.random.default_rng(0)
    tally = _Tally(rows=rows, cols=cols, oversampling=oversampling, clock_s=clock_s)
    while machine.now_s() - start_s < seconds:
        machine.write_bytes(encode_command(Ping(), tag=2))
        wanted_mv = rng.uniform(0, 4990, size=(rows, cols))
        changed_s = machine.now_s()
        machine.set_pixels_mv(wanted_mv)
        machine.run_until(changed_s + _STEP_S)
        data, through_s = machine.read_bytes_with_times()
        # The delay is measured at the end of each packet.
        ends_s = through_s[np.frombuffer(data, np.uint8) == 0]
        messages = decoder.feed(data)
        tally.add(messages, ends_s=ends_s, wanted_mv=wanted_mv, changed_s=changed_s)
    counters = decoder.counters
    result = {
        "simulated_s": round(machine.now_s() - start_s, 3),
        "rate_hz": rate_hz,
        "pixels": rows * cols,
        "oversampling": oversampling,
        "board": board,
        "baud": baud,
        "frames": counters.frames,
        "frames_lost": counters.lost,
        "corrupt": counters.corrupt,
        "conversions_misrouted": machine.misroute_count,
        "times_real_time": round((machine.now_s() - start_s) / (time.perf_counter() - began), 2),
        **tally.summary(rate_hz=rate_hz),
    }
    machine.close()
    return result


def _measure_clock_start_s(board: FirmwareBoard, decoder: Decoder) -> float:
    """Return the start of the board's clock after power-up, from its first conversion."""
    give_up_s = board.now_s() + 0.1
    while board.conversions == 0:
        if board.now_s() > give_up_s:
            sys.exit(f"the board does not scan: {decoder.feed(board.read_bytes())}")
        board.run_until(board.now_s() + 1e-6)
    converted_s = board.now_s()
    board.run_until(converted_s + 0.5)
    first = next(m for m in decoder.feed(board.read_bytes()) if isinstance(m, FrameMessage))
    settle_s = SetLayout(rows=1, cols=1).settle_us * 1e-6
    return converted_s - settle_s - first.time_us * 1e-6


class _Tally:
    def __init__(self, *, rows: int, cols: int, oversampling: int, clock_s: float) -> None:
        self._clock_s = clock_s
        self._shape, self._oversampling = (rows, cols), oversampling
        self._times: list[int] = []
        self._delays: list[float] = []
        self._wrong = self._checked = 0

    def add(self, messages: list[Any], *, ends_s: Any, wanted_mv: Any, changed_s: float) -> None:
        if len(ends_s) != len(messages):
            ends_s = np.full(len(messages), np.nan)  # only near the start
        # The simulator stores voltages in single precision and computes in double precision.
        stored_mv = wanted_mv.astype(np.float32).astype(np.float64)
        wanted = np.minimum(np.floor(stored_mv * 1024.0 / 5000.0 + 0.5), 1023)
        for message, end_s in zip(messages, ends_s, strict=True):
            if not isinstance(message, FrameMessage):
                continue
            self._times.append(message.time_us)
            scanned_s = message.time_us * 1e-6 + self._clock_s
            self._delays.append(end_s - scanned_s)
            # A scan during the change of the voltages is not checked.
            if scanned_s < changed_s:
                continue
            self._checked += 1
            self._wrong += bool(np.any(message.counts != wanted * self._oversampling))

    def summary(self, *, rate_hz: float) -> dict[str, Any]:
        periods = np.diff(self._times)
        wanted = 1e6 / rate_hz
        delays_ms = 1e3 * np.array(self._delays)
        return {
            "frames_checked_against_voltages": self._checked,
            "frames_wrong": self._wrong,
            "period_us": {
                "wanted": round(wanted, 2),
                "mean": round(float(periods.mean()), 3),
                "sd": round(float(periods.std()), 2),
                "lowest": int(periods.min()),
                "highest": int(periods.max()),
            },
            "start_of_scan_to_last_byte_ms": {
                "median": round(float(np.nanmedian(delays_ms)), 3),
                "highest": round(float(np.nanmax(delays_ms)), 3),
            },
        }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--rate", type=float, default=250.0)
    parser.add_argument("--rows", type=int, default=4)
    parser.add_argument("--cols", type=int, default=2)
    parser.add_argument("--oversampling", type=int, default=1)
    parser.add_argument("--baud", type=int, default=1_000_000)
    parser.add_argument("--board", default="mega2560", choices=BOARDS)
    args = parser.parse_args()
    result = run_link(
        seconds=args.seconds,
        rate_hz=args.rate,
        rows=args.rows,
        cols=args.cols,
        oversampling=args.oversampling,
        baud=args.baud,
        board=args.board,
    )
    print(json.dumps(result, indent=1))
    bad = result["frames_lost"] or result["corrupt"] or result["frames_wrong"]
    sys.exit(1 if bad else 0)


if __name__ == "__main__":
    main()
