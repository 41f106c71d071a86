"""The press check with correct wiring, swapped wires and dead pixels."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.sensor.array import RIGID_LAYOUT
from palpate.sensor.findings import Finding
from palpate.sensor.press_order import PressMonitor, order_findings

Pixel = tuple[int, int]
REST_OHM = 8e3 * np.exp(np.random.default_rng(1).normal(0, 0.2, (4, 2)))


def press_all(
    wiring: Callable[[Pixel], Pixel],
    *,
    unresponsive: Pixel | None = None,
    rest_ohm: np.ndarray = REST_OHM,
) -> list[Finding]:
    """Press each requested pixel, with load on adjacent pixels and creep, at 50 Hz."""
    monitor = PressMonitor(rest_ohm, timeout_s=5.0)
    rng = np.random.default_rng(2)
    load, creep = np.zeros((4, 2)), np.zeros((4, 2))
    touch_s = 0.0
    for k in range(20_000):
        time_s = 0.02 * k
        if monitor.is_done:
            break
        if monitor.next_pixel is None or monitor.next_pixel == unresponsive:
            load[:] = 0.0
            touch_s = time_s
        elif time_s - touch_s > 0.6:
            load[:] = 0.3
            load[wiring(monitor.next_pixel)] = 2.0
        creep += 0.02 / 2.0 * (2.0 * load - creep)
        ohm = rest_ohm / (1.0 + load + creep) * rng.normal(1.0, 0.004, (4, 2))
        monitor.add_frame(time_s, ohm)
    assert monitor.is_done
    return order_findings(monitor.presses, layout=RIGID_LAYOUT)


def summarize(findings: list[Finding]) -> list[tuple[str, str, str]]:
    return [(found.code, found.where, found.text) for found in findings]


ROWS = {0: 2, 2: 0, 1: 1, 3: 3}
CROSSED = {(1, 0): (3, 1), (3, 1): (1, 0)}


@pytest.mark.parametrize(
    ("wiring", "found"),
    [
        (lambda pixel: pixel, []),
        (
            lambda pixel: (ROWS[pixel[0]], pixel[1]),
            [("row R0", "answers as row R2"), ("row R2", "answers as row R0")],
        ),
        (
            lambda pixel: (pixel[0], 1 - pixel[1]),
            [("column C0", "answers as column C1"), ("column C1", "answers as column C0")],
        ),
        (
            lambda pixel: CROSSED.get(pixel, pixel),
            [("R1 C0", "answers as R3 C1"), ("R3 C1", "answers as R1 C0")],
        ),
    ],
    ids=["correct", "rows", "columns", "pixels"],
)
def test_press_check_reports_swapped_wires(
    wiring: Callable[[Pixel], Pixel], found: list[tuple[str, str]]
) -> None:
    assert summarize(press_all(wiring)) == [("swapped", *one) for one in found]


def test_press_check_reports_an_unresponsive_pixel_as_silent() -> None:
    assert summarize(press_all(lambda pixel: pixel, unresponsive=(2, 1))) == [
        ("silent", "R2 C1", "did not respond when pressed")
    ]


def test_press_that_raises_the_resistance_ends_the_check_at_once() -> None:
    monitor = PressMonitor(np.full((2, 1), 3e3), timeout_s=5.0)
    for number in range(40):
        pressed = 12e3 if number >= 20 else 3e3
        monitor.add_frame(0.05 * number, np.array([[3e3], [pressed]]))
    assert monitor.has_risen
    assert not monitor.presses
