"""Error of a force calibration on held-out placements."""

from __future__ import annotations

import numpy as np

from palpate.arrays import FloatArray
from palpate.estimate.pixel_law import PlacementReadings
from palpate.estimate.weights_check import score_held_out_placements


def placed(rows: list[tuple[int, bool, float, FloatArray]]) -> PlacementReadings:
    run, early, force_n, pixel_excess = zip(*rows, strict=True)
    return PlacementReadings(
        run=np.array(run, dtype=float),
        pixel_excess=np.array(pixel_excess),
        force_n=np.array(force_n),
        early=np.array(early),
    )


def placements(count: int, *, reach_n: float = 12.0) -> PlacementReadings:
    """Return early and settled readings of placements with a gain scatter of 10 %."""
    rng = np.random.default_rng(4)
    force = np.linspace(0.5, reach_n, 8)
    rows = [
        (run, early, n, gain * (1.0 if early else 1.3) * n * np.array([0.6, 0.4]))
        for run, gain in enumerate(np.exp(rng.normal(0, 0.1, count)))
        for early in (True, False)
        for n in force
    ]
    return placed(rows)


def test_held_out_error_of_unreached_force_is_none() -> None:
    found = score_held_out_placements(placements(6, reach_n=4.0))
    assert found["settled"]["10_n"] is None
    assert found["settled"]["1_n"] is not None


def test_held_out_error_of_two_placements_is_none() -> None:
    assert set(score_held_out_placements(placements(2))["early"].values()) == {None}


def test_held_out_error_includes_all_placements() -> None:
    gains = np.array([1.0, 1.02, 1.4, 0.7, 1.35, 0.72])
    rows = [
        (run, early, n, gain * n * np.array([0.6, 0.4]))
        for run, gain in enumerate(gains)
        for n in np.geomspace(0.5, 10.0 if gain in (1.0, 1.02) else 4.0, 8)
        for early in (True, False)
    ]
    found = score_held_out_placements(placed(rows))
    for kind in ("early", "settled"):
        error = found[kind]["10_n"]
        assert 25 < error < 60
