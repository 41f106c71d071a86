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
        {"shape": "sphere", "size": "0.01"},
        {"shape": "sphere", "size": "0.01", "at_mm": (19.0, -19.0)},
        {"shape": "box", "size": "0.012 0.012 0.012"},
        {"shape": "box", "size": "0.004 0.03 0.01", "at_mm": (-6.0, 3.0)},
    ],
)
def test_pad_load_equals_mujoco_contact_force(weight: dict[str, Any], cone: str) -> None:
    sensor = lying(**weight, cone=cone)
    assert sensor.load_n.sum() == pytest.approx(contact_n(sensor), rel=1e-9)
    assert sensor.load_n.sum() == pytest.approx(WEIGHT_N, rel=1e-3)
    assert sensor.finger_n.tolist() == pytest.approx([sensor.load_n.sum()])


@pytest.mark.parametrize("row", range(PALM.rows))
@pytest.mark.parametrize("col", range(PALM.cols))
def test_ball_on_pixel_loads_only_that_pixel(row: int, col: int) -> None:
    load_n = lying(at_mm=(10.0 * (row - 0.5), 10.0 * (col - 1))).load_n.copy()
    assert load_n[row, col] == pytest.approx(WEIGHT_N, rel=1e-3)
    load_n[row, col] = 0.0
    assert np.abs(load_n).max() < 1e-6


def test_ball_between_pixels_loads_both_equally() -> None:
    load_n = lying(at_mm=(5.0, 5.0)).load_n
    assert load_n[1, 1] == pytest.approx(0.5 * WEIGHT_N, rel=1e-3)
    assert load_n[1, 2] == pytest.approx(0.5 * WEIGHT_N, rel=1e-3)


def test_block_loads_mostly_the_pixel_below() -> None:
    load_n = lying(shape="box", size="0.003 0.004 0.01", at_mm=(-5.0, -10.0)).load_n
    assert load_n.argmax() == 0
    assert load_n[0, 0] > 0.6 * WEIGHT_N


def test_pad_centre_shifts_pixels_on_geom() -> None:
    load_n = lying(replace(UP, centre_mm=(-5.0, 10.0, 1.0))).load_n
    assert load_n[1, 0] == pytest.approx(WEIGHT_N, rel=1e-3)


def test_contact_on_other_geom_is_not_measured() -> None:
    sensor = lying(replace(UP, geom="table"))
    assert contact_n(sensor) > 1.0
    assert not sensor.load_n.any()


def test_unknown_pad_geom_is_refused_with_its_name() -> None:
    with pytest.raises(InputError, match=r"no geom 'palm'; available: table, pad"):
        lying(replace(UP, geom="palm"))


def test_wrong_number_of_pads_is_refused() -> None:
    sensor = lying()
    with pytest.raises(InputError, match=r"has 1 finger\(s\) and 2 pad\(s\)"):
        PadSensor(sensor.model, sensor.data, pads=[UP, UP], layout=PALM, seed=1)
