"""Studies refuse unusable recordings with one line on standard error."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

LADDER, TOUCH = "ladder,step,load_n,resistance_ohm\n", "recording_id,time_s,resistance_ohm,force_n"
SOFT = "stroke_id,location_mm,depth_mm,voltage_v,force_n\n"
INDEX, CURVES = "grasp_id,fruit,rupture_force_n\n", "grasp_id,closure_mm,force_n\na,1.0,2.0\n"
#: Study, its files by option, and part of the message.
CASES: tuple[tuple[str, dict[str, str], str], ...] = (
    ("force-ladders", {"ladders": "ladder,step,load_n\nA,0,0\n"}, "no column resistance_ohm"),
    ("force-ladders", {"ladders": LADDER + "A,0,1.0,50\n"}, "doesn't begin unloaded"),
    ("force-ladders", {"ladders": LADDER + "A,0,0,500\nA,1,1.0,50\n"}, "fewer than 5 loaded"),
    ("force-ladders", {"ladders": LADDER + "A,0,0,0\n"}, "0 ohm"),
    (
        "force-ladders",
        {"ladders": LADDER + "".join(f"A,{k},{k},{500 - k}\n" for k in range(6))},
        "no ladder other than 'A'",
    ),
    ("presses", {"recordings": TOUCH + "\na,0,10,0\na,0,10,0\n"}, "doesn't increase"),
    ("presses", {"recordings": TOUCH + "\na,0,0,1\na,1,10,1\n"}, "0 ohm or less"),
    ("presses", {"recordings": TOUCH + "\na,0,10,0\na,1,10,0\n"}, "no press found"),
    ("presses", {"recordings": TOUCH + "\na,0,10\n"}, "3 fields, but the header has 4"),
    ("strokes", {"recordings": TOUCH + ",touch,phase\na,0,10,0,0,rest\n"}, "sensor-pin-attempt"),
    ("soft-sensor", {"train": SOFT}, "no rows below the header"),
    ("soft-sensor", {"train": SOFT + "1,0,0.5,0.04,2\n1,0,0.5,0.05,3\n"}, "one depth only"),
    ("rupture", {"curves": CURVES, "index": ""}, "empty"),
    ("rupture", {"curves": CURVES, "index": "grasp_id,fruit\na,kiwi\n"}, "no column rupture_force"),
    ("rupture", {"curves": CURVES, "index": INDEX + "a,kiwi,firm\n"}, "line 2"),
    ("rupture", {"curves": CURVES, "index": INDEX + "a,kiwi,-1\n"}, "must be positive"),
    (
        "rupture",
        {"curves": CURVES + "a,2.0,4.0\n", "index": INDEX + "a,kiwi,3.0\n"},
        "add closings",
    ),
    ("rupture", {}, "either --curves and --index or --second"),
    ("rupture", {"curves": CURVES, "index": INDEX, "test-curves": CURVES}, "belong together"),
)


@pytest.mark.parametrize(("name", "files", "message"), CASES)
def test_study_of_unusable_files_prints_one_line(
    name: str,
    files: dict[str, str],
    message: str,
    tmp_path: Path,
    refusal: Callable[..., str],
) -> None:
    words: list[object] = []
    for option, text in files.items():
        path = tmp_path / f"{option}.csv"
        path.write_text(text)
        words += [f"--{option}", path]
    assert message in refusal(name, *words)
