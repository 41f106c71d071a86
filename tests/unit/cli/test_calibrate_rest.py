"""`palpate calibrate rest` on a simulated sensor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from tests.commands import Command

from palpate.sensor.calibration import Calibration, ForcePairs
from palpate.twin.world import World

PAIRS = ForcePairs(
    run=(0,), since_move_s=(20.0,), excess=(1.0,), relative_percent=(-50.0,), force_n=(2.0,)
)


def test_calibrate_rest_writes_the_calibration_file_unless_the_sensor_is_loaded(
    rig_file: Callable[..., Path], palpate: Command
) -> None:
    rig = rig_file(seed=3)
    shown = palpate("calibrate", "rest", "--rig", rig).out
    made = Calibration.load(rig.parent / "sensor.json")
    assert made.rest_ohm == pytest.approx(World(None, seed=3).pixel_resistance_ohm(0.0), rel=0.01)
    assert made.rest.frames >= 75
    assert made.made_at is not None
    assert 0 < min(map(min, made.rest.spread_percent)) < 1
    assert "R3 C1" in shown
    before = (rig.parent / "sensor.json").read_text()
    err = palpate("calibrate", "rest", "--rig", rig_file(pressed=True), status=2).err
    assert "%" in err.splitlines()[-1]
    assert (rig.parent / "sensor.json").read_text() == before


def test_calibrate_rest_of_a_calibrated_rig_renews_the_rest_alone(
    rig_file: Callable[..., Path], palpate: Command
) -> None:
    rig = rig_file()
    path = rig.parent / "sensor.json"
    calibrate = ("calibrate", "rest", "--rig", rig)
    palpate(*calibrate)
    first = replace(Calibration.load(path), force=PAIRS, made_at="2020-01-01T00:00:00+00:00")
    first.save(path)
    assert palpate(*calibrate, "--json").document["renewed"] is True
    renewed = Calibration.load(path)
    assert (renewed.force, renewed.made_at) == (PAIRS, first.made_at)
    # As if the sheet had been drier at the first calibration.
    drier = tuple(tuple(1.3 * ohm for ohm in row) for row in first.rest.ohm)
    replace(first, rest=replace(first.rest, ohm=drier)).save(path)
    assert "--empty" in palpate(*calibrate, status=2).err.splitlines()[-1]
    palpate(*calibrate, "--empty")
    renewed = Calibration.load(path)
    assert renewed.force == PAIRS
    assert renewed.rest.ohm[0][0] == pytest.approx(first.rest.ohm[0][0], rel=0.02)
    # A file of another layout.
    divider = replace(first.layout.divider, reference_ohm=1e3)
    replace(first, layout=replace(first.layout, divider=divider)).save(path)
    assert "--new" in palpate(*calibrate, status=2).err
    palpate(*calibrate, "--new")
    assert Calibration.load(path).force.force_n == ()
