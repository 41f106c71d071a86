"""Rest baseline, equation 1 of the paper, sums over pixels, and the window of a hold."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.errors import CalibrationError, NoiseError
from palpate.sensor.array import ArrayLayout
from palpate.sensor.rest_baseline import rest_baseline
from palpate.sensor.sample import (
    SampleReader,
    relative_change_percent,
)
from palpate.signal.relative import mean_change, total_excess
from palpate.signal.transient import find_hold_window

PIXELS = np.array([[1e4, 2e4], [1.5e4, 8e3]])
PAD = ArrayLayout(name="pad", rows=2, cols=2, finger_of_row=(0, 0))


def make_quiet_frames(frames: int = 60, *, seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(scale=0.002, size=(frames, 2, 2))
    return PIXELS * (1 + noise)


def test_rest_baseline_of_quiet_frames_equals_the_true_values() -> None:
    rest = rest_baseline(make_quiet_frames(200))
    np.testing.assert_allclose(rest.rest_ohm, PIXELS, rtol=1e-3)
    np.testing.assert_allclose(rest.spread_percent, 0.2, rtol=0.3)
    assert rest.frames == 200


def test_rest_baseline_ignores_single_outliers() -> None:
    ohm = make_quiet_frames()
    spoiled = ohm.copy()
    spoiled[[5, 40], 0, 1] *= 3.0
    np.testing.assert_allclose(
        rest_baseline(spoiled).rest_ohm, rest_baseline(ohm).rest_ohm, rtol=5e-4
    )


#: A finger that moves once.
SPIKE = np.zeros((60, 1, 1))
SPIKE[28:32, 0, 0] = (0.2, 0.15, 0.1, 0.05)


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        (make_quiet_frames() * (1 - 0.05 * np.exp(-np.arange(60) / 30))[:, None, None], "settling"),
        (make_quiet_frames() * (1 + SPIKE), "jumped"),
        (make_quiet_frames(4), "at least 5"),
        (PIXELS, "at least 5"),
        (np.full((10, 2, 2), np.inf), "no valid pixel"),
    ],
)
def test_rest_baseline_of_unrest_too_few_frames_or_dead_pixels_raises(
    frames: np.ndarray, message: str
) -> None:
    with pytest.raises(CalibrationError, match=message):
        rest_baseline(frames)


SHEET = np.full((4, 2), 5e4)


def make_frames(
    noise: float, *, seconds: float, touch_percent: float = 0.0, touch_s: float = 1.0, seed: int = 0
) -> np.ndarray:
    """Return 60 frames a second of eight pixels with white noise, touched in the middle."""
    rng, n, touched = np.random.default_rng(seed), int(60 * seconds), int(60 * touch_s)
    common = np.ones(n)
    common[n // 2 : n // 2 + touched] -= 0.01 * touch_percent
    return SHEET * common[:, None, None] * rng.normal(1.0, noise, (n, 4, 2))


@pytest.mark.parametrize("seconds", [1.0, 5.0, 20.0])
def test_rest_baseline_noise_is_no_touch_however_long_it_is_measured(seconds: float) -> None:
    for seed in range(20):
        rest = rest_baseline(make_frames(0.03, seconds=seconds, seed=seed))
        np.testing.assert_allclose(rest.rest_ohm, SHEET, rtol=0.02)


@pytest.mark.parametrize(
    ("noise", "touch_percent", "touch_s"),
    [(0.001, 3.0, 1.0), (0.03, 3.0, 1.0), (0.001, 3.0, 0.05), (0.03, 9.0, 0.05)],
)
@pytest.mark.parametrize("seconds", [5.0, 20.0])
def test_rest_baseline_touch_is_refused_with_and_without_noise(
    noise: float, touch_percent: float, touch_s: float, seconds: float
) -> None:
    for seed in range(10):
        frames = make_frames(
            noise, seconds=seconds, touch_percent=touch_percent, touch_s=touch_s, seed=seed
        )
        with pytest.raises(CalibrationError, match="jumped"):
            rest_baseline(frames)


def test_rest_baseline_noise_that_hides_a_touch_is_named_as_the_cause() -> None:
    with pytest.raises(NoiseError, match="average more conversions"):
        rest_baseline(make_frames(0.3, seconds=2.0))


def test_rest_baseline_with_known_values_raises_for_a_steady_load() -> None:
    loaded = make_quiet_frames() * 0.6
    assert rest_baseline(loaded).frames == 60
    with pytest.raises(CalibrationError, match="there is a load"):
        rest_baseline(loaded, known_ohm=PIXELS)
    assert rest_baseline(make_quiet_frames() * 0.95, known_ohm=PIXELS).frames == 60


def test_dead_pixel_is_ignored_in_the_sums_over_pixels() -> None:
    ohm = make_quiet_frames()
    ohm[:, 0, 0] = np.inf
    rest = rest_baseline(ohm)
    assert np.isnan(rest.rest_ohm[0, 0])
    change = relative_change_percent(PIXELS / 2, rest_ohm=rest.rest_ohm)
    assert np.isnan(change[0, 0])
    assert mean_change(change) == pytest.approx(-50.0, abs=0.1)
    excess = SampleReader(PAD, rest.rest_ohm).read_ohm(PIXELS / 2).excess
    assert total_excess(excess) == pytest.approx(3.0, abs=0.02)


def test_find_hold_window_starts_the_wait_after_the_peak_of_each_hold() -> None:
    time_s = np.arange(10) / 10
    values = np.stack([-time_s, np.where(time_s < 0.2, 0, 1 - time_s)])
    window = find_hold_window(time_s, values, wait_s=0.5)
    assert window.peak_s.tolist() == [0.0, 0.2]
    assert window.first.tolist() == [5, 7]
