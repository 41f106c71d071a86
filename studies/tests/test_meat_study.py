"""The study of meat on synthetic double presses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate_studies import meat


def write_presses(path: Path) -> Path:
    """Write two speeds; across the grain three times as firm, second press at 0.9."""
    random = np.random.default_rng(1)
    lines = ["curve,material,test,direction,specimen,leg,time_s,gap_mm,force_n"]
    for speed in ("2 s", "80 s"):
        for direction, peak in (("cross-plane", 6.0), ("in-plane", 2.0)):
            for specimen in range(1, 7):
                force = peak * float(np.exp(0.2 * random.standard_normal()))
                name = f"{speed} {direction} {specimen}"
                start = f"{name},steak,double {speed},{direction},{specimen}.0"
                for leg, factor in ((1, 0.4), (1, 1.0), (2, 0.5), (3, 0.9), (4, 0.1)):
                    lines.append(f"{start},{leg},0.5,4.0,{factor * force:.4f}")
    path.write_text("\n".join(lines) + "\n")
    return path


def test_meat_needed_specimens_depend_on_scatter_within_direction(tmp_path: Path) -> None:
    found = meat.report(presses=write_presses(tmp_path / "presses.csv"))
    rows = found.payload["summary"]
    assert [row["speed"] for row in rows] == ["2 s", "80 s"]
    for row in rows:
        assert row["presses"] == 12
        assert row["sd"] == pytest.approx(0.2, abs=0.12)
        assert row["needed_30"] > row["needed_50"] >= 1
