"""The stiffness study's objects: as stiff as asked, and of every kind."""

from __future__ import annotations

import pytest

from palpate.twin.mechanics import object_force_n
from palpate_studies.stiffness import FIRM_N, SIZES_MM, object_of


@pytest.mark.parametrize("stiffness", [0.5, 5.0, 50.0])
def test_every_object_has_the_secant_stiffness_that_was_asked_for(stiffness: float) -> None:
    drawn = [object_of(stiffness, seed=seed) for seed in range(12)]
    for obj in drawn:
        force_n = object_force_n(obj, FIRM_N / stiffness, ruptured=False)[0]
        assert force_n == pytest.approx(FIRM_N)
        assert SIZES_MM[0] <= obj.size_mm <= SIZES_MM[1]
    assert {obj.contact for obj in drawn} == {"linear", "hertz"}
    assert min(sum(obj.relaxing_share) for obj in drawn) < 0.05
    assert max(sum(obj.relaxing_share) for obj in drawn) > 0.1
