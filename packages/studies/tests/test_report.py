"""Output options are checked before a study runs; unusable recordings are refused in one line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from PIL import Image
from tests.commands import run_palpate

from palpate_studies import environment, table2
from palpate_studies.report import StudyReport


@pytest.mark.parametrize("inside", [False, True])
def test_out_option_naming_a_file_is_refused_before_the_study(
    inside: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.delattr(table2, "measure_settled_readings")  # The study would fail.
    file = tmp_path / "taken"
    file.write_text("mine")
    out = file / "report" if inside else file
    assert run_palpate("study", "table2", "--out", out) == 2
    error = capsys.readouterr().err
    assert f"{file} is not a folder; give a folder" in error
    assert error.count("\n") == 1
    assert file.read_text() == "mine"


@pytest.mark.slow
def test_figures_have_requested_format_and_resolution(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for size in ("sensors", "repeats"):
        monkeypatch.setitem(environment.report.__kwdefaults__, size, 1)
    out = ["--out", str(tmp_path / "asked")]
    asked = ["study", "environment", *out, "--format", "png", "--dpi", "50"]
    assert run_palpate(*asked) == 0
    [picture] = (tmp_path / "asked").glob("figure3*")
    assert picture.suffix == ".png"
    with Image.open(picture) as image:
        assert image.info["dpi"] == pytest.approx((50, 50), abs=0.1)

    # The options of one call do not affect the next.
    report = StudyReport(
        name="next", title="", provenance=(), tables=(), payload={}, figures={"drawn": Figure}
    )
    report.write(tmp_path / "next")
    written = {path.suffix for path in (tmp_path / "next").glob("drawn*")}
    assert written == {".png", ".svg", ".pdf"}


LADDER, TOUCH = "ladder,step,load_n,resistance_ohm\n", "recording_id,time_s,resistance_ohm,force_n"
SOFT = "stroke_id,location_mm,depth_mm,voltage_v,force_n\n"
INDEX, CURVES = "grasp_id,fruit,rupture_force_n\n", "grasp_id,closure_mm,force_n\na,1.0,2.0\n"
#: Study, its files by option, and part of the message.
CASES: tuple[tuple[str, dict[str, str], str], ...] = (
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
    ("strokes", {"recordings": TOUCH + ",touch,phase\na,0,10,0,0,rest\n"}, "sensor-pin-attempt"),
    ("soft-sensor", {"train": SOFT + "1,0,0.5,0.04,2\n1,0,0.5,0.05,3\n"}, "one depth only"),
    ("rupture", {"curves": CURVES, "index": INDEX + "a,kiwi,-1\n"}, "must be positive"),
    ("rupture", {"curves": CURVES, "index": INDEX + "b,kiwi,3.0\n"}, "no curve for b"),
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
    name: str, files: dict[str, str], message: str, tmp_path: Path, refusal: Callable[..., str]
) -> None:
    words: list[object] = []
    for option, text in files.items():
        path = tmp_path / f"{option}.csv"
        path.write_text(text)
        words += [f"--{option}", path]
    assert message in refusal(name, *words)
