"""The tables of the reference pages agree with the code."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_reference_tables_agree_with_the_code() -> None:
    check = [sys.executable, "docs/generate_tables.py", "--check"]
    status = subprocess.run(check, cwd=ROOT, stderr=subprocess.DEVNULL, check=False).returncode
    assert status == 0, "run python docs/generate_tables.py"
