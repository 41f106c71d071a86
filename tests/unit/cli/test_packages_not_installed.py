"""Commands without the packages of studies, archive or LeRobot export."""

from __future__ import annotations

import pytest

from palpate.cli import build_app, lazy_group, run


@pytest.mark.parametrize(
    ("command", "folder"),
    [
        ("study table1", "studies"),
        ("bench settling", "studies"),
        ("archive settle archive", "archive"),
        ("export run.mcap --lerobot grasps", "bridges/lerobot-dataset"),
    ],
)
def test_missing_package_names_the_extra_to_install(command, folder, monkeypatch, capsys) -> None:
    monkeypatch.setattr(lazy_group, "entry_points", lambda *, group: ())
    assert run(build_app(), command.split(), name="palpate") == 2
    assert capsys.readouterr().err.endswith(f"in a copy of the source: pip install ./{folder}\n")
