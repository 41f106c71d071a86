"""The log of a running station."""

from __future__ import annotations

import logging
import re
from pathlib import Path

import pytest

from palpate_station.dashboard.audit import LOG, write_log


def test_log_lines_of_station_and_web_server_have_a_time_with_its_zone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with write_log(tmp_path):
        LOG.error("first")
        # Not `uvicorn.error`, whose level another server in this process may have set.
        logging.getLogger("uvicorn.any").warning("second")
    lines = capsys.readouterr().err.splitlines()
    assert [line.rpartition(" ")[2] for line in lines] == ["first", "second"]
    time = r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d[+-]\d{4} "
    assert all(re.match(time, line) for line in lines)
