"""Ours compared with every simpler rule on drawn families and on real recordings.

python -m palpate_studies.settling_grid FOLDER [SEED [HOLDS]]
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console

from palpate.holds import Hold, read_holds
from palpate.settling.predict import predict_settled
from palpate.settling.relaxation import Relaxation
from palpate.settling.result import FloatArray, SettlingMethod
from palpate.settling.scoring import settled_value
from palpate_studies.settling_families import FAMILIES, draw

CUTOFFS_S = (1.0, 2.5, 5.0)
REAL = ("holds_cbsilicone", "holds_velostat", "holds_force_relaxation")
#: a + b ln(u + t0), fitted from so long after the peak: t0 and that, s.
LOG_LAWS = {"log law 0.2 s": (0.2, 0.5), "log law 0.4 s": (0.4, 0.1)}
SIMPLE = ("recorded", "exponential", *LOG_LAWS)


def log_law(hold: Hold, cutoff_s: float, *, from_s: float, wait_s: float) -> float:
    """Return the log law of one hold at 20 s, or the last sample where it has too few."""
    seen = hold.time_s <= cutoff_s
    time_s, values = hold.time_s[seen], hold.values[seen]
    since_s = time_s - time_s[values.argmax()]
    used = since_s >= wait_s - 1e-9
    if used.sum() < 3:
        return float(values[-1])
    slope, level = np.polyfit(np.log(since_s[used] + from_s), values[used], 1)
    return float(level + slope * np.log(20.0 - (time_s[-1] - since_s[-1]) + from_s))


def errors(holds: Sequence[Hold], cutoff_s: float) -> dict[str, FloatArray]:
    """Return |error| in % of every rule on each hold, and of ours whether it is covered and ok."""
    found: dict[str, list[float]] = {name: [] for name in (*SIMPLE, "ours", "covered", "ok")}
    ours: SettlingMethod = Relaxation()
    for hold in holds:
        settled = settled_value(hold.time_s, hold.values, horizon_s=20.0)
        for name in SIMPLE[:2]:
            guess = predict_settled(hold.time_s, hold.values, cutoff_s=cutoff_s, method=name)
            found[name].append(100 * abs(float(guess.value) / settled - 1))
        for name, (from_s, wait_s) in LOG_LAWS.items():
            guessed = log_law(hold, cutoff_s, from_s=from_s, wait_s=wait_s)
            found[name].append(100 * abs(guessed / settled - 1))
        one = predict_settled(hold.time_s, hold.values, cutoff_s=cutoff_s, method=ours)
        found["ours"].append(100 * abs(float(one.value) / settled - 1))
        found["covered"].append(float(one.low <= settled <= one.high))
        found["ok"].append(float(str(one.status) == "ok"))
    return {name: np.array(values) for name, values in found.items()}


def line(family: str, holds: Sequence[Hold]) -> str:
    """Return one row: medians of all rules; p90, worst, coverage (all, ok) and share ok of ours."""
    scored = [errors(holds, cutoff_s) for cutoff_s in CUTOFFS_S]
    cells = [" / ".join(f"{np.median(s[name]):.2g}" for s in scored) for name in (*SIMPLE, "ours")]
    cells.append(" / ".join(f"{np.quantile(s['ours'], 0.9):.2g}" for s in scored))
    cells.append(" / ".join(f"{s['ours'].max():.2g}" for s in scored))
    cells.append(" / ".join(f"{s['covered'].mean():.2f}" for s in scored))
    cells.append(
        " / ".join(
            f"{s['covered'][s['ok'] == 1].mean():.2f}" if s["ok"].any() else "-" for s in scored
        )
    )
    cells.append(" / ".join(f"{s['ok'].mean():.2f}" for s in scored))
    return f"| {family} ({len(holds)}) | " + " | ".join(cells) + " |"


def main(data: Path, *, seed: int, count: int) -> None:
    """Write the table, in Markdown."""
    console = Console(soft_wrap=True)
    for name in REAL:
        console.print(line(name, list(read_holds(data / f"{name}.csv.gz"))))
    for family in FAMILIES:
        console.print(line(family, draw(family, count, seed=seed)))


if __name__ == "__main__":
    main(
        Path(sys.argv[1]),
        seed=int(sys.argv[2]) if len(sys.argv) > 2 else 20_262,
        count=int(sys.argv[3]) if len(sys.argv) > 3 else 300,
    )
