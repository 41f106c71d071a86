"""Output options are checked before a study runs."""

from __future__ import annotations

from pathlib import Path

import pytest
from matplotlib.figure import Figure
from PIL import Image

from palpate.cli import build_app, run
from palpate_studies import environment, table2
from palpate_studies.report import StudyReport, Table


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
    assert run(build_app(), ["study", "table2", "--out", str(out)], name="palpate") == 2
    error = capsys.readouterr().err
    assert f"{file} is not a folder; give a folder" in error
    assert error.count("\n") == 1
    assert file.read_text() == "mine"


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--format", "pdf"], "--format pdf: it applies to the figures in --out DIR"),
        (["--dpi", "600"], "--dpi 600: it applies to the figures in --out DIR"),
        (["--out", "made", "--format", "svg", "--dpi", "600"], "it applies to png only"),
        (["--out", "made", "--format", "bmp"], "--format"),
    ],
)
def test_figure_options_without_effect_are_refused_before_the_study(
    options: list[str],
    reason: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delattr(table2, "measure_settled_readings")  # The study would fail.
    assert run(build_app(), ["study", "table2", *options], name="palpate") == 2
    assert reason in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_figures_have_requested_format_and_resolution(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for size in ("sensors", "repeats"):
        monkeypatch.setitem(environment.report.__kwdefaults__, size, 1)
    out = ["--out", str(tmp_path / "asked")]
    asked = ["study", "environment", *out, "--format", "png", "--dpi", "50"]
    assert run(build_app(), asked, name="palpate") == 0
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


def test_tables_name_methods_as_the_results_page_and_json_as_stored(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [{"method": "ours", "hours": 2}]
    table = Table.of("ours less the rival", rows)
    report = StudyReport(
        name="s", title="S", provenance=["`ours`"], tables=[table], payload={"rows": rows}
    )
    report.emit(as_json=False, out=tmp_path)
    for text in (capsys.readouterr().out, (tmp_path / "s.md").read_text()):
        assert "palpate less the baseline" in text
        assert "ours" not in text.replace("hours", "")
    assert '"ours"' in (tmp_path / "s.json").read_text()
