"""A recording for the tests of its file, of commands and of the page."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.recordings import MESSAGES, write_recording


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    """Return the file of a small recording."""
    return write_recording(tmp_path / "run.mcap", MESSAGES)
