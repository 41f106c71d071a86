"""A logger's recording in, settled values out: tables on the screen, a CSV file and a plot.

    python examples/offline_analysis.py recording.csv results

The recording may be CSV, TSV, Excel or Parquet; its holds are found after each contact. Without
arguments the demo recordings (simulated, and said so) are written and analysed.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np

import palpate
from palpate.demo.recordings import write_recordings

CUTOFFS_S = (1.0, 2.5, 5.0)
METHODS = ("recorded", "exponential", "relaxation")
HORIZON_S = 20.0


def settled_value(hold: palpate.Hold) -> float:
    """Return what the hold came to; NaN where it ends before the horizon."""
    last = hold.values[(hold.time_s > HORIZON_S - 0.5) & (hold.time_s <= HORIZON_S)]
    return float(last.mean()) if hold.time_s[-1] > HORIZON_S - 0.5 else float("nan")


def main(arguments: list[str]) -> None:
    """Analyse recordings into a folder."""
    folder = Path(arguments[1] if len(arguments) > 1 else "out")
    folder.mkdir(parents=True, exist_ok=True)
    if arguments:
        files = [Path(arguments[0])]
    else:
        files = [f for f in write_recordings(folder / "simulated") if f.stem != "counts"]
        print("simulated recordings: no sensor was read")

    holds = [hold for file in files for hold in palpate.cut_holds(palpate.read_recording(file))]
    print(f"{len(holds)} holds in {', '.join(str(file) for file in files)}")
    compare(holds)
    answers = [
        palpate.predict_settled(h.time_s, h.values, cutoff_s=2.5, horizon_s=HORIZON_S)
        for h in holds
    ]
    write(holds, answers, folder / "settled.csv")
    plot(holds, answers, folder / "settled.png")
    print(f"wrote {folder / 'settled.csv'} and {folder / 'settled.png'}")


def compare(holds: list[palpate.Hold]) -> None:
    """Print how far each method is off, from the first 1, 2.5 and 5 s of each hold.

    One exponential fits the fast beginning and knows nothing of the slow end; our method weighs
    fast and slow shapes at once, so the slow part is expected before it shows.
    """
    known = [hold for hold in holds if np.isfinite(settled_value(hold))]
    if not known:
        print(f"no hold lasts {HORIZON_S:g} s, so there is nothing to compare with")
        return
    print(f"median |error|, % of the settled value, {len(known)} holds")
    print("  method       " + "".join(f"{cutoff_s:>6g} s" for cutoff_s in CUTOFFS_S))
    for method in METHODS:
        line = f"  {method:12s}"
        for cutoff_s in CUTOFFS_S:
            errors = []
            for hold in known:
                found = palpate.predict_settled(
                    hold.time_s, hold.values, cutoff_s=cutoff_s, horizon_s=HORIZON_S, method=method
                )
                errors.append(100 * abs(found.value / settled_value(hold) - 1))
            line += f"{np.median(errors):>8.2f}"
        print(line)


def write(holds: list[palpate.Hold], answers: list[palpate.SettledEstimate], path: Path) -> None:
    """Write one row for each hold, from its first 2.5 s."""
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(["hold_id", "predicted", "low", "high", "status", "recorded_at_20_s"])
        for hold, answer in zip(holds, answers, strict=True):
            known = settled_value(hold)
            truth = f"{known:.1f}" if np.isfinite(known) else ""
            rows.writerow(
                [hold.hold_id, answer.value, answer.low, answer.high, answer.status, truth]
            )


def plot(holds: list[palpate.Hold], answers: list[palpate.SettledEstimate], path: Path) -> None:
    """Draw the first six holds, what was used of them, and the answer."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 5), layout="constrained")
    panels = figure.subplots(2, 3, squeeze=False).ravel()
    for axes, hold, answer in zip(panels, holds, answers, strict=False):
        used = hold.time_s <= 2.5
        axes.plot(hold.time_s, hold.values, color="#C0C0C0")
        axes.plot(hold.time_s[used], hold.values[used], color="#222222")
        axes.errorbar(
            [HORIZON_S],
            [answer.value],
            yerr=[[answer.value - answer.low], [answer.high - answer.value]],
            fmt="o",
            color="#0072B2",
            capsize=4,
        )
        axes.set_title(hold.hold_id, fontsize=9)
        axes.set_xlabel("time, s")
        axes.set_ylabel("value, unit of the file")
    for axes in panels[len(holds) :]:
        axes.set_axis_off()
    figure.suptitle("black: used; grey: what came later; blue: predicted, 90 % interval")
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main(sys.argv[1:])
