"""The study of what limits telling bruises, made small."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_studies.bruise_limits import Side, drawn, report


def test_sides_carry_one_force_on_both_fingers_where_they_are_sound() -> None:
    for one in drawn(24, seed=3):
        now = one["now"]
        assert isinstance(now, Side)
        first, second = now.load_n[:2].sum(), now.load_n[2:].sum()
        assert now.load_n.shape == (4, 2)
        if not one["bruised"]:
            assert first == pytest.approx(second)
        assert 1.0 < first < 20.0
        assert 55.0 < now.width_mm < 72.0


def test_a_side_read_without_error_is_the_same_each_time() -> None:
    now = drawn(1, seed=3)[0]["now"]
    assert isinstance(now, Side)
    rng = np.random.default_rng(1)
    once, again = (now.read(pixel_sd=0.0, width_sd_mm=0.0, rng=rng) for _ in range(2))
    assert np.array_equal(once.modes, again.modes)
    other = now.read(pixel_sd=0.1, width_sd_mm=0.1, rng=rng)
    assert not np.array_equal(once.modes, other.modes)


def test_scatter_of_gains_costs_and_the_report_says_so() -> None:
    made = report(480)
    found = {(r["reading"], r["judge"]): r for r in made.payload["rows"]}
    clean, sheet = (found[name, "ours"] for name in ("without error", "gains as the sheet's"))
    assert 0.7 < sheet["first_met"] < clean["first_met"] < 1.0
    assert clean["with_earlier_record"] > 0.95
    assert any("Simulated" in line for line in made.provenance)
    assert len(made.tables[0].rows) == len(found)
