"""The sheet on a pad: the twin's own, whoever steps the model."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest
from bridges.mujoco.tests.lying import PALM, UP, lying

from palpate.errors import DeviceTimeoutError, InputError
from palpate.sensor.array import wrong_counts
from palpate.sensor.pixel_resistance import pixel_resistance_ohm
from palpate.twin.devices import TwinArray
from palpate.twin.sheet_state import SheetState
from palpate_mujoco import PadSensor


def test_frames_come_at_the_arrays_rate_and_fit_its_layout() -> None:
    sensor = lying()
    array = TwinArray(sensor)
    frames = [array.read(timeout_s=0.1) for _ in range(30)]
    assert [frame.sequence for frame in frames] == list(range(30))
    assert np.diff([frame.time_s for frame in frames]) == pytest.approx(1 / 15)
    assert sensor.data.time == pytest.approx(frames[-1].time_s, abs=sensor.model.opt.timestep)
    assert not any(wrong_counts(frame, layout=PALM) for frame in frames)
    with pytest.raises(DeviceTimeoutError):
        array.read(timeout_s=0.01)


def test_a_steady_load_reads_what_the_twins_sheet_does_under_it() -> None:
    sensor = lying(at_mm=(5.0, 0.0))
    load_n, chance = sensor.load_n.ravel(), sensor.placement
    sensor.step_to(sensor.data.time + 19.0)
    state = SheetState.unloaded(PALM.pixels, creep=chance.creep)
    for step_s in (1e-3, 20.0):
        state = state.after(
            step_s,
            load_n,
            travel_mm=0.0,
            sheet=sensor.sheet,
            gain=chance.gain,
            creep=chance.creep,
        )
    twin_ohm = state.resistance_ohm(sensor.sheet, creep=chance.creep)
    assert sensor.resistance_ohm().ravel() == pytest.approx(twin_ohm, rel=2e-3)


def test_counts_go_through_the_divider() -> None:
    sensor = lying()
    scans = np.mean([pixel_resistance_ohm(sensor.counts(), layout=PALM) for _ in range(50)], axis=0)
    assert scans == pytest.approx(sensor.resistance_ohm(), rel=0.02)


def test_a_program_that_steps_the_model_itself_reads_the_same() -> None:
    sensor = lying()
    model, data = sensor.model, mujoco.MjData(sensor.model)
    own = PadSensor(model, data, pads=[UP], layout=PALM, seed=1)
    while data.time < sensor.data.time - 1e-9:
        mujoco.mj_step(model, data)
        own.feel()
    assert own.counts().tolist() == sensor.counts().tolist()


def test_the_same_seed_reads_the_same_counts() -> None:
    first, second = lying(), lying()
    assert first.counts().tolist() == second.counts().tolist()


def test_floating_lines_leak_as_the_solver_expects() -> None:
    matrix = replace(PALM, idle_lines="floating")
    sensor = lying(layout=matrix)
    ohm = [pixel_resistance_ohm(sensor.counts(), layout=matrix) for _ in range(50)]
    assert np.mean(ohm, axis=0) == pytest.approx(sensor.resistance_ohm(), rel=0.05)
    leaky = pixel_resistance_ohm(sensor.counts(), layout=PALM)
    assert np.abs(leaky / sensor.resistance_ohm() - 1.0).max() > 0.2


@pytest.mark.parametrize("wiring", [{"idle_lines": "held"}, {"line_ohm": 70.0}])
def test_a_wiring_that_is_not_simulated_is_refused(wiring: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="neither held lines nor line_ohm"):
        lying(layout=replace(PALM, **wiring))


def test_a_reset_needs_a_new_sensor() -> None:
    sensor = lying()
    mujoco.mj_resetData(sensor.model, sensor.data)
    with pytest.raises(ValueError, match="went back from 1 to 0 s; after a reset make a new"):
        sensor.counts()


def test_an_unloaded_pad_goes_back_to_rest() -> None:
    sensor = lying()
    assert sensor.change_percent().min() < -20.0
    sensor.data.qpos[0] = 0.05
    sensor.model.opt.gravity[:] = 0.0
    sensor.step_to(sensor.data.time + 60.0)
    assert np.abs(sensor.change_percent()).max() < 2.0
