"""`DeviceClock`: host times of frames from their arrival times."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from palpate.sensor.device_clock import DeviceClock

Floats = NDArray[np.float64]


def convert(device_s: Floats, arrival_s: Floats, clock: DeviceClock | None = None) -> Floats:
    clock = clock or DeviceClock()
    pairs = zip(device_s, arrival_s, strict=True)
    return np.array([clock.convert_burst([float(d)], arrival_s=float(a))[0] for d, a in pairs])


def test_device_clock_with_jittered_arrivals_is_accurate_to_one_millisecond() -> None:
    rng = np.random.default_rng(0)
    device_s = np.arange(15_000) * 0.004
    scanned_s = 50.0 + device_s * 1.003
    arrival_s = np.maximum.accumulate(scanned_s + 0.001 + rng.exponential(0.004, len(device_s)))
    error_s = convert(device_s, arrival_s) - scanned_s - 0.001
    assert np.abs(error_s[2500:]).max() < 1e-3


def test_device_clock_is_unaffected_by_a_host_stall() -> None:
    device_s = np.arange(10_000) * 0.004
    arrival_s = 50.0 + device_s
    stalled = (device_s > 20) & (device_s < 25)
    arrival_s[stalled] = 75.0
    assert convert(device_s, arrival_s) == pytest.approx(50.0 + device_s, abs=1e-6)


@settings(max_examples=50)
@given(seed=st.integers(0, 10_000), drift=st.floats(-0.005, 0.005))
@example(seed=2671, drift=-0.0029250803447855305)
def test_device_clock_times_are_ordered_and_not_after_arrival(seed: int, drift: float) -> None:
    rng = np.random.default_rng(seed)
    device_s = np.cumsum(rng.exponential(0.01, 600))
    delay_s = rng.exponential(0.01, 600) * rng.choice([1, 10], 600)
    arrival_s = np.maximum.accumulate(3.0 + device_s * (1 + drift) + delay_s)
    clock, host_s = DeviceClock(), list[float]()
    for arrived_s in np.unique(arrival_s):
        burst_s = device_s[arrival_s == arrived_s]
        host_s += clock.convert_burst(burst_s.tolist(), arrival_s=float(arrived_s))
    # Where the line was higher before, each frame is a tick of 1 us after the last.
    assert np.all(np.array(host_s) <= arrival_s + 1e-5)
    assert np.all(np.diff(host_s) > 0)


def test_device_clock_frames_of_a_late_burst_keep_the_distances_of_the_board() -> None:
    """The last frame of a burst after 0.1 s shows the delay of all."""
    clock = DeviceClock()
    first_s = clock.convert_burst([0.0], arrival_s=5.003)[0]
    burst_s = clock.convert_burst([0.004 * k for k in range(1, 26)], arrival_s=5.1005)
    assert np.diff(burst_s[1:]) == pytest.approx(0.004)
    assert burst_s[-1] == pytest.approx(5.1005)
    assert first_s < burst_s[0]
