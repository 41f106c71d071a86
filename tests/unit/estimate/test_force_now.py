"""Present force at every frame: selection of the law, and interval."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.estimate.force_follower import ForceFollower
from palpate.estimate.force_law import ForceLaw
from palpate.estimate.force_now import ContactGains, ForceLaws, ForceNow
from palpate.estimate.gain import Gain
from palpate.estimate.pixel_law import PixelForceLaw, PixelReading


def law(log_scale: float) -> PixelForceLaw:
    return PixelForceLaw(
        log_scale=log_scale, exponent=1.0, residual_sd=0.05, floor_n=0.01, range=(0.1, 50.0)
    )


@pytest.fixture
def follower() -> ForceNow:
    # Settled, the sheet reads a quarter more for the same force.
    laws = ForceLaws(PixelReading.sum_pixels(), early=law(0.0), settled=law(-math.log(1.25)))
    return ForceNow(laws, early_s=0.4, settled_s=20.0)


def test_force_now_of_creeping_reading_is_constant(follower: ForceNow) -> None:
    follower.step(0.0, [[0.0]])
    for time_s in np.arange(0.02, 30.0, 0.02):
        since = max(time_s - 1.0, 0.4)
        creep = 1.25 ** (math.log(min(since, 20.0) / 0.4) / math.log(50.0))
        said = follower.step(float(time_s), [[4.0 * creep if time_s > 1.0 else 0.0]])
        if time_s > 2.0:
            # The step is felt for a few copies of the reading after it came to rest.
            assert said.value == pytest.approx(4.0, rel=0.12)
            assert said.low < 4.0 < said.high
    assert said.value == pytest.approx(4.0, rel=0.01)


def test_force_now_interval_covers_both_laws_until_settled(follower: ForceNow) -> None:
    width = {}
    for time_s in np.arange(0.0, 40.0, 0.02):
        said = follower.step(float(time_s), [[5.0]])
        width[round(float(time_s), 2)] = said.high - said.low
    assert width[5.0] > 1.5 * width[39.0]


def test_force_now_ignores_pixel_without_reading(follower: ForceNow) -> None:
    said = follower.step(0.0, [[2.0, math.nan]])
    assert said.value == pytest.approx(2.0)
    assert said.unit == "n"


def test_force_now_with_memory_is_between_both_laws() -> None:
    memory = ForceLaw.fit([4.0, 15.0, 40.0], force_n=[1.5, 4.0, 9.0])
    laws = ForceLaws(PixelReading.sum_pixels(), early=law(0.0), settled=law(0.0))
    alone, other = ForceNow(laws, early_s=0.4, settled_s=20.0), ForceFollower(memory)
    both = ForceNow(laws._replace(memory=memory), early_s=0.4, settled_s=20.0)
    for time_s, excess in ((0.0, 0.0), (1.0, 15.0), (2.0, 15.0)):
        grid = [[excess]]
        found = both.step(time_s, grid)
        one, another = alone.step(time_s, grid), other.step(time_s, grid)
    assert found.value == pytest.approx(math.sqrt(one.value * another.value))
    assert another.value < found.value < one.value
    assert found.high / found.low > one.value / another.value


def test_force_now_with_contact_gain_ignores_memory_law() -> None:
    memory = ForceLaw.fit([4.0, 15.0, 40.0], force_n=[1.5, 4.0, 9.0])
    laws = ForceLaws(PixelReading.sum_pixels(), early=law(0.0), settled=law(0.0), memory=memory)
    follower = ForceNow(laws, early_s=0.4, settled_s=20.0)
    gain = Gain(log_mean=math.log(2.0), log_sd=0.05, law_sd=0.05)
    follower.gains = ContactGains(early=gain, settled=gain)
    assert follower.step(0.0, [[5.0]]).value == pytest.approx(10.0)


def test_force_now_with_memory_without_contact_is_zero() -> None:
    memory = ForceLaw.fit([4.0, 15.0, 40.0], force_n=[1.5, 4.0, 9.0])
    laws = ForceLaws(PixelReading.sum_pixels(), early=law(0.0), settled=law(0.0), memory=memory)
    found = ForceNow(laws, early_s=0.4, settled_s=20.0).step(0.0, [[0.0]])
    assert (found.value, found.low) == (0.0, 0.0)
