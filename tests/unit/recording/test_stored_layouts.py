"""Layouts in files: wiring is stored, and older files without wiring stay readable."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.errors import RecordingError
from palpate.gripper.interface import GripperState
from palpate.recording import RecordingInfo, RecordingReader, RecordingWriter
from palpate.recording.channels import decode_info, encode_info
from palpate.recording.exporting import cut_recorded_holds, frame_tables, write_export
from palpate.recording.reader import load_recording
from palpate.sensor.array import RIGID_LAYOUT, ArrayLayout, Frame
from palpate.signal.circuit import Divider, ohm_to_volts, volts_to_counts
from palpate.signal.crosstalk import floating_readings_ohm

FLOATING = replace(
    RIGID_LAYOUT, idle_lines="floating", line_ohm=130.0, divider=Divider(adc_bits=20)
)


def test_recording_info_roundtrip_preserves_wiring() -> None:
    info = RecordingInfo(layout=FLOATING, origin="hardware")
    assert decode_info(encode_info(info)).layout == FLOATING


def test_old_recording_without_wiring_is_read_as_isolated() -> None:
    texts = encode_info(RecordingInfo(layout=RIGID_LAYOUT, origin="hardware"))
    layout = json.loads(texts["layout"])
    for name in ("idle_lines", "line_ohm"):
        del layout[name]
    assert decode_info({**texts, "layout": json.dumps(layout)}).layout == RIGID_LAYOUT


def test_recording_info_unknown_wiring_is_refused() -> None:
    texts = encode_info(RecordingInfo(layout=RIGID_LAYOUT, origin="hardware"))
    layout = {**json.loads(texts["layout"]), "idle_lines": "grounded"}
    with pytest.raises(RecordingError, match="isolated, floating, held"):
        decode_info({**texts, "layout": json.dumps(layout)})


@pytest.fixture
def pressed(tmp_path: Path) -> tuple[Path, ArrayLayout, np.ndarray]:
    """Record rest, 1 s of closing and one pressed pixel, read through floating lines."""
    ohm = np.full((300, 4, 2), 3000.0)
    ohm[100:, 1, 1] = 700.0
    read = floating_readings_ohm(ohm) + FLOATING.line_ohm
    divider = FLOATING.divider
    counts = volts_to_counts(ohm_to_volts(read, divider=divider), divider=divider)
    path = tmp_path / "pressed.mcap"
    with RecordingWriter(path, info=RecordingInfo(layout=FLOATING, origin="hardware")) as writer:
        for k in range(300):
            width_mm = 60.0 - 0.2 * min(max(k - 50, 0), 50)
            state = GripperState(time_s=k / 50, width_mm=width_mm, moving=50 <= k < 100)
            writer.add(state)
            writer.add(Frame(time_s=k / 50, sequence=k, counts=counts[k]))
    return path, FLOATING, ohm


def test_exported_resistances_are_free_of_crosstalk(
    pressed: tuple[Path, ArrayLayout, np.ndarray],
) -> None:
    path, layout, ohm = pressed
    out = path.with_suffix(".csv")
    with RecordingReader(path) as reader:
        write_export(out, frame_tables(reader), to="csv")
    with out.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    for row in range(layout.rows):
        for col in range(layout.cols):
            column = [float(line[f"r{row}c{col}_ohm"]) for line in rows]
            assert column == pytest.approx(ohm[:, row, col], rel=0.01)


def test_recorded_holds_show_only_the_pressed_pixel(
    pressed: tuple[Path, ArrayLayout, np.ndarray],
) -> None:
    path, _, _ = pressed
    settled = {
        hold.channel: float(hold.values[-1]) for hold in cut_recorded_holds(load_recording(path))
    }
    assert settled.pop("r1c1") == pytest.approx(100 * (700 / 3000 - 1), abs=0.5)
    assert settled.pop("mean") == pytest.approx(100 * (700 / 3000 - 1) / 8, abs=0.2)
    assert max(map(abs, settled.values())) < 0.5
