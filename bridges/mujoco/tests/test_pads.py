"""Contacts become newtons on the right pixels."""

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
    "thing",
    [
        {"shape": "sphere", "size": "0.01"},
        {"shape": "sphere", "size": "0.01", "at_mm": (19.0, -19.0)},
        {"shape": "box", "size": "0.012 0.012 0.012"},
        {"shape": "box", "size": "0.004 0.03 0.01", "at_mm": (-6.0, 3.0)},
    ],
)
def test_the_pad_carries_what_mujoco_presses_on_it(thing: dict[str, Any], cone: str) -> None:
    sensor = lying(**thing, cone=cone)
    assert sensor.load_n.sum() == pytest.approx(contact_n(sensor), rel=1e-9)
    assert sensor.load_n.sum() == pytest.approx(WEIGHT_N, rel=1e-3)
    assert sensor.finger_n.tolist() == pytest.approx([sensor.load_n.sum()])


@pytest.mark.parametrize("row", range(PALM.rows))
@pytest.mark.parametrize("col", range(PALM.cols))
def test_a_ball_on_a_pixel_loads_that_pixel_alone(row: int, col: int) -> None:
    load_n = lying(at_mm=(10.0 * (row - 0.5), 10.0 * (col - 1))).load_n.copy()
    assert load_n[row, col] == pytest.approx(WEIGHT_N, rel=1e-3)
    load_n[row, col] = 0.0
    assert np.abs(load_n).max() < 1e-6


def test_a_ball_between_two_pixels_loads_both_alike() -> None:
    load_n = lying(at_mm=(5.0, 5.0)).load_n
    assert load_n[1, 1] == pytest.approx(0.5 * WEIGHT_N, rel=1e-3)
    assert load_n[1, 2] == pytest.approx(0.5 * WEIGHT_N, rel=1e-3)


def test_a_block_loads_the_pixels_under_it_by_its_place() -> None:
    load_n = lying(shape="box", size="0.003 0.004 0.01", at_mm=(-5.0, -10.0)).load_n
    assert load_n.argmax() == 0
    assert load_n[0, 0] > 0.6 * WEIGHT_N


def test_the_sheet_may_lie_off_the_middle_of_its_geom() -> None:
    load_n = lying(replace(UP, centre_mm=(-5.0, 10.0, 1.0))).load_n
    assert load_n[1, 0] == pytest.approx(WEIGHT_N, rel=1e-3)


def test_what_presses_elsewhere_is_not_felt() -> None:
    sensor = lying(replace(UP, geom="table"))
    assert contact_n(sensor) > 1.0
    assert not sensor.load_n.any()


def test_a_pad_that_is_not_there_is_refused_by_name() -> None:
    with pytest.raises(InputError, match=r"no geom 'palm'; available: table, pad"):
        lying(replace(UP, geom="palm"))


def test_each_finger_needs_a_pad() -> None:
    sensor = lying()
    with pytest.raises(InputError, match=r"has 1 finger\(s\) and 2 pad\(s\)"):
        PadSensor(sensor.model, sensor.data, pads=[UP, UP], layout=PALM, seed=1)
