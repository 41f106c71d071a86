"""Servo current beside a sheet: friction along the way, from movement to movement, and at rest."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.estimate.creep import FloatArray
from palpate.estimate.gear_friction import GearFriction
from palpate.estimate.sheet_current import Current, current_from_dict, fit_line

MA_PER_N, GEAR_MA = 14.0, 40.0
#: Gears that take a fifth more or less along 8 mm.
WIDTHS_MM = np.arange(30.0, 60.0, 0.5)
ALONG = GearFriction(
    mean_ma=GEAR_MA,
    mean_sd_ma=1.0,
    movement_ma=4.0,
    along_mm=tuple(WIDTHS_MM.tolist()),
    along_ma=tuple((0.2 * GEAR_MA * np.sin(WIDTHS_MM * 2 * np.pi / 8.0)).tolist()),
)


@dataclass(frozen=True)
class Movements:
    """Steps of a millimetre between dwells, five frames each."""

    current_ma: FloatArray
    width_mm: FloatArray
    force_n: FloatArray
    still: NDArray[np.bool_]
    stop: NDArray[np.int64]
    way: NDArray[np.int64]


def steps(seed: int, *, scatter: float, rippled: bool = False) -> Movements:
    """Six closings and six openings in turn, with friction of another size in each."""
    rng, rows, width_mm = np.random.default_rng(seed), list[tuple[float, ...]](), 48.0
    for number in range(60):
        way = 1 if number % 12 < 6 else -1
        friction_ma = GEAR_MA * np.exp(scatter * rng.standard_normal())
        resting = rng.uniform(-1, 1)
        for frame in range(10):
            moving = frame < 5
            width_mm -= 0.2 * way * moving
            force_n = 6.0 + 2.0 * (48.0 - width_mm) + 3.0 * np.sin(number)
            ripple = 0.2 * np.sin(width_mm * 2 * np.pi / 8.0) if rippled else 0.0
            held = way * (1 + ripple) if moving else resting
            read_ma = MA_PER_N * force_n + held * friction_ma + 2.0 * rng.standard_normal()
            rows.append((read_ma, width_mm, force_n, not moving, number, way * moving))
    columns = np.array(rows).T
    return Movements(
        current_ma=columns[0],
        width_mm=columns[1],
        force_n=columns[2],
        still=columns[3].astype(bool),
        stop=columns[4].astype(int),
        way=columns[5].astype(int),
    )


def test_the_scatter_of_movements_is_told_as_a_share_of_the_friction() -> None:
    line = fit_line([steps(1, scatter=0.2)])
    assert line is not None
    assert line.gear_ma == pytest.approx(GEAR_MA, rel=0.1)
    assert line.gear_scatter == pytest.approx(0.2, rel=0.3)
    plain = fit_line([steps(1, scatter=0.0)])
    assert plain is not None
    assert plain.gear_scatter < 0.05


def test_what_an_empty_hand_showed_of_the_way_makes_readings_on_it_better() -> None:
    run = steps(2, scatter=0.0, rippled=True)
    moving = run.way != 0
    errors = []
    for gears in (None, ALONG):
        line = fit_line([run], gears=gears)
        assert line is not None
        told_n = line.force_n(run.current_ma, way=run.way, width_mm=run.width_mm)
        errors.append(np.std((told_n - run.force_n)[moving]))
    assert errors[1] < 0.6 * errors[0]


def test_an_opening_is_believed_less_than_a_closing() -> None:
    line = Current(
        zero_ma=0.0,
        ma_per_n=14.0,
        gear_ma=40.0,
        gear_share=0.2,
        sd_n=0.4,
        stuck_n=2.0,
        stuck_share=0.1,
        gear_scatter=0.1,
    )
    closing, opening = line.way_sd_n(5.0, way=1), line.way_sd_n(5.0, way=-1)
    assert opening == pytest.approx(1.5 * closing)
    assert current_from_dict(asdict(line)) == line


def test_beyond_what_the_empty_hand_showed_friction_is_the_usual() -> None:
    line = fit_line([steps(3, scatter=0.0)], gears=ALONG)
    assert line is not None
    assert line.friction([10.0, 90.0, np.nan]).tolist() == [1.0, 1.0, 1.0]
    assert line.friction(34.0) == pytest.approx(1.0 + 0.2 * np.sin(34.0 * 2 * np.pi / 8.0))


def test_gears_without_friction_do_not_break_the_fit() -> None:
    run = steps(4, scatter=0.0)
    free = Movements(
        MA_PER_N * run.force_n, run.width_mm, run.force_n, run.still, run.stop, run.way
    )
    line = fit_line([free])
    assert line is not None
    assert line.way_sd_n(5.0, way=1) < 0.01
