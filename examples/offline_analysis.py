"""Analyse recordings of a data logger: predictions, a score table and a figure.

    python examples/offline_analysis.py recording.csv

Recordings may be CSV, TSV, Excel or Parquet; a hold is cut after each contact. Without arguments,
two of the demo recordings (simulated) are written and analysed.
"""

from __future__ import annotations

import sys
from pathlib import Path

import palpate
from palpate.demo.recordings import write_recordings


def main(files: list[Path]) -> None:
    """Cut, predict, score and draw."""
    holds = [hold for file in files for hold in palpate.cut_holds(palpate.read_recording(file))]
    for hold in holds:
        settled = palpate.predict_settled(hold)  # from the first 2.5 s to 20 s
        print(f"{hold}: {settled.value:.0f} ({settled.low:.0f} to {settled.high:.0f})")
    methods = ["relaxation", "exponential", "recorded"]
    print(palpate.score(holds, methods=methods, cutoffs_s=[1, 2.5, 5]))
    palpate.plot_holds(holds, "holds.png")


if __name__ == "__main__":
    if not sys.argv[1:]:
        print("simulated recordings: no sensor was read")
    main([Path(name) for name in sys.argv[1:]] or write_recordings(Path("recordings"))[::2])
