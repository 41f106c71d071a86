"""Force as a sum over pixels: independent of load spread, uncertain by placement."""

from __future__ import annotations

import numpy as np

from palpate.estimate.pixel_law import PixelForceLaw, PlacementReadings, fit_laws


def sheet(gain_sd: float, *, seed: int = 0) -> PlacementReadings:
    """Seven placements on one to four pixels; x = 0.3 F**1.4, settled 20 % more."""
    rng = np.random.default_rng(seed)
    rows = []
    for run in range(7):
        touched = rng.permutation(4) < 1 + run % 4
        gain = np.exp(gain_sd * rng.standard_normal())
        for force_n in np.geomspace(0.5, 10, 12):
            load = np.where(touched, force_n / touched.sum(), 0.0)
            excess = gain * 0.3 * load**1.4
            rows.append((run, excess, force_n, True))
            rows.append((run, 1.2 * excess, force_n, False))
    run, excess, force_n, early = zip(*rows, strict=True)
    return PlacementReadings(
        run=np.array(run, dtype=float),
        pixel_excess=np.array(excess),
        force_n=np.array(force_n),
        early=np.array(early),
    )


def test_pixel_law_force_is_independent_of_load_distribution() -> None:
    reading, early, settled = fit_laws(sheet(0.0))
    for touched in (1, 2, 4):
        excess = np.where(np.arange(4) < touched, 0.3 * (4.0 / touched) ** 1.4, 0.0)[None, :]
        assert abs(float(early.force_n(reading.reading(excess)).value) / 4.0 - 1) < 0.06
        later = reading.reading(1.2 * excess)
        assert abs(float(settled.force_n(later).value) / 4.0 - 1) < 0.06


def test_pixel_law_exponent_is_independent_of_placement_scatter() -> None:
    rng = np.random.default_rng(1)
    force_n = np.tile(np.geomspace(0.5, 8, 12), 40)
    run = np.repeat(np.arange(40), 12)
    reading = np.exp(0.4 * rng.standard_normal(40))[run] * (force_n / 2.0) ** (1 / 1.2)
    law = PixelForceLaw.fit(reading, force_n=force_n, run=run)
    assert abs(law.exponent - 1.2) < 0.03
    assert abs(float(law.force_n(1.0).value) / 2.0 - 1) < 0.1


def test_pixel_law_zero_reading_has_upper_limit() -> None:
    law = PixelForceLaw(
        log_scale=0.0, exponent=1.0, residual_sd=0.1, floor_n=0.3, range=(0.3, 10.0)
    )
    nothing = law.force_n(0.0)
    assert nothing.value == nothing.low == 0.0
    assert 0.4 < nothing.high < 0.6


def test_pixel_law_always_rises() -> None:
    law = PixelForceLaw.fit(
        [1.0, 1.5, 2.0, 2.5, 3.0], force_n=[9.0, 5.0, 4.0, 2.0, 1.0], run=[0] * 5
    )
    faint, strong = law.force_n([0.0, 6.0]).value
    assert faint == 0.0
    assert 0.0 < strong < np.inf
    assert law.exponent == 0.5
