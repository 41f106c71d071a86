"""Record simulated grasps for the pages: `python docs/generate_grasp.py`.

Writes `docs/images/grasp.svg`, a moving picture for README.md and the start page, and
`docs/player/grasps.json`, which the page `play.md` plays. Both state that the grasps are simulated.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from palpate import __version__
from palpate.demo.grasp import DemoGrasp, run_demo_grasp
from palpate.grasp.verdict import verdict
from palpate.measurement import Measurement
from palpate.plots.grasp_picture import draw_grasp
from palpate.plots.pixel_colors import FALL, RISE

DOCS = Path(__file__).resolve().parent
#: Object, seed and target force, newtons; the first is that of `palpate demo`.
GRASPS = (("strawberry", 4, 3.0), ("tomato", 4, 2.0), ("avocado-day-4", 1, 5.0))
#: Measurements below the verdict: name, label, unit, digits.
ROWS = (
    ("size_mm", "size", "mm", 1),
    ("force_n", "grip force", "N", 2),
    ("stiffness_n_per_mm", "stiffness", "N/mm", 2),
)


def to_json(grasp: DemoGrasp) -> dict[str, Any]:
    """Return a grasp for the player: moments as rows, then the answer with its true values."""
    document, result = grasp.document, grasp.document.result
    truth = document.truth or {}
    words = verdict(result, target_force_n=document.target_force_n)
    answers = []
    for name, label, unit, digits in ROWS:
        measured: Measurement | None = getattr(result, name)
        if measured is not None and measured.has_value:
            values = (measured.value, measured.low, measured.high, truth.get(name))
            answers.append([label, unit, *(_rounded(value, digits) for value in values)])
    return {
        "object": document.subject,
        "seed": grasp.seed,
        "target_n": document.target_force_n,
        "finger_of_row": grasp.finger_of_row,
        "columns": ["time_s", "phase", "width_mm", "force_n", "low_n", "high_n", "pixels_percent"],
        "moments": [
            [
                _rounded(moment.time_s, 2),
                moment.phase.value,
                _rounded(moment.width_mm, 1),
                *_force(moment.force_n),
                [_rounded(value, 0) for value in moment.change_percent.ravel().tolist()],
            ]
            for moment in grasp.moments
        ],
        "verdict": f"{words['text']}, {words['firmness']}",
        "answers": answers,
    }


def _force(force: Measurement | None) -> list[float | None]:
    if force is None:
        return [None, None, None]
    return [_rounded(value, 2) for value in (force.middle, force.low, force.high)]


def _rounded(value: object, digits: int) -> float | None:
    if not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return round(value, digits) if digits else round(value)


def main() -> None:
    """Run the grasps and write both files."""
    grasps = [
        run_demo_grasp(object_name=name, seed=seed, target_n=target_n)
        for name, seed, target_n in GRASPS
    ]
    picture = DOCS / "images" / "grasp.svg"
    picture.write_text(draw_grasp(grasps[0], moving=True), encoding="utf-8")
    document = {
        "simulated": True,
        "version": __version__,
        "fall": FALL,
        "rise": RISE,
        "grasps": [to_json(grasp) for grasp in grasps],
    }
    text = json.dumps(document, separators=(",", ":"), allow_nan=False)
    (DOCS / "player" / "grasps.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
