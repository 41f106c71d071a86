"""Comparison of the twin with real recordings at the level `field`."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate_studies import realism


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
