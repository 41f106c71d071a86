"""Stored results are of the present code, and a change of that code is detected."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from palpate_studies.stored_results import (
    Recipe,
    explain_outdated,
    make_result,
    read_recipes,
    store_result,
)
from palpate_studies.study_code import ProductCode

DOCS = Path(__file__).parents[2] / "docs"
SYMBOL = "palpate.law:estimate"


@pytest.mark.slow
def test_quoted_results_are_of_the_present_code() -> None:
    code = ProductCode()
    for name, recipe in read_recipes(DOCS).items():
        reason = explain_outdated(recipe, docs=DOCS, code=code)
        if recipe.earlier:
            assert reason, f"{name} is current: remove `earlier` from docs/results.toml"
        else:
            assert not reason, f"{name}: {reason}; run `make results`"


@pytest.fixture
def product(tmp_path: Path) -> Path:
    """Return the folder of a small product with a law, its constants and a twin."""
    folder = tmp_path / "palpate"
    (folder / "twin").mkdir(parents=True)
    (folder / "__init__.py").touch()
    (folder / "law.py").write_text(
        '"""A law."""\n'
        "from __future__ import annotations\n"
        "from pathlib import Path\n"
        "from typing import TYPE_CHECKING\n"
        "from palpate import constants\n"
        "from palpate.twin.world import World\n"
        "if TYPE_CHECKING:\n"
        "    from palpate.sheet import Sheet\n"
        "LIMIT = 10.0\n"
        "def estimate(sheet: Sheet, world: World) -> float:\n"
        '    """Estimate."""\n'
        "    if sheet.area() > LIMIT:\n"
        '        raise ValueError("too large")\n'
        "    return constants.GAIN * len(_read())  # a force\n"
        "def _read():\n"
        '    return Path(__file__).with_name("law.json").read_text()\n'
        "def other():\n"
        "    return 5.0\n"
    )
    (folder / "law.json").write_text("[1.0]")
    (folder / "constants.py").write_text("GAIN = 2.0\nOTHER = 3.0\n")
    (folder / "sheet.py").write_text("class Sheet:\n    def area(self):\n        return 4.0\n")
    (folder / "twin" / "__init__.py").touch()
    (folder / "twin" / "world.py").write_text("class World:\n    NOISE = 0.1\n")
    return folder


@pytest.mark.parametrize(
    ("file", "old", "new", "changed"),
    [
        ("law.py", "# a force", "# its force, in N", None),
        ("law.py", '"""Estimate."""', '"""Estimate the force."""', None),
        ("law.py", "too large", "the sheet is too large", None),
        (
            "law.py",
            "return constants.GAIN * len(_read())",
            "return (constants.GAIN * len(_read()))",
            None,
        ),
        ("law.py", "return 5.0", "return 6.0", None),
        ("constants.py", "OTHER = 3.0", "OTHER = 4.0", None),
        ("twin/world.py", "NOISE = 0.1", "NOISE = 0.2", None),
        ("law.py", "LIMIT = 10.0", "LIMIT = 11.0", "palpate.law"),
        ("law.py", "* len", "+ len", "palpate.law"),
        ("law.json", "1.0", "1.5", "palpate.law"),
        ("constants.py", "GAIN = 2.0", "GAIN = 2.5", "palpate.constants"),
        ("sheet.py", "return 4.0", "return 4.5", "palpate.sheet"),
    ],
)
def test_content_changes_only_with_code_that_the_symbol_needs(
    product: Path, file: str, old: str, new: str, changed: str | None
) -> None:
    before = ProductCode({"palpate": product}).hash_content([SYMBOL])
    path = product / file
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    after = ProductCode({"palpate": product}).hash_content([SYMBOL])
    assert before.keys() == after.keys()
    assert [one for one in before if before[one] != after[one]] == ([changed] if changed else [])


def test_twin_is_content_of_a_result_about_it(product: Path) -> None:
    found = ProductCode({"palpate": product}).hash_content([SYMBOL, "palpate.twin.world:World"])
    assert "palpate.twin.world" in found


def test_result_is_outdated_by_its_code_or_command(product: Path, tmp_path: Path) -> None:
    (tmp_path / "kept").mkdir()
    recipe = Recipe(
        name="one",
        study="rupture --second",
        keys=("error",),
        origin="simulated",
        note="Once.",
        symbols=frozenset({SYMBOL}),
    )
    code = ProductCode({"palpate": product})
    assert explain_outdated(recipe, docs=tmp_path, code=code) == "not made"
    store_result(
        recipe,
        docs=tmp_path,
        figures={"error": 0.1},
        code=code.hash_content([SYMBOL]),
        processor_s=2.0,
    )
    assert not explain_outdated(recipe, docs=tmp_path, code=code)
    other = replace(recipe, study="rupture")
    reason = explain_outdated(other, docs=tmp_path, code=code)
    assert reason == "made with `palpate study rupture --second`"
    path = product / "sheet.py"
    path.write_text(path.read_text().replace("4.0", "4.5"))
    reason = explain_outdated(recipe, docs=tmp_path, code=ProductCode({"palpate": product}))
    assert reason == "changed: palpate.sheet"


@pytest.mark.slow
def test_make_result_stores_figures_that_are_current(tmp_path: Path) -> None:
    (tmp_path / "kept").mkdir()
    few = "slip --events 2 --hours 0.1"
    recipe = replace(read_recipes(DOCS)["slip"], study=few, keys=("summary",))
    assert make_result(recipe, docs=tmp_path, data=tmp_path) > 0.0
    assert not explain_outdated(recipe, docs=tmp_path, code=ProductCode())
    stored = json.loads((tmp_path / "kept" / "slip.json").read_text())
    assert list(stored["figures"]) == ["summary"]
