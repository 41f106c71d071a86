"""Calibration files of earlier versions, and climate that makes one doubtful."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from palpate.sensor.array import RIGID_LAYOUT
from palpate.sensor.calibration import BlockPairs, Calibration, ForcePairs, RestValues


def calibration() -> Calibration:
    return Calibration(
        sensor_id="pad",
        origin="hardware",
        layout=RIGID_LAYOUT,
        rest=RestValues(ohm=((9e3, 8e3),) * 4, spread_percent=((0.1, 0.2),) * 4, frames=30),
        force=ForcePairs(run=(), since_move_s=(), excess=(), relative_percent=(), force_n=()),
        block=BlockPairs(block_mm=(), width_mm=(), force_n=()),
    )


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
