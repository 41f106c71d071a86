"""The hold begins when the loading ends, however slow the loading was."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.unit.holds.test_contacts_on_real_recordings import read_recordings

from palpate.holds.contacts import find_contacts

STEP_S = 0.05


def press_n(
    time_s: np.ndarray, *, begin_s: float, ramp_s: float, end_s: float, power: float = 1.0
) -> np.ndarray:
    """Return the force of a slow press that relaxes by two fifths."""
    since_s = time_s - begin_s
    force = np.clip(since_s / ramp_s, 0.0, 1.0) ** power
    held_s = np.maximum(since_s - ramp_s, 0.0)
    force *= 1.0 - 0.1 * np.log1p(held_s / 0.4)
    force[(since_s < 0) | (time_s > end_s)] = 0.0
    return 8.0 * force


@pytest.mark.parametrize(("ramp_s", "power"), [(1.0, 2.0), (9.0, 1.0)])
@pytest.mark.parametrize("reading", ["newton", "ohm", "counts", None])
def test_hold_after_slow_loading_begins_at_its_end(
    ramp_s: float, power: float, reading: str | None
) -> None:
    time_s = np.arange(0.0, 60.0, STEP_S)
    noise = 0.01 * np.random.default_rng(3).normal(size=time_s.size)
    force_n = press_n(time_s, begin_s=4.0, ramp_s=ramp_s, end_s=40.0, power=power) + noise
    values = {
        "newton": force_n,
        "ohm": 4e4 / (np.maximum(force_n, 0.0) + 0.05),
        "counts": 1023.0 * np.maximum(force_n, 0.0) / (np.maximum(force_n, 0.0) + 3.0),
        None: force_n,
    }[reading]
    [hold] = find_contacts(time_s, values, unit=reading).holds
    assert hold.start_s == pytest.approx(4.0 + ramp_s, abs=0.25)
    assert hold.end_s == pytest.approx(40.0, abs=0.3)


def test_creeping_reading_after_slow_loading_begins_at_its_knee() -> None:
    time_s = np.arange(0.0, 40.0, STEP_S)
    since_s = np.maximum(time_s - 8.0, 0.0)
    load = np.clip((time_s - 4.0) / 4.0, 0.0, 1.0) * (1.0 + 0.02 * np.log1p(since_s / 0.5))
    [hold] = find_contacts(time_s, 1e3 / (load + 0.01), unit="ohm").holds
    assert hold.start_s == pytest.approx(8.0, abs=0.3)


@pytest.mark.parametrize("ramp_s", [2.0, 6.0, 9.0])
@pytest.mark.parametrize("step_s", [STEP_S, 0.5])
@pytest.mark.parametrize(
    ("unit", "full_scale", "digits"), [("counts", 1023, 0), ("volt", 5.0, 3), (None, 4095, 0)]
)
def test_reading_of_a_divider_near_its_supply_begins_at_the_end_of_the_loading(
    unit: str | None, full_scale: float, digits: int, step_s: float, ramp_s: float
) -> None:
    """A fixed resistor to ground, as in most circuits for FSRs: the reading rises ever slower."""
    time_s = np.arange(0.0, 45.0, step_s)
    since_s = time_s - 5.0
    creep = 1.0 + 0.05 * np.log1p(np.maximum(since_s, 0.0) / 0.3)
    load = 1.0 + 33.0 * np.clip(since_s / ramp_s, 0.0, 1.0) ** 0.8 * creep
    load = np.where(time_s > 40.0, 1.0, load)
    load *= np.exp(np.random.default_rng(1).normal(0.0, 1e-3, time_s.size))
    values = np.round(full_scale * load / (load + 2.0), digits)
    [hold] = find_contacts(time_s, values, unit=unit).holds
    assert hold.start_s == pytest.approx(5.0 + ramp_s, abs=0.9)


@pytest.mark.parametrize("period_s", [20.0, 45.0])
def test_slow_waves_are_no_holds(period_s: float) -> None:
    time_s = np.arange(0.0, 90.0, STEP_S)
    wave = 5.0 * (1.0 - np.cos(2.0 * np.pi * time_s / period_s))
    triangle = np.abs((time_s / period_s) % 1.0 - 0.5)
    for values in (wave, 100.0 - wave, 0.5 - triangle):
        assert find_contacts(time_s, values).holds == []


def test_real_slow_tests_begin_at_the_peak_of_the_force(real_data: Path) -> None:
    starts = []
    for one in read_recordings(real_data / "tests_meat.csv.gz", "force_n").values():
        [hold] = find_contacts(one["time_s"], one["force_n"], unit="newton").holds
        starts.append(hold.start_s - one["time_s"][np.argmax(one["force_n"])])
    assert len(starts) == 92
    assert np.abs(starts).max() < 0.05


@pytest.mark.parametrize("step_s", [3.0, 5.0, 8.0])
def test_holds_of_a_slow_logger_stay_within_their_contacts(step_s: float) -> None:
    time_s = np.arange(0.0, 260.0, step_s)
    ohm, contacts_s = np.full(time_s.size, 40_000.0), (10.2, 90.7, 170.4)
    for contact_s in contacts_s:
        held = (time_s >= contact_s) & (time_s < contact_s + 60.0)
        ohm[held] = 4000.0 - 210.0 * np.log1p((time_s[held] - contact_s) / 0.3)
    holds = find_contacts(time_s, ohm, unit="ohm").holds
    assert len(holds) == 3
    for hold, contact_s in zip(holds, contacts_s, strict=True):
        assert contact_s <= hold.start_s < contact_s + 2.0 * step_s
        assert hold.end_s <= contact_s + 60.0
