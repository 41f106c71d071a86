"""The commands on the page `docs/mujoco.md` run."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.unit.test_docs_commands import test_docs_page_blocks_run as run_page


@pytest.mark.slow
def test_commands_of_page_run(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    request: pytest.FixtureRequest,
) -> None:
    run_page("mujoco", tmp_path, monkeypatch, capsys, request)
