"""Creep of a sheet from its own calibration."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.estimate.sheet_creep import SheetCreep
from palpate.measurement import Measurement

CREEP = SheetCreep(log_mean=0.2, log_sd=0.02, early_s=0.4, settled_s=20.0)


def said(value: float, *, half: float = 0.2) -> Measurement:
    return Measurement(value=value, low=value * (1 - half), high=value * (1 + half), unit="reading")


def test_sheet_creep_fit_is_robust_to_outlier() -> None:
    early = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.1])
    settled = early * np.exp([0.2, 0.21, 0.19, 0.2, 0.22, 0.18, 1.5])
    creep = SheetCreep.fit(early, settled=settled, early_s=0.4, settled_s=20.0)
    assert creep.log_mean == pytest.approx(0.2)
    assert creep.log_sd < 0.03


def test_sheet_creep_fit_with_too_few_holds_returns_none() -> None:
    four = np.arange(1.0, 5.0)
    assert SheetCreep.fit(four, settled=four, early_s=0.4, settled_s=20.0) is None
    dead = np.array([1.0, 2.0, 3.0, 4.0, 0.0, 0.0])
    assert SheetCreep.fit(dead, settled=dead + 1.0, early_s=0.4, settled_s=20.0) is None


def test_sheet_creep_remaining_creep_falls_with_time() -> None:
    vague = said(1.0, half=0.9)
    found = [CREEP.combine(vague, now=1.0, since_s=t) for t in (0.2, 0.4, 1.0, 5.0, 20.0, 60.0)]
    values = [one.value for one in found]
    assert values[0] == values[1]
    assert values == sorted(values, reverse=True)
    assert values[1] == pytest.approx(math.exp(0.2), rel=0.03)
    assert values[-1] == pytest.approx(1.0, abs=1e-3)
    widths = [one.high - one.low for one in found]
    assert widths == sorted(widths, reverse=True)


def test_sheet_creep_combine_is_between_with_smaller_uncertainty() -> None:
    sharp = CREEP.combine(said(1.0, half=0.01), now=1.0, since_s=1.0)
    vague = CREEP.combine(said(1.0, half=0.5), now=1.0, since_s=1.0)
    assert 1.0 < sharp.value < vague.value < math.exp(0.2)
    assert (sharp.high - sharp.low) / 2 == pytest.approx(0.01, rel=0.01)
    assert (vague.high - vague.low) / 2 < 0.25
