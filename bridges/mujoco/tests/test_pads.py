"""Contact forces are assigned to the right pixels."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bridges.mujoco.tests.lying import PALM, UP, WEIGHT_N, contact_n, lying

from palpate.errors import InputError
from palpate_mujoco import PadSensor


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


def test_pad_centre_shifts_pixels_on_geom() -> None:
    load_n = lying(replace(UP, centre_mm=(-5.0, 10.0, 1.0))).load_n
    assert load_n[1, 0] == pytest.approx(WEIGHT_N, rel=1e-3)


def test_contact_on_other_geom_is_not_measured() -> None:
    sensor = lying(replace(UP, geom="table"))
    assert contact_n(sensor) > 1.0
    assert not sensor.load_n.any()


def test_unknown_geom_and_wrong_number_of_pads_are_refused() -> None:
    with pytest.raises(InputError, match=r"no geom 'palm'; available: table, pad"):
        lying(replace(UP, geom="palm"))
    sensor = lying()
    with pytest.raises(InputError, match=r"has 1 finger\(s\) and 2 pad\(s\)"):
        PadSensor(sensor.model, sensor.data, pads=[UP, UP], layout=PALM, seed=1)
