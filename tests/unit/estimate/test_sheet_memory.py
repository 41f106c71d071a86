"""Terms of the sheet observer: readings that add up, a law that rises, memory of movements."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.estimate.observer_fit import least_absolute
from palpate.estimate.sheet_memory import SUMMED, SheetMemory, SheetReading, stretches
from palpate.estimate.sheet_reading_fit import best_reading
from palpate.sensor.load_traces import LoadTraces


def test_reading_does_not_depend_on_how_the_load_spreads() -> None:
    """Pixels that answer with the square of their load above a threshold of 0.2."""
    placements = []
    for run in range(6):
        share = (np.arange(4) <= run % 4) / (1 + run % 4)
        force = np.tile(np.geomspace(1.2, 10, 30), 2)
        excess = np.maximum(force[:, None] * share - 0.2, 0.0) ** 2
        placements.append(
            LoadTraces(
                run=np.full(60, run),
                time_s=np.arange(60) / 15,
                excess=excess,
                width_mm=np.full(60, 40.0),
                current_ma=np.full(60, np.nan),
                force_n=force,
            )
        )
    reading = best_reading(placements)
    assert reading.exponent == 0.5
    # More than 0.2: a pixel that is barely touched counts less than one.
    assert 0.15 < reading.touch < 0.5
    one, four = reading.of([9.8**2, 0, 0, 0]), reading.of([2.3**2] * 4)
    assert float(one) == pytest.approx(float(four), rel=0.05)


def test_law_of_stretches_rises_and_goes_on_in_a_line() -> None:
    rng = np.random.default_rng(2)
    log_reading = rng.uniform(-1, 3, 400)
    target = np.tanh(log_reading) + 0.3 * rng.standard_normal(400) - 0.02 * log_reading**2
    knots = (-0.2, 0.8, 1.6, 2.5)
    design = np.column_stack([np.ones(400), stretches(log_reading, knots)])
    weights = least_absolute(design, target, np.ones(400), rising=slice(1, 6))
    far = np.linspace(-6, 9, 200)
    law = np.column_stack([np.ones(200), stretches(far, knots)]) @ weights
    assert np.all(np.diff(law) >= -1e-9)
    assert np.diff(law[-20:], 2) == pytest.approx(np.zeros(18), abs=1e-9)


def test_without_bounds_the_fit_is_the_plain_one() -> None:
    rng = np.random.default_rng(3)
    design, truth = rng.standard_normal((60, 3)), np.array([1.0, -2.0, 0.5])
    found = least_absolute(design, design @ truth, np.ones(60))
    kept = least_absolute(design, design @ truth, np.ones(60), rising=slice(0, 2))
    assert found == pytest.approx(truth, abs=0.01)
    assert kept[1] == 0.0


def test_opening_leaves_slack_and_closing_takes_it_up() -> None:
    memory = SheetMemory(SUMMED, knots=(0.0,), time_constants_s=(1.0,))
    widths = [40.0, 40.3, 41.5, 41.0]
    slack = [
        float(memory.step(0.2 * k, [1.0, 1.0], width_mm=width)[-1])
        for k, width in enumerate(widths)
    ]
    assert slack == pytest.approx([0.0, 0.3, 0.5, 0.0])
    assert memory.way == 1


def test_a_width_that_is_not_known_teaches_no_movement() -> None:
    memory = SheetMemory(
        SheetReading(exponent=0.8, touch=0.1), knots=(0.0,), time_constants_s=(1.0,)
    )
    memory.step(0.0, [1.0], width_mm=float("nan"))
    assert memory.step(0.1, [5.0], width_mm=float("nan"))[-2:].tolist() == [0.0, 0.0]
    assert memory.way == 0
