"""Traces next to a load cell: what is refused; calibration files of earlier versions."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.errors import CalibrationError
from palpate.sensor.array import RIGID_LAYOUT
from palpate.sensor.calibration import BlockPairs, Calibration, ForcePairs, RestValues
from palpate.sensor.load_traces import LoadTraces, frames


def traces(**changes: object) -> LoadTraces:
    columns: dict[str, object] = {
        "run": [0, 0, 1, 1],
        "time_s": [1700000000.125, 1700000000.25, 5.0, 5.1],
        "excess": [[0.1, 0.2], [1.0, 2.0], [0.3, 0.1], [4.0, 4.5]],
        "width_mm": [40.0, 39.0, 40.0, 38.0],
        "current_ma": [np.nan, np.nan, 3.0, 60.0],
        "force_n": [0.1, 2.0, 0.2, 5.0],
    }
    return LoadTraces(**{**columns, **changes})  # type: ignore[arg-type]


def calibration() -> Calibration:
    return Calibration(
        sensor_id="pad",
        origin="hardware",
        layout=RIGID_LAYOUT,
        rest=RestValues(ohm=((9e3, 8e3),) * 4, spread_percent=((0.1, 0.2),) * 4, frames=30),
        force=ForcePairs(run=(), since_move_s=(), excess=(), relative_percent=(), force_n=()),
        block=BlockPairs(block_mm=(), width_mm=(), force_n=()),
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"force_n": [2.0, 2.0, 2.01, 2.0]}, "stays at 2 N; is the load cell connected"),
        ({"force_n": [0.0, 0.01, 0.0, -0.01]}, "is the load cell connected"),
        ({"force_n": [0.1, 2.0, 0.2]}, "unequal length"),
        ({"time_s": [2.0, 1.0, 5.0, 5.1]}, "time runs backwards within a run"),
        ({"force_n": [0.1, np.nan, 0.2, 5.0]}, "finite"),
        ({"excess": [[0.1, np.inf], [1, 2], [0.3, 0.1], [4, 4.5]]}, "palpate doctor"),
    ],
)
def test_bad_traces_are_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(CalibrationError, match=message) as caught:
        traces(**changes)
    assert "\n" not in str(caught.value)


def test_runs_and_frames() -> None:
    first, second = traces().runs()
    assert [frame.force_n for frame in frames(first)] == [0.1, 2.0]
    assert [frame.width_mm for frame in frames(second)] == [40.0, 38.0]


@pytest.mark.parametrize("version", [1, 2])
def test_older_versions_are_read_without_what_no_grasp_reads(tmp_path: Path, version: int) -> None:
    path = tmp_path / "pad.json"
    document = json.loads(calibration().as_text())
    if version == 1:
        del document["held_out"]
    else:
        document |= {"traces": {"run": [0.0]}, "observer": {"kind": "sheet"}}
    path.write_text(json.dumps({**document, "version": version}))
    assert Calibration.load(path) == calibration()


def test_another_humidity_is_a_concern() -> None:
    from datetime import UTC, datetime

    made = replace(calibration(), humidity_percent=40.0)
    now = datetime(2026, 1, 1, tzinfo=UTC)
    assert made.concerns(now=now, humidity_percent=50.0) == ()
    assert "40 % humidity" in made.concerns(now=now, humidity_percent=70.0)[0]
