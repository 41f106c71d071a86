"""Holds cut from recordings, export of recordings to tables, and wiring in recordings."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from tests.recordings import write_recording

from palpate.errors import RecordingError
from palpate.gripper.interface import GripperState
from palpate.holds import read_holds
from palpate.recording import Event, RecordingInfo, RecordingReader, load_recording
from palpate.recording.channels import RecordedMessage, decode_info, encode_info
from palpate.recording.exporting import (
    cut_file_holds,
    cut_recorded_holds,
    frame_tables,
    hold_tables,
    write_export,
)
from palpate.sensor.array import RIGID_LAYOUT, Frame
from palpate.signal.circuit import Divider, ohm_to_volts, resistance_ohm, volts_to_counts
from palpate.signal.crosstalk import floating_readings_ohm

Write = Callable[[list[RecordedMessage]], Path]


def grasp_messages(
    *, gripper: bool = True, counts_held: int = 600, seconds: float = 3.0
) -> list[RecordedMessage]:
    """Return rest (1 s), closing (0.5 s), a hold, opening (0.5 s), rest (1.5 s)."""
    made: list[RecordedMessage] = []
    opened_s = 1.5 + seconds
    for k in range(int((opened_s + 2.0) * 50)):
        time_s = k / 50
        moving = 1.0 <= time_s < 1.5 or opened_s <= time_s < opened_s + 0.5
        held = 1.5 <= time_s < opened_s
        spike = moving and not gripper and time_s % 0.5 < 0.1
        counts = np.full((4, 2), counts_held if held else 250 if spike else 300)
        counts[0, 0] = 0
        width_mm = 40.0 if held else 60.0
        if gripper:
            made.append(GripperState(time_s=time_s, width_mm=width_mm, moving=moving))
        made.append(Frame(time_s=time_s, sequence=k, counts=counts, oversampling=1))
    return made


@pytest.fixture
def write(tmp_path: Path) -> Write:
    return partial(write_recording, tmp_path / "run.mcap")


def ohm(count: int) -> float:
    return resistance_ohm([count], divider=RIGID_LAYOUT.divider).item()


def test_cut_recorded_holds_span_stop_to_next_movement(write: Write) -> None:
    path = write(grasp_messages())
    holds = {hold.channel: hold for hold in cut_file_holds(path)}
    assert list(holds) == ["mean", "r0c1", "r1c0", "r1c1", "r2c0", "r2c1", "r3c0", "r3c1"]
    mean = holds["mean"]
    assert mean.hold_id == "run-1"
    assert (mean.time_s[0], mean.time_s[-1]) == pytest.approx((0.0, 2.96))
    assert mean.values == pytest.approx(100 * (ohm(600) / ohm(300) - 1))
    in_ohm = cut_file_holds(path, unit="ohm")
    assert in_ohm[0].channel == "r0c1"
    assert in_ohm[0].values == pytest.approx(ohm(600))


def test_cut_recorded_holds_without_gripper_uses_contact_as_hold(write: Write) -> None:
    (hold, *_) = holds = cut_recorded_holds(load_recording(write(grasp_messages(gripper=False))))
    assert {one.hold_id for one in holds} == {"hold-1"}
    assert hold.channel == "mean"
    assert 2.6 < hold.time_s[-1] < 3.0


@pytest.mark.parametrize(
    ("messages", "fault"),
    [
        (grasp_messages(counts_held=301), "no hold found"),
        (grasp_messages(seconds=0.8), "no hold found"),
        (grasp_messages()[:12], "6 frames are too few"),
        (grasp_messages()[140:], "no rest at the beginning"),
    ],
)
def test_cut_recorded_holds_without_hold_raises_reason(
    write: Write, messages: list[RecordedMessage], fault: str
) -> None:
    recording = load_recording(write(messages))
    with pytest.raises(RecordingError, match=fault):
        cut_recorded_holds(recording)


@pytest.mark.parametrize("to", ["csv", "parquet"])
def test_exported_holds_file_roundtrip(tmp_path: Path, write: Write, to: str) -> None:
    holds = cut_recorded_holds(load_recording(write(grasp_messages())))
    target = tmp_path / f"holds.{to}"
    rows = write_export(target, hold_tables(holds), to=to)  # type: ignore[arg-type]
    back = list(read_holds(target))
    assert rows == sum(len(hold.time_s) for hold in holds)
    assert [hold.channel for hold in back] == [hold.channel for hold in holds]
    assert {hold.unit for hold in back} == {"percent"}
    assert np.array_equal(back[0].values, holds[0].values)


def test_exported_table_has_one_row_per_frame(tmp_path: Path, write: Write) -> None:
    messages = [Event(time_s=0.0, name="=1+1", text="ripe"), *grasp_messages()]
    with RecordingReader(write(messages)) as reader:
        rows = write_export(tmp_path / "run.csv", frame_tables(reader), to="csv")
        write_export(tmp_path / "run.parquet", frame_tables(reader), to="parquet")
    with (tmp_path / "run.csv").open(newline="") as stream:
        table = list(csv.DictReader(stream))
    assert rows == len(table) == 325
    # A spreadsheet would calculate an event that begins with an equals sign.
    assert (table[0]["events"], table[1]["events"]) == ("'=1+1: ripe", "")
    parquet = pytest.importorskip("pyarrow.parquet")
    assert parquet.read_table(tmp_path / "run.parquet")["events"][0].as_py() == "=1+1: ripe"
    assert (table[0]["width_mm"], table[0]["current_ma"]) == ("60.0", "")
    assert (table[0]["r0c0_counts"], table[0]["r0c0_ohm"]) == ("0", "inf")
    assert [row["moving"] for row in table].count("True") == 50


def test_export_invalid_counts_are_refused(tmp_path: Path, write: Write) -> None:
    first, *rest = grasp_messages()
    frame = next(one for one in (first, *rest) if isinstance(one, Frame))
    wrong = replace(frame, counts=np.full((4, 2), -1), time_s=frame.time_s - 1.0)
    path = write([wrong, first, *rest])
    with RecordingReader(path) as reader, pytest.raises(RecordingError, match="counts from -1"):
        write_export(tmp_path / "run.csv", frame_tables(reader), to="csv")
    assert not (tmp_path / "run.csv").exists()
    with pytest.raises(RecordingError, match="counts from -1"):
        cut_recorded_holds(load_recording(path))


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
    messages = list[RecordedMessage]()
    for k in range(300):
        width_mm = 60.0 - 0.2 * min(max(k - 50, 0), 50)
        messages.append(GripperState(time_s=k / 50, width_mm=width_mm, moving=50 <= k < 100))
        messages.append(Frame(time_s=k / 50, sequence=k, counts=counts[k]))
    info = RecordingInfo(layout=FLOATING, origin="hardware")
    path, out = write_recording(tmp_path / "pressed.mcap", messages, info), tmp_path / "out.csv"
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
