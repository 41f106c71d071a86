"""Recorded holds in, settled values out: a table on the screen, a CSV file and a plot.

    python examples/offline_analysis.py holds.csv results

Without arguments it writes some holds of its own first (simulated, and said so) and analyses those.
A holds file is CSV with the columns hold_id, time_s and value; `palpate export --holds` makes one
from a recording.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np

import palpate

CUTOFF_S = 2.5


def write_simulated_holds(path: Path) -> Path:
    """Write six holds: fast and slow decays on creep, with noise; ohm, 15 samples a second."""
    chance = np.random.default_rng(7)
    time_s = np.arange(0.0, 22.0, 1 / 15)
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(["hold_id", "time_s", "value"])
        for number in range(6):
            fast, slow = chance.uniform(0.1, 0.4), chance.uniform(0.02, 0.06)
            shape = 1 + fast * np.exp(-time_s / 1.5) - slow * np.log(time_s + 0.2)
            ohm = chance.uniform(2e3, 6e3) * (shape + 0.001 * chance.normal(size=time_s.size))
            rows.writerows(
                [f"simulated-{number}", f"{t:.3f}", f"{v:.2f}"]
                for t, v in zip(time_s, ohm, strict=True)
            )
    return path


def main(arguments: list[str]) -> None:
    """Analyse a holds file into a folder."""
    folder = Path(arguments[1] if len(arguments) > 1 else "out")
    folder.mkdir(parents=True, exist_ok=True)
    if arguments:
        holds_file = Path(arguments[0])
    else:
        holds_file = write_simulated_holds(folder / "simulated-holds.csv")

    holds = [hold for hold in palpate.read_holds(holds_file) if hold.time_s[-1] > CUTOFF_S]
    settled = [palpate.predict_settled(h.time_s, h.values, cutoff_s=CUTOFF_S) for h in holds]

    print(f"{holds_file}: settled values at 20 s, from the first {CUTOFF_S:g} s")
    with (folder / "settled.csv").open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(["hold_id", "predicted", "low", "high", "status", "recorded_at_20_s"])
        for hold, answer in zip(holds, settled, strict=True):
            last = hold.values[(hold.time_s > 19.5) & (hold.time_s <= 20.0)]
            truth = f"{last.mean():.1f}" if last.size else ""
            rows.writerow(
                [hold.hold_id, answer.value, answer.low, answer.high, answer.status, truth]
            )
            print(f"  {hold.hold_id}: {answer.value:.1f} ({answer.low:.1f} to {answer.high:.1f})")
            print(f"    {answer.status}; at 20 s it was {truth or 'not recorded'}")
    plot(holds, settled, folder / "settled.png")
    print(f"wrote {folder / 'settled.csv'} and {folder / 'settled.png'}")


def plot(holds: list[palpate.Hold], settled: list[palpate.SettledEstimate], path: Path) -> None:
    """Draw each hold, what was used of it, and the answer."""
    from matplotlib.figure import Figure

    shown = list(zip(holds, settled, strict=True))[:6]
    figure = Figure(figsize=(9, 5), layout="constrained")
    panels = figure.subplots(2, 3, squeeze=False).ravel()
    for axes, (hold, answer) in zip(panels, shown, strict=False):
        used = hold.time_s <= CUTOFF_S
        axes.plot(hold.time_s, hold.values, color="#C0C0C0")
        axes.plot(hold.time_s[used], hold.values[used], color="#222222")
        axes.errorbar(
            [20.0],
            [answer.value],
            yerr=[[answer.value - answer.low], [answer.high - answer.value]],
            fmt="o",
            color="#0072B2",
            capsize=4,
        )
        axes.set_title(hold.hold_id, fontsize=9)
        axes.set_xlabel("time, s")
        axes.set_ylabel("value, unit of the file")
    for axes in panels[len(shown) :]:
        axes.set_axis_off()
    figure.suptitle("black: used; grey: what came later; blue: predicted, 90 % interval")
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main(sys.argv[1:])
