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
def test_public_names_exist(name: str) -> None:
    assert getattr(palpate, name).__name__ == name


def test_package_dir_lists_exactly_the_public_names() -> None:
    assert dir(palpate) == sorted([*palpate.__all__, "__version__"])


def test_public_names_are_typed_in_their_modules() -> None:
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
def test_public_names_are_documented(name: str) -> None:
    page = Path(__file__).resolve().parents[2] / "docs" / "python.md"
    assert f"`{name}`" in page.read_text(encoding="utf-8")
    assert name in (palpate.__doc__ or "")


def test_unknown_package_attribute_raises_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'palpate' has no attribute 'nothing'"):
        _ = palpate.nothing


def test_package_import_loads_no_library() -> None:
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


def test_version_is_equal_in_all_files() -> None:
    root = Path(__file__).resolve().parents[2]
    stated = tomllib.loads((root / "pyproject.toml").read_text())["project"]["version"]
    citation = (root / "CITATION.cff").read_text()
    assert palpate.__version__ == stated
    assert f"\nversion: {stated}\n" in citation


def test_grasp_help_loads_no_grasp_modules() -> None:
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
def test_grasp_loads_no_scipy_distributions() -> None:
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
