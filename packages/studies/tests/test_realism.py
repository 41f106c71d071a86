"""Comparison of the twin with real recordings: its quantities, and the level `field`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.holds import Hold
from palpate_studies import realism
from palpate_studies.realism import (
    hold_quantities,
    ladder_quantities,
)


def test_ladder_quantities_of_known_law_are_exact() -> None:
    load = np.geomspace(0.6, 10, 12)
    found = ladder_quantities(
        [(load, gain * load**p) for gain, p in ((1, 1.0), (1, 1.0), (2, 1.0))]
    )
    assert found["exponent"].tolist() == pytest.approx([1.0, 1.0, 1.0])
    assert found["scatter of ln force"].tolist() == pytest.approx([0.0] * 3, abs=1e-9)
    # The third ladder is twice as sensitive as the law of the other two.
    assert found["ln force missed"][2] == pytest.approx(np.log(2.0))


def test_hold_quantities_of_known_hold_are_exact() -> None:
    rng, time_s = np.random.default_rng(1), np.arange(0, 21, 0.05)
    values = 100 * (1 + 0.1 * (20 - time_s) / 17.5) * (1 + 2e-3 * rng.standard_normal(time_s.size))
    found = hold_quantities([Hold(hold_id="a", channel=None, time_s=time_s, values=values)])
    assert found["still to come, %"].item() == pytest.approx(10.0, abs=1.0)
    assert found["noise, %"].item() == pytest.approx(0.2, rel=0.2)


@pytest.mark.slow
def test_realism_field_level_is_never_kinder_than_velostat(
    real_data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(realism, "LEVELS", ("field",))
    rows = realism.report(
        ladders=real_data / "velostat_force_ladders.csv",
        presses=real_data / "velostat_presses.csv.gz",
        holds=real_data / "holds_velostat.csv.gz",
    ).payload["compared"]
    assert [row["quantity"] for row in rows if row["kinder"]["field"]] == []
