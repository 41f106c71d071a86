"""Force as a sum over pixels, its error on held-out placements, and creep of the sheet."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.estimate.pixel_law import PixelForceLaw, PlacementReadings, fit_laws
from palpate.estimate.sheet_creep import SheetCreep
from palpate.estimate.weights_check import score_held_out_placements
from palpate.measurement import Measurement


def placed(rows: list[tuple[int, bool, float, np.ndarray]]) -> PlacementReadings:
    """Return readings from run, whether early, force and excess of each pixel."""
    run, early, force_n, pixel_excess = map(np.array, zip(*rows, strict=True))
    return PlacementReadings(
        run=run.astype(float), pixel_excess=pixel_excess, force_n=force_n, early=early
    )


def test_pixel_law_force_is_independent_of_load_distribution() -> None:
    """Seven placements on one to four pixels; x = 0.3 F**1.4, settled 20 % more."""
    rng, rows = np.random.default_rng(0), []
    for run in range(7):
        touched = rng.permutation(4) < 1 + run % 4
        for force_n in np.geomspace(0.5, 10, 12):
            excess = 0.3 * np.where(touched, force_n / touched.sum(), 0.0) ** 1.4
            rows += [(run, True, force_n, excess), (run, False, force_n, 1.2 * excess)]
    reading, *laws = fit_laws(placed(rows))
    for count in (1, 2, 4):
        excess = np.where(np.arange(4) < count, 0.3 * (4.0 / count) ** 1.4, 0.0)[None, :]
        for law, factor in zip(laws, (1.0, 1.2), strict=True):
            found = float(law.force_n(reading.reading(factor * excess)).value)
            assert found == pytest.approx(4.0, rel=0.06)


def test_pixel_law_zero_reading_has_upper_limit() -> None:
    law = PixelForceLaw(
        log_scale=0.0, exponent=1.0, residual_sd=0.1, floor_n=0.3, range=(0.3, 10.0)
    )
    nothing = law.force_n(0.0)
    assert nothing.value == nothing.low == 0.0
    assert 0.4 < nothing.high < 0.6


# -- held-out placements ---------------------------------------------------------------------------


def placements(gains: list[float], *, reach_n: tuple[float, ...]) -> PlacementReadings:
    """Return early and settled readings of placements, each up to its largest force."""
    return placed(
        [
            (run, early, n, (1.0 if early else 1.3) * gain * n * np.array([0.6, 0.4]))
            for run, (gain, most_n) in enumerate(zip(gains, reach_n, strict=True))
            for early in (True, False)
            for n in np.geomspace(0.5, most_n, 8)
        ]
    )


def test_held_out_error_includes_all_placements() -> None:
    gains = [1.0, 1.02, 1.4, 0.7, 1.35, 0.72]
    found = score_held_out_placements(placements(gains, reach_n=(10.0, 10.0, 4.0, 4.0, 4.0, 4.0)))
    for kind in ("early", "settled"):
        assert 25 < found[kind]["10_n"] < 60


def test_held_out_error_of_an_unreached_force_or_two_placements_is_none() -> None:
    found = score_held_out_placements(placements([1.0, 1.1, 0.9] * 2, reach_n=(4.0,) * 6))
    assert found["settled"]["10_n"] is None
    assert found["settled"]["1_n"] is not None
    two = score_held_out_placements(placements([1.0, 1.1], reach_n=(12.0, 12.0)))
    assert set(two["early"].values()) == {None}


# -- creep -----------------------------------------------------------------------------------------

CREEP = SheetCreep(log_mean=0.2, log_sd=0.02, early_s=0.4, settled_s=20.0)


def settled(now: float, *, half: float, since_s: float) -> Measurement:
    """Combine the creep with a prediction of 1, known to `half`."""
    said = Measurement(value=1.0, low=1 - half, high=1 + half, unit="reading")
    return CREEP.combine(said, now=now, since_s=since_s)


def test_sheet_creep_fit_is_robust_to_outlier_and_needs_five_holds() -> None:
    early = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.1])
    late = early * np.exp([0.2, 0.21, 0.19, 0.2, 0.22, 0.18, 1.5])
    creep = SheetCreep.fit(early, settled=late, early_s=0.4, settled_s=20.0)
    assert creep.log_mean == pytest.approx(0.2)
    assert creep.log_sd < 0.03
    for few in (early[:4], np.array([1.0, 2.0, 3.0, 4.0, 0.0, 0.0])):
        assert SheetCreep.fit(few, settled=few + 1.0, early_s=0.4, settled_s=20.0) is None
