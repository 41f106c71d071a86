"""The public face of the package: light to import, and every name is there."""

from __future__ import annotations

import ast
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import palpate


@pytest.mark.parametrize("name", palpate.__all__)
def test_every_public_name_exists(name: str) -> None:
    assert getattr(palpate, name).__name__ == name


def test_the_package_lists_its_public_names_and_nothing_else() -> None:
    assert dir(palpate) == sorted([*palpate.__all__, "__version__"])


def test_every_public_name_has_its_type_where_it_is_loaded_from() -> None:
    """Type checkers read the imports that never run; they must be the ones that do."""
    tree = ast.parse(Path(palpate.__file__).read_text(encoding="utf-8"))
    typed = {
        name.name: node.module
        for block in tree.body
        if isinstance(block, ast.If)
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for name in node.names
    }
    assert typed == palpate._MODULES
    assert sorted(typed) == palpate.__all__


@pytest.mark.parametrize("name", palpate.__all__)
def test_every_public_name_is_documented(name: str) -> None:
    page = Path(__file__).resolve().parents[2] / "docs" / "python.md"
    assert f"`{name}`" in page.read_text(encoding="utf-8")
    assert name in (palpate.__doc__ or "")


def test_a_name_that_is_not_there_says_so() -> None:
    with pytest.raises(AttributeError, match="module 'palpate' has no attribute 'nothing'"):
        _ = palpate.nothing


def test_importing_the_package_loads_no_library() -> None:
    """`import palpate` must cost no more than a moment: names are loaded on first use."""
    script = (
        "import sys; before = set(sys.modules); import palpate; print(set(sys.modules) - before)"
    )
    loaded = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    ).stdout
    assert "palpate" in loaded
    for heavy in ("numpy", "scipy", "typer", "rich", "matplotlib"):
        assert f"'{heavy}" not in loaded


def test_every_place_that_states_the_version_states_the_same() -> None:
    root = Path(__file__).resolve().parents[2]
    stated = tomllib.loads((root / "pyproject.toml").read_text())["project"]["version"]
    citation = (root / "CITATION.cff").read_text()
    assert palpate.__version__ == stated
    assert f"\nversion: {stated}\n" in citation


def test_help_of_the_grasp_verb_loads_nothing_that_a_grasp_needs() -> None:
    """Numbers and optimisers take three times the time of the help text."""
    program = (
        "import sys; from palpate.cli import build_app; build_app().load('grasp'); "
        "print({'numpy', 'scipy', 'palpate.rig'} & set(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], check=True, capture_output=True, text=True
    )
    assert done.stdout.strip() == "set()"


@pytest.mark.slow
def test_running_a_grasp_loads_no_distributions() -> None:
    """`scipy.stats` takes longer to load than a grasp takes to plan."""
    program = (
        "import sys; from palpate.cli import build_app, run; "
        "run(build_app(), ['grasp', '--json'], name='palpate'); "
        "print('scipy.stats' in sys.modules, file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], check=True, capture_output=True, text=True
    )
    assert done.stderr.strip() == "False"
