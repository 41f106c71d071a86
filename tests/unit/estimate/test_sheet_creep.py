"""How a sheet's own calibration tells how far it still creeps."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.estimate.measurement import Measurement
from palpate.estimate.sheet_creep import SheetCreep

CREEP = SheetCreep(log_mean=0.2, log_sd=0.02, early_s=0.4, settled_s=20.0)


def said(value: float, *, half: float = 0.2) -> Measurement:
    return Measurement(value=value, low=value * (1 - half), high=value * (1 + half), unit="reading")


def test_the_odd_placement_does_not_count() -> None:
    early = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.1])
    settled = early * np.exp([0.2, 0.21, 0.19, 0.2, 0.22, 0.18, 1.5])
    creep = SheetCreep.fit(early, settled=settled, early_s=0.4, settled_s=20.0)
    assert creep.log_mean == pytest.approx(0.2)
    assert creep.log_sd < 0.03


def test_few_holds_or_dead_ones_tell_nothing() -> None:
    four = np.arange(1.0, 5.0)
    assert SheetCreep.fit(four, settled=four, early_s=0.4, settled_s=20.0) is None
    dead = np.array([1.0, 2.0, 3.0, 4.0, 0.0, 0.0])
    assert SheetCreep.fit(dead, settled=dead + 1.0, early_s=0.4, settled_s=20.0) is None


def test_less_is_left_the_longer_it_was_watched() -> None:
    vague = said(1.0, half=0.9)
    found = [CREEP.combine(vague, now=1.0, since_s=t) for t in (0.2, 0.4, 1.0, 5.0, 20.0, 60.0)]
    values = [one.value for one in found]
    assert values[0] == values[1]
    assert values == sorted(values, reverse=True)
    assert values[1] == pytest.approx(math.exp(0.2), rel=0.03)
    assert values[-1] == pytest.approx(1.0, abs=1e-3)
    widths = [one.high - one.low for one in found]
    assert widths == sorted(widths, reverse=True)


def test_it_lies_between_both_and_is_trusted_as_the_better_of_them() -> None:
    sharp = CREEP.combine(said(1.0, half=0.01), now=1.0, since_s=1.0)
    vague = CREEP.combine(said(1.0, half=0.5), now=1.0, since_s=1.0)
    assert 1.0 < sharp.value < vague.value < math.exp(0.2)
    assert (sharp.high - sharp.low) / 2 == pytest.approx(0.01, rel=0.01)
    assert (vague.high - vague.low) / 2 < 0.25


def test_without_a_reading_there_is_nothing_to_add() -> None:
    nothing = said(0.0)
    assert CREEP.combine(nothing, now=0.0, since_s=1.0) is nothing
