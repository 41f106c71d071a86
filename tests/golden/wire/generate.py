"""Writes vectors.json once per protocol version, for tests of both codecs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from palpate.sensor import wire_messages as wm
from palpate.sensor.wire import encode_command
from palpate_studies.board_bytes import encode_message


def commands() -> list[tuple[wm.Command, int]]:
    return [
        (wm.Identify(), 1),
        (wm.SetLayout(rows=4, cols=2, settle_us=20), 2),
        (wm.SetLayout(rows=16, cols=16, settle_us=1000), 255),
        (wm.SetRate(rate_hz=15.0), 3),
        (wm.SetOversampling(conversions=64), 4),
        (wm.Start(contents=wm.Contents.LOAD_CELLS | wm.Contents.PRESSURE), 5),
        (wm.Stop(), 6),
        (wm.Ping(), 7),
        (wm.SetPressure(target_kpa=12.345, slew_kpa_per_s=20.0), 8),
        (wm.SetCeiling(counts=1000), 9),
        (wm.SetServoTravel(open_us=2300, closed_us=700), 10),
        (wm.SetServo(target_us=0, rate_us_per_s=1000), 11),
    ]


def frames() -> list[wm.FrameMessage]:
    rng = np.random.default_rng(7)

    def pixels(rows: int, cols: int, top: int) -> Any:
        return rng.integers(0, top, (rows, cols), endpoint=True).astype(np.uint16)

    def frame(counts: Any, **rest: Any) -> wm.FrameMessage:
        given = {"sequence": 0, "time_us": 0, "stream": 1, "oversampling": 1, "status": 0} | rest
        return wm.FrameMessage(counts=counts, **given)

    cells = (wm.CellSample(raw=-8388608, sample=255), wm.CellSample(raw=wm.NO_READING, sample=0))
    return [
        frame(pixels(4, 2, 1023)),
        frame(np.zeros((1, 1)), sequence=2**32 - 1, time_us=2**32 - 1, stream=255),
        frame(pixels(6, 2, 1023 * 64), sequence=77, time_us=123456789, oversampling=64),
        frame(pixels(4, 2, 1023), load_cells=cells),
        frame(pixels(4, 2, 1023), pressure_set_kpa=50.0, pressure_kpa=25.0),
        # 512 bytes of pixels without a zero: stuffing runs of 254.
        frame(np.full((16, 16), 0x0101), load_cells=cells, pressure_set_kpa=0.0, pressure_kpa=0.0),
        frame(pixels(16, 16, 65472), oversampling=64, sequence=10**9),
        frame(np.full((4, 2), 700), load_cells=cells, servo_us=1500),
    ]


def identities() -> list[wm.BoardIdentity]:
    def identity(protocol: int, **rest: Any) -> wm.BoardIdentity:
        return wm.BoardIdentity(
            tag=3,
            protocol=protocol,
            version=(0, protocol, 0),
            rows=4,
            cols=2,
            oversampling=1,
            max_oversampling=64,
            settle_us=20,
            heartbeat_ms=500,
            reset_cause=8,
            streaming=True,
            conversion_us=104,
            baud=1_000_000,
            rate_hz=250.0,
            highest_rate_hz=801.282,
            **rest,
        )

    mega = {"features": 3, "max_rows": 16, "max_cols": 16, "board": "Arduino Mega 2560"}
    return [
        identity(1, **mega),
        identity(2, features=5, max_rows=4, max_cols=4, board="Arduino Uno"),
        identity(2, features=4, max_rows=4, max_cols=4, board="twelve bits", full_scale=4096),
    ]


def plain(message: Any) -> dict[str, Any]:
    """Return a message's fields as JSON knows them."""
    fields = {name: getattr(message, name) for name in message.__dataclass_fields__}
    if "counts" in fields and isinstance(fields["counts"], np.ndarray):
        fields["counts"] = fields["counts"].tolist()
    if "load_cells" in fields:
        fields["load_cells"] = [[cell.raw, cell.sample] for cell in fields["load_cells"]]
    return fields


def main() -> None:
    vectors = {
        "protocol": wm.PROTOCOL_VERSION,
        "commands": [
            {
                "name": type(command).__name__,
                "fields": plain(command),
                "tag": tag,
                "bytes": encode_command(command, tag=tag).hex(),
            }
            for command, tag in commands()
        ],
        "frames": [
            {"fields": plain(frame), "bytes": encode_message(frame).hex()} for frame in frames()
        ],
        "identities": [
            {"fields": plain(identity), "bytes": encode_message(identity).hex()}
            for identity in identities()
        ],
    }
    path = Path(__file__).with_name("vectors.json")
    path.write_text(json.dumps(vectors, indent=1) + "\n")


if __name__ == "__main__":
    main()
