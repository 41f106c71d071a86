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
from palpate.sensor.array import RIGID_LAYOUT, Frame
from palpate.signal.circuit import Divider, ohm_to_volts, volts_to_counts
from palpate.signal.crosstalk import floating_readings_ohm

FLOATING = replace(
    RIGID_LAYOUT, idle_lines="floating", line_ohm=130.0, divider=Divider(adc_bits=20)
)


def test_recorded_wiring_is_stored_and_older_or_unknown_wiring_is_told_apart() -> None:
    info = RecordingInfo(layout=FLOATING, origin="hardware")
    assert decode_info(encode_info(info)).layout == FLOATING
    texts = encode_info(replace(info, layout=RIGID_LAYOUT))
    layout = json.loads(texts["layout"])
    older = {name: layout[name] for name in layout if name not in ("idle_lines", "line_ohm")}
    assert decode_info({**texts, "layout": json.dumps(older)}).layout == RIGID_LAYOUT
    unknown = {**layout, "idle_lines": "grounded"}
    with pytest.raises(RecordingError, match="isolated, floating, held"):
        decode_info({**texts, "layout": json.dumps(unknown)})


def test_exports_and_holds_are_free_of_crosstalk(tmp_path: Path) -> None:
    """Record rest, 1 s of closing and one pressed pixel, read through floating lines."""
    ohm = np.full((300, 4, 2), 3000.0)
    ohm[100:, 1, 1] = 700.0
    read = floating_readings_ohm(ohm) + FLOATING.line_ohm
    divider = FLOATING.divider
    counts = volts_to_counts(ohm_to_volts(read, divider=divider), divider=divider)
    path, out = tmp_path / "pressed.mcap", tmp_path / "pressed.csv"
    with RecordingWriter(path, info=RecordingInfo(layout=FLOATING, origin="hardware")) as writer:
        for k in range(300):
            width_mm = 60.0 - 0.2 * min(max(k - 50, 0), 50)
            writer.add(GripperState(time_s=k / 50, width_mm=width_mm, moving=50 <= k < 100))
            writer.add(Frame(time_s=k / 50, sequence=k, counts=counts[k]))
    with RecordingReader(path) as reader:
        write_export(out, frame_tables(reader), to="csv")
    with out.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    for row, col in np.ndindex(4, 2):
        column = [float(line[f"r{row}c{col}_ohm"]) for line in rows]
        assert column == pytest.approx(ohm[:, row, col], rel=0.01)
    holds = cut_recorded_holds(load_recording(path))
    settled = {hold.channel: float(hold.values[-1]) for hold in holds}
    assert settled.pop("r1c1") == pytest.approx(100 * (700 / 3000 - 1), abs=0.5)
    assert settled.pop("mean") == pytest.approx(100 * (700 / 3000 - 1) / 8, abs=0.2)
    assert max(map(abs, settled.values())) < 0.5
