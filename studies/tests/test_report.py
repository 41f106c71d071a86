"""Where and what a study may write is looked at before its work, which can take hours."""

from __future__ import annotations

from pathlib import Path

import pytest
from matplotlib.figure import Figure

from palpate.cli import build_app, run
from palpate_studies import table2
from palpate_studies.report import StudyReport


@pytest.mark.parametrize("inside", [False, True])
def test_a_file_is_no_folder_for_a_report(
    inside: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.delattr(table2, "settled_readings")  # not even begun
    file = tmp_path / "taken"
    file.write_text("mine")
    out = file / "report" if inside else file
    assert run(build_app(), ["study", "table2", "--out", str(out)], name="palpate") == 2
    said = capsys.readouterr().err
    assert f"{file} is not a folder; name one to write into" in said
    assert said.count("\n") == 1
    assert file.read_text() == "mine"


def test_report_with_a_figure_writes_every_format(tmp_path: Path) -> None:
    report = StudyReport(
        name="next", title="", provenance=(), tables=(), payload={}, figures={"drawn": Figure}
    )
    report.write(tmp_path / "next")
    written = {path.suffix for path in (tmp_path / "next").glob("drawn*")}
    assert written == {".png", ".svg", ".pdf"}
