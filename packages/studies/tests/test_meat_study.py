"""The study of meat on synthetic double presses and holds."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest


def write_holds(folder: Path, *, difference: float) -> tuple[Path, Path]:
    """Write holds and their ramps: two pieces of two cuts on two dates, six places each.

    `difference`: between the cuts, in ln of the settled fraction and of the stiffness.
    """
    random = np.random.default_rng(5)
    ramp_s, hold_s = np.arange(0.0, 3.0, 0.1), np.arange(0.0, 10.25, 0.1)
    holds, tests = ["hold_id,time_s,value"], ["recording_id,time_s,force_n"]
    for date in ("230101", "230105"):
        for cut, number, place in (
            (c, n, p) for c in ("FF", "RDG") for n in "12" for p in "ABCDEF"
        ):
            offset = difference * (cut == "RDG")
            slope, fall = np.exp(offset + 0.1 * random.standard_normal(2)) * (0.4, 0.1)
            name = f"{date}-{cut}{number}{place}"
            force = slope * ramp_s
            held = slope * 3.0 * (1.0 - fall * np.log1p(hold_s / 0.3))
            holds += [f"{name},{t:.1f},{v:.5f}" for t, v in zip(hold_s, held, strict=True)]
            tests += [f"{name},{t:.1f},{v:.5f}" for t, v in zip(ramp_s, force, strict=True)]
            tests += [f"{name},{t + 3.0:.1f},{v:.5f}" for t, v in zip(hold_s, held, strict=True)]
    paths = folder / "holds.csv", folder / "tests.csv"
    for path, lines in zip(paths, (holds, tests), strict=True):
        path.write_text("\n".join(lines) + "\n")
    return paths


def test_meat_cuts_that_differ_are_told(tmp_path: Path, document: Callable[..., Any]) -> None:
    holds, tests = write_holds(tmp_path, difference=0.5)
    found = document("meat", "--holds", holds, "--tests", tests)
    assert len(found["cuts"]) == 10
    for row in found["cuts"]:
        assert row["constant"] == 0.5
        assert row["discriminant"] > 0.9
        assert row["logistic"] > 0.9
    scatter = {row["ln_of"]: row for row in found["scatter"]}
    assert scatter["stiffness"]["between_cuts"] == pytest.approx(0.5, abs=0.1)
    assert scatter["stiffness"]["places"] == pytest.approx(0.1, abs=0.04)
    assert scatter["stiffness"]["specimens"] < 0.1
