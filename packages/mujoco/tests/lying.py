"""A pad that faces up, turned and shifted, with 1 kg on it."""

from __future__ import annotations

import mujoco
import numpy as np

from palpate.sensor.array import ArrayLayout
from palpate_mujoco import Pad, PadSensor

WEIGHT_N = 9.81
#: Pixels of one pad, and their position on the geom.
PALM = ArrayLayout(name="palm", rows=2, cols=3, finger_of_row=(0, 0))
UP = Pad(geom="pad", along=(1.0, 0.0, 0.0), across=(0.0, 1.0, 0.0))

_MODEL = """
<mujoco>
  <option timestep="0.001" cone="{cone}"/>
  <worldbody>
    <geom name="table" type="plane" size="1 1 1"/>
    <body pos="0.3 -0.2 0.1" euler="0 0 30">
      <geom name="pad" type="box" size="0.02 0.02 0.001"/>
      <body pos="{x} {y} {z}">
        <joint type="slide" axis="0 0 1" damping="300"/>
        <geom type="{shape}" size="{size}" mass="1"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def lying(
    pad: Pad = UP,
    *,
    shape: str = "sphere",
    size: str = "0.01",
    at_mm: tuple[float, float] = (0.0, 0.0),
    cone: str = "elliptic",
    layout: ArrayLayout = PALM,
) -> PadSensor:
    """Return a sensor with 1 kg at rest on it."""
    above_m = float(size.split()[-1]) + 0.0011
    text = _MODEL.format(
        cone=cone, shape=shape, size=size, x=at_mm[0] / 1e3, y=at_mm[1] / 1e3, z=above_m
    )
    model = mujoco.MjModel.from_xml_string(text)
    sensor = PadSensor(model, mujoco.MjData(model), pads=[pad], layout=layout, seed=1)
    sensor.step_to(1.0)
    return sensor


def contact_n(sensor: PadSensor) -> float:
    """Return the sum of MuJoCo's normal forces of all contacts."""
    total, force = 0.0, np.zeros(6)
    for index in range(sensor.data.ncon):
        mujoco.mj_contactForce(sensor.model, sensor.data, index, force)
        total += force[0]
    return total
