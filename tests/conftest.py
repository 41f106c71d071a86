"""What every test may use: the folder of real recordings, and skips that turn into failures."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

REQUIRE_ALL = os.environ.get("PALPATE_REQUIRE_ALL") == "1"


def skip(reason: str) -> None:
    """Skip the test, or fail it where nothing may skip (`PALPATE_REQUIRE_ALL=1`)."""
    if REQUIRE_ALL:
        pytest.fail(f"would skip, and nothing may: {reason}")
    pytest.skip(reason)


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Return the folder of real recordings (never part of this project)."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("PALPATE_REAL_DATA", default))
    if not folder.is_dir():
        skip(f"no real recordings at {folder}; set PALPATE_REAL_DATA to their folder")
    return folder
