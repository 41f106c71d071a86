"""`palpate export --rerun`: the written file, read back with Rerun's own reader."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rerun.chunk", reason="needs the Rerun SDK with its reader of chunks")

from packages.rerun.tests.rrd_files import read_rrd, series
from tests.commands import Command
from tests.pages import test_commands_of_page_run
from tests.recordings import write_recording

from palpate.gripper.interface import GripperState
from palpate.recording import RecordingInfo
from palpate.recording.channels import RecordedMessage
from palpate.sensor.array import RIGID_LAYOUT, Frame

__all__ = ["test_commands_of_page_run"]


@pytest.fixture
def page() -> str:
    """The page about Rerun."""
    return "rerun"


#: The pixel that alone carries load.
PRESSED = (2, 1)


def record_press(path: Path, info: RecordingInfo) -> Path:
    """Record two seconds of rest, a movement, and a load on one pixel, 50 frames/s."""
    messages: list[RecordedMessage] = []
    for k in range(200):
        counts = np.full((4, 2), 300 + k % 3)
        if k >= 100:
            counts[PRESSED] = 600
        time_s, width_mm = k / 50, 60.0 - max(0, k - 100) / 10
        messages.append(GripperState(time_s=time_s, width_mm=width_mm, moving=k >= 100))
        messages.append(Frame(time_s=time_s, sequence=k, counts=counts))
    return write_recording(path, messages, info)


@pytest.mark.slow
def test_rerun_file_of_a_grasp_has_force_width_and_phases(palpate: Command, tmp_path: Path) -> None:
    run, out, table = (tmp_path / name for name in ("run.mcap", "run.rrd", "run.csv"))
    palpate("grasp", "--rig", "sim-rigid", "--seed", "1", "--rate-hz", "60", "--record", run)
    result = json.loads(palpate("replay", run, "--json").out)
    palpate("export", run, "--rerun", out)
    palpate("export", run, "--out", table)
    with table.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    entities = read_rrd(out)

    force = np.array(series(entities["force"]))
    assert entities["force"]["SeriesLines:names"] == [["force_n", "low_n", "high_n"]]
    assert len(force) == len(rows)
    assert np.all(force[:, 1] <= force[:, 0])
    assert np.all(force[:, 0] <= force[:, 2])
    held = result["force_n"]
    assert held["low"] < force[:, 0].max() < 1.2 * held["high"]

    width_mm = np.ravel(series(entities["gripper/width_mm"]))
    assert width_mm.tolist() == [float(row["width_mm"]) for row in rows]
    times_s = np.sort(entities["force"]["sensor_time"]) / 1e9
    assert times_s == pytest.approx([float(row["time_s"]) for row in rows], abs=1e-8)

    said = zip(entities["events"]["sensor_time"], entities["events"]["TextLog:text"], strict=True)
    events = {text: at / 1e9 for at, [text] in said}
    phases = ["approach", "squeeze", "settle", "hold", "release"]
    starts_s = [events[f"phase: {phase}"] for phase in phases]
    assert starts_s == sorted(starts_s)
    contact_s = next(one["time_s"] for one in result["moments"] if one["name"] == "contact")
    assert events["contact"] == pytest.approx(contact_s)
    assert "SIMULATED" in entities["source"]["TextDocument:text"][0][0]


def test_rerun_image_shows_each_pixel_at_its_named_place(palpate: Command, tmp_path: Path) -> None:
    info = RecordingInfo(layout=RIGID_LAYOUT, origin="hardware", clock_zero_unix_ns=10**18)
    run = record_press(tmp_path / "press.mcap", info)
    out = tmp_path / "press.rrd"
    palpate("export", run, "--rerun", out)
    entities = read_rrd(out)
    images = entities["pixels/decrease_percent"]
    last = int(np.argmax(images["sensor_time"]))
    shape = images["DepthImage:format"][last][0]
    assert (shape["width"], shape["height"]) == (2, 4)
    shown = np.array(images["DepthImage:buffer"][last][0], np.uint8).view("<f4").reshape(4, 2)
    names = entities["pixels/names"]
    centers = dict(zip(names["Boxes2D:labels"][0], names["Boxes2D:centers"][0], strict=True))
    x, y = centers["r{}c{}".format(*PRESSED)]
    assert shown[int(y), int(x)] == shown.max() > 60.0
    lines = entities["change"]["SeriesLines:names"][0]
    change = dict(zip(lines, series(entities["change"])[-1], strict=True))
    assert change["r2c1_percent"] == pytest.approx(-shown.max(), rel=1e-5)
    # Without a calibration there is no force.
    assert "Scalars:scalars" not in entities["force"]
    # A board's recording has the time of day too.
    wall_ns, sensor_ns = images["wall_time"][last], images["sensor_time"][last]
    assert wall_ns - sensor_ns == pytest.approx(10**18, abs=1000)


def test_rerun_export_refuses_what_it_cannot_write(palpate: Command, tmp_path: Path) -> None:
    info = RecordingInfo(layout=RIGID_LAYOUT, origin="twin")
    run = record_press(tmp_path / "run.mcap", info)
    old = tmp_path / "old.rrd"
    old.write_bytes(b"")
    assert ".rrd" in palpate.refused("export", run, "--rerun", tmp_path / "run.bin")
    assert "already exists" in palpate.refused("export", run, "--rerun", old)
    assert "--holds" in palpate.refused("export", run, "--holds", "--rerun", tmp_path / "a.rrd")
    assert "not an MCAP" in palpate.refused("export", old, "--rerun", tmp_path / "b.rrd")
    empty = write_recording(tmp_path / "empty.mcap", [], info)
    assert "no frames" in palpate.refused("export", empty, "--rerun", tmp_path / "c.rrd")
    assert not (tmp_path / "c.rrd").exists()
