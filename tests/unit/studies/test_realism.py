"""The twin beside real recordings: what is measured, and that `field` is not kinder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.holds import Hold
from palpate.studies import realism
from palpate.studies.press_data import read_presses
from palpate.studies.realism_quantities import (
    hold_quantities,
    ladder_quantities,
    press_quantities,
)
from palpate.studies.realism_twin import twin_presses


def test_ladders_of_a_known_law() -> None:
    load = np.geomspace(0.6, 10, 12)
    found = ladder_quantities(
        [(load, gain * load**p) for gain, p in ((1, 1.0), (1, 1.0), (2, 1.0))]
    )
    assert found["exponent"].tolist() == pytest.approx([1.0, 1.0, 1.0])
    assert found["scatter of ln force"].tolist() == pytest.approx([0.0] * 3, abs=1e-9)
    # The third is twice as sensitive as the law of the other two.
    assert found["ln force missed"][2] == pytest.approx(np.log(2.0))


def test_noise_and_change_to_come_of_a_known_hold() -> None:
    rng, time_s = np.random.default_rng(1), np.arange(0, 21, 0.05)
    values = 100 * (1 + 0.1 * (20 - time_s) / 17.5) * (1 + 2e-3 * rng.standard_normal(time_s.size))
    found = hold_quantities([Hold(hold_id="a", channel=None, time_s=time_s, values=values)])
    assert found["still to come, %"].item() == pytest.approx(10.0, abs=1.0)
    assert found["noise, %"].item() == pytest.approx(0.2, rel=0.2)


def test_without_recordings_the_twin_stands_alone() -> None:
    report = realism.report({}, sensors=3)
    assert "twin alone" in report.provenance[-1]
    assert [row[0].split(":")[0] for row in report.tables[0].rows] == list(realism.COMPARED)


def test_places_of_a_field_sheet_scatter_as_real_ones(real_data: Path) -> None:
    real = press_quantities(read_presses(real_data / "velostat_presses.csv.gz"))
    pressed = [twin_presses(sensor, level="field", count=8)[0] for sensor in range(12)]
    field = press_quantities([press for presses in pressed for press in presses])
    for quantity in ("gain scatter", "creep, %"):
        compared = realism.Comparison(
            quantity=quantity, real=real[quantity], twin={"field": field[quantity]}
        )
        assert not compared.kinder("field")
