"""Made-up closings on springs that rupture, and the damage file that is learned from them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from tests.commands import run_palpate


def write_closings(folder: Path, *, count: int, melons: int = 0) -> list[str]:
    """Write closings on springs (kiwis rupture near 1.5 mm, melons near 6); return options."""
    rng = np.random.default_rng(4)
    curves, index = ["grasp_id,closure_mm,force_n"], ["grasp_id,fruit,rupture_force_n"]
    for number in range(count + melons):
        fruit, borne_mm = ("kiwi", 1.5) if number < count else ("melon", 6.0)
        stiffness = 1.2 * np.exp(0.4 * rng.standard_normal())
        limit_n = borne_mm * stiffness * np.exp(0.2 * rng.standard_normal())
        index.append(f"k{number},{fruit},{limit_n:.3f}")
        closure_mm = np.arange(0.1, 1.1 * limit_n / stiffness, 0.02)
        curves += [f"k{number},{x:.2f},{stiffness * x:.4f}" for x in closure_mm]
    (folder / "curves.csv").write_text("\n".join(curves) + "\n")
    (folder / "index.csv").write_text("\n".join(index) + "\n")
    return ["--curves", str(folder / "curves.csv"), "--index", str(folder / "index.csv")]


def write_damage_file(folder: Path, *, count: int = 40, melons: int = 0) -> Path:
    """Learn the limit of such kiwis and melons, as a user does."""
    options = write_closings(folder, count=count, melons=melons)
    out = folder / "damage.json"
    status = run_palpate("calibrate", "damage", *options, "--out", str(out))
    assert status == 0
    return out
