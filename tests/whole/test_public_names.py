"""The public face of the package: light to import, and every name is there."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import palpate

ROOT = Path(__file__).resolve().parents[2]


def test_public_names_exist_and_are_documented() -> None:
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    for name in palpate.__all__:
        assert getattr(palpate, name).__name__ == name
        assert f"`{name}`" in page
    assert dir(palpate) == sorted([*palpate.__all__, "__version__"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("program", "unwanted"),
    [
        ("import palpate", "{'numpy', 'scipy', 'typer', 'rich', 'matplotlib'}"),
        # Help, and the completion of options.
        (
            "from palpate.cli import build_app; build_app().load('grasp')",
            "{'numpy', 'scipy', 'palpate.rig', 'nicegui', 'fastapi', 'uvicorn'}",
        ),
        # It takes longer to load than a grasp takes to plan.
        (
            "from palpate.cli import build_app, run; "
            "run(build_app(), ['grasp', '--json', '--rate-hz', '15'], name='palpate')",
            "{'scipy.stats'}",
        ),
    ],
)
def test_slow_libraries_are_loaded_only_when_needed(program: str, unwanted: str) -> None:
    script = f"import sys; {program}; print({unwanted} & set(sys.modules), file=sys.stderr)"
    done = subprocess.run(
        [sys.executable, "-c", script], check=True, capture_output=True, text=True
    )
    assert done.stderr == "set()\n"


def test_version_is_equal_in_all_files() -> None:
    stated = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    citation = (ROOT / "CITATION.cff").read_text()
    assert palpate.__version__ == stated
    assert f"\nversion: {stated}\n" in citation
