"""A sheet on a pad: loads of its pixels, and the twin's readings with any stepping."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest
from packages.mujoco.tests.lying import PALM, UP, WEIGHT_N, contact_n, lying

from palpate.errors import DeviceTimeoutError, InputError
from palpate.sensor.array import ArrayLayout, find_impossible_count
from palpate.sensor.sample import pixel_resistance_ohm
from palpate.twin.devices import TwinArray
from palpate.twin.sheet_state import SheetState
from palpate_mujoco import PadSensor, TouchGrid

TALL = ArrayLayout(name="tall", rows=5, cols=5, finger_of_row=(0,) * 5)


def test_frames_have_rate_and_layout_of_array() -> None:
    sensor = lying()
    array = TwinArray(sensor)
    frames = [array.read(timeout_s=0.1) for _ in range(30)]
    assert [frame.sequence for frame in frames] == list(range(30))
    assert np.diff([frame.time_s for frame in frames]) == pytest.approx(1 / 15)
    assert sensor.data.time == pytest.approx(frames[-1].time_s, abs=sensor.model.opt.timestep)
    assert not any(find_impossible_count(frame, layout=PALM) for frame in frames)
    with pytest.raises(DeviceTimeoutError):
        array.read(timeout_s=0.01)


def test_constant_load_reads_like_twin_sheet() -> None:
    sensor = lying(at_mm=(5.0, 0.0))
    load_n, placement = sensor.load_n.ravel(), sensor.placement
    sensor.step_to(sensor.data.time + 19.0)
    state = SheetState.at_rest(PALM.pixels, creep=placement.creep)
    for step_s in (1e-3, 20.0):
        state = state.advance(
            step_s,
            load_n,
            travel_mm=0.0,
            sheet=sensor.sheet,
            gain=placement.gain,
            creep=placement.creep,
        )
    twin_ohm = state.resistance_ohm(sensor.sheet, creep=placement.creep)
    assert sensor.resistance_ohm().ravel() == pytest.approx(twin_ohm, rel=2e-3)


def test_counts_follow_divider() -> None:
    sensor = lying()
    scans = np.mean([pixel_resistance_ohm(sensor.counts(), layout=PALM) for _ in range(50)], axis=0)
    assert scans == pytest.approx(sensor.resistance_ohm(), rel=0.02)


def test_floating_lines_leak_like_solver_model() -> None:
    matrix = replace(PALM, idle_lines="floating")
    sensor = lying(layout=matrix)
    ohm = [pixel_resistance_ohm(sensor.counts(), layout=matrix) for _ in range(50)]
    assert np.mean(ohm, axis=0) == pytest.approx(sensor.resistance_ohm(), rel=0.05)
    leaky = pixel_resistance_ohm(sensor.counts(), layout=PALM)
    assert np.abs(leaky / sensor.resistance_ohm() - 1.0).max() > 0.2


@pytest.mark.parametrize("wiring", [{"idle_lines": "held"}, {"line_ohm": 70.0}])
def test_unsupported_wiring_is_refused(wiring: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="neither held lines nor line_ohm"):
        lying(layout=replace(PALM, **wiring))


def test_counts_after_model_reset_raise() -> None:
    sensor = lying()
    mujoco.mj_resetData(sensor.model, sensor.data)
    with pytest.raises(ValueError, match="decreased from 1 to 0 s; create a new sensor"):
        sensor.counts()


GRID_MODEL = """
<mujoco>
  <extension><plugin plugin="mujoco.sensor.touch_grid"/></extension>
  <worldbody>
    <body>
      <geom name="pad" type="box" size="0.02 0.02 0.001"/>
      <site name="eye" pos="0 0 -0.04" euler="180 0 0"/>
      <geom type="box" size="0.02 0.02 0.001" pos="0 0 -0.2"/>
    </body>
    <body pos="0.008 0.012 0.0111">
      <joint type="slide" axis="0 0 1" damping="300"/>
      <geom size="0.01" mass="1"/>
    </body>
  </worldbody>
  <sensor>
    <plugin name="grid" plugin="mujoco.sensor.touch_grid" objtype="site" objname="eye">
      <config key="size" value="3 2"/><config key="fov" value="26 26"/>
      <config key="gamma" value="0"/><config key="nchannel" value="3"/>
    </plugin>
    <framepos name="place" objtype="site" objname="eye"/>
  </sensor>
</mujoco>
"""


def test_touch_grid_of_the_model_loads_its_pixels_with_newtons() -> None:
    model = mujoco.MjModel.from_xml_string(GRID_MODEL)
    data = mujoco.MjData(model)
    sensor = PadSensor(model, data, pads=[TouchGrid(sensor="grid")], layout=PALM, seed=1)
    sensor.step_to(1.0)
    # The site faces up: its x is the model's x, its y is reversed.
    assert sensor.load_n == pytest.approx(np.array([[0.0, 0.0, 9.81], [0.0, 0.0, 0.0]]), abs=0.05)
    assert sensor.change_percent()[0, 2] < -20.0


@pytest.mark.parametrize(("name", "layout"), [("gird", PALM), ("place", PALM), ("grid", TALL)])
def test_sensor_without_matching_touch_grid_is_refused(name: str, layout: ArrayLayout) -> None:
    model = mujoco.MjModel.from_xml_string(GRID_MODEL)
    with pytest.raises(InputError, match=f"needs a touch_grid '{name}' with the"):
        PadSensor(model, mujoco.MjData(model), pads=[TouchGrid(sensor=name)], layout=layout, seed=1)


@pytest.mark.parametrize("cone", ["elliptic", "pyramidal"])
@pytest.mark.parametrize(
    "weight",
    [
        {"shape": "sphere", "size": "0.01", "at_mm": (19.0, -19.0)},
        {"shape": "box", "size": "0.004 0.03 0.01", "at_mm": (-6.0, 3.0)},
    ],
)
def test_pad_load_equals_mujoco_contact_force(weight: dict[str, Any], cone: str) -> None:
    sensor = lying(**weight, cone=cone)
    assert sensor.load_n.sum() == pytest.approx(contact_n(sensor), rel=1e-9)
    assert sensor.load_n.sum() == pytest.approx(WEIGHT_N, rel=1e-3)
    assert sensor.finger_n.tolist() == pytest.approx([sensor.load_n.sum()])


def test_ball_loads_only_the_pixels_below() -> None:
    for row, col in np.ndindex(PALM.rows, PALM.cols):
        load_n = lying(at_mm=(10.0 * (row - 0.5), 10.0 * (col - 1))).load_n.copy()
        assert load_n[row, col] == pytest.approx(WEIGHT_N, rel=1e-3)
        load_n[row, col] = 0.0
        assert np.abs(load_n).max() < 1e-6
    load_n = lying(at_mm=(5.0, 5.0)).load_n
    assert load_n[1, 1] == pytest.approx(0.5 * WEIGHT_N, rel=1e-3)
    assert load_n[1, 2] == pytest.approx(0.5 * WEIGHT_N, rel=1e-3)


def test_unknown_geom_and_wrong_number_of_pads_are_refused() -> None:
    with pytest.raises(InputError, match=r"no geom 'palm'; available: table, pad"):
        lying(replace(UP, geom="palm"))
    sensor = lying()
    with pytest.raises(InputError, match=r"has 1 finger\(s\) and 2 pad\(s\)"):
        PadSensor(sensor.model, sensor.data, pads=[UP, UP], layout=PALM, seed=1)
