"""The bound on predicting rupture from stiffness."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.estimate.damage_learning import FruitClosing, follow_closing
from palpate_studies.rupture_told import told_half_load


def springs(*, scatter: float) -> list[FruitClosing]:
    """Return springs that rupture at twice their stiffness in N/mm, but for a scatter."""
    rng = np.random.default_rng(3)
    closure_mm = np.arange(0.0, 4.0, 0.01)
    made = []
    for number in range(20):
        stiffness = float(rng.uniform(2.0, 8.0))
        made.append(
            follow_closing(
                f"s{number}",
                fruit="spring",
                rupture_force_n=2.0 * stiffness * float(np.exp(scatter * rng.standard_normal())),
                closure_mm=closure_mm,
                force_n=stiffness * closure_mm,
            )
        )
    return made


def test_a_line_that_holds_misses_nothing_and_scatter_limits_it() -> None:
    exact, scattered = springs(scatter=0.0), springs(scatter=0.3)
    (none,) = told_half_load([(exact[:10], exact[10:])])
    (some,) = told_half_load([(scattered[:10], scattered[10:])])
    assert (none["fruit"], none["grasps"]) == ("spring", 10)
    assert none["mean_abs_error_percent"] == pytest.approx(0.0, abs=1.0)
    assert 10.0 < some["mean_abs_error_percent"] < 60.0


def test_a_fruit_that_was_not_learned_is_left_out() -> None:
    assert told_half_load([([], springs(scatter=0.0))]) == []
