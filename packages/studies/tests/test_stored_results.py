"""Stored results are of the present code, and generated pages show their figures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from tests.golden.near import near

from palpate.errors import InputError
from palpate_studies.scoreboard import (
    claims_table,
    fill_page,
    generate_pages,
    read_claims,
)
from palpate_studies.stored_results import (
    Recipe,
    explain_outdated,
    make_result,
    read_recipes,
    read_result,
    store_result,
)
from palpate_studies.study_code import ProductCode

ROOT = Path(__file__).parents[3]
DOCS = ROOT / "docs"
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


LAW = '''"""A law."""
from __future__ import annotations
from pathlib import Path
from typing import TYPE_CHECKING
from palpate import constants
from palpate.twin.world import World
if TYPE_CHECKING:
    from palpate.sheet import Sheet
LIMIT = 10.0
def estimate(sheet: Sheet, world: World) -> float:
    """Estimate."""
    if sheet.area() > LIMIT:
        raise ValueError("too large")
    return constants.GAIN * len(_read())  # a force
def _read():
    return Path(__file__).with_name("law.json").read_text()
def other():
    return 5.0
'''
PRODUCT = {
    "__init__.py": "",
    "law.py": LAW,
    "law.json": "[1.0]",
    "constants.py": "GAIN = 2.0\nOTHER = 3.0\n",
    "sheet.py": "class Sheet:\n    def area(self):\n        return 4.0\n",
    "twin/__init__.py": "",
    "twin/world.py": "class World:\n    NOISE = 0.1\n",
}


@pytest.fixture
def product(tmp_path: Path) -> Path:
    """Return the folder of a small product with a law, its constants and a twin."""
    folder = tmp_path / "palpate"
    (folder / "twin").mkdir(parents=True)
    for name, text in PRODUCT.items():
        (folder / name).write_text(text)
    return folder


@pytest.mark.parametrize(
    ("file", "old", "new", "changed"),
    [
        ("law.py", "# a force", "# its force, in N", None),
        ("law.py", '"""Estimate."""', '"""Estimate the force."""', None),
        ("law.py", "too large", "the sheet is too large", None),
        ("law.py", "len(_read())", "(len(_read()))", None),
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
    # The twin is content only of a result about it.
    about_twin = ProductCode({"palpate": product}).hash_content(["palpate.twin.world:World"])
    assert ("palpate.twin.world" in before, "palpate.twin.world" in about_twin) == (False, True)


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
    content = code.hash_content([SYMBOL])
    store_result(recipe, docs=tmp_path, figures={"error": 0.1}, code=content, processor_s=2.0)
    assert not explain_outdated(recipe, docs=tmp_path, code=code)
    other = replace(recipe, study="rupture")
    reason = explain_outdated(other, docs=tmp_path, code=code)
    assert reason == "made with `palpate study rupture --second`"
    path = product / "sheet.py"
    path.write_text(path.read_text().replace("4.0", "4.5"))
    reason = explain_outdated(recipe, docs=tmp_path, code=ProductCode({"palpate": product}))
    assert reason == "changed: palpate.sheet"


#: Results of real recordings that take less than 10 s to make.
QUICK = ("force-ladders", "hydrogel", "meat", "realism", "soft-sensor")


@pytest.mark.slow
@pytest.mark.parametrize("name", QUICK)
def test_study_of_real_recordings_reproduces_its_stored_figures(
    name: str, real_data: Path, tmp_path: Path
) -> None:
    """All figures of the study, to the digits that may differ between processors."""
    recipe = replace(read_recipes(DOCS)[name], earlier="")
    (tmp_path / "kept").mkdir()
    make_result(recipe, docs=tmp_path, data=real_data)
    made = read_result(tmp_path, name)
    assert made["figures"] == near(read_result(DOCS, name)["figures"])
    assert not explain_outdated(recipe, docs=tmp_path, code=ProductCode())


def test_twin_of_the_field_is_never_kinder_than_velostat() -> None:
    rows = read_result(DOCS, "realism")["figures"]["compared"]
    assert [row["quantity"] for row in rows if row["kinder"]["field"]] == []


def test_generated_pages_match_stored_results() -> None:
    for page, wanted in generate_pages(DOCS).items():
        assert page.read_text() == wanted, f"{page} is stale: run docs/generate_scoreboard.py"


def test_results_have_origin_and_are_quoted() -> None:
    quoting = (DOCS / "claims.toml").read_text() + (DOCS / "kept" / "results.md.in").read_text()
    recipes = read_recipes(DOCS)
    assert recipes.keys() == {path.stem for path in (DOCS / "kept").glob("*.json")}
    for name, recipe in recipes.items():
        assert f'"{name}"' in quoting or f"{{{{{name}|" in quoting, name
        assert recipe.origin in ("real", "simulated")
        assert recipe.note, f"{name} does not report its seeds and evaluations"


RESULTS = """\
[one]
study = "rupture"
keys = ["rows", "pair"]
origin = "real"
note = "Once."
[two]
study = "rupture --second"
keys = []
origin = "simulated"
note = "Once."
"""
CLAIMS = """\
[[claim]]
name = "x"
code = "palpate.a:B"
claim = "error"
result = "one"
count = "3"
held = "sensors"
ours = "{100*rows[method=a, b]/error:.1f} %"
rival = "{rows[method=c]/error}"
rival_name = "c"
difference = "pair"
verdict = "undecided"
note = "{rows[method=c]/ends/1}"
second_result = "two"
second = "{error:.1f}"
second_difference = "pair"
second_verdict = "rival"
"""
FIGURES = {
    "one": {
        "rows": [
            {"method": "a, b", "error": 0.1234},
            {"method": "c", "error": 0.2, "ends": [1, 3]},
        ],
        "pair": {"difference": -0.1, "low": -0.2, "high": 0.01, "verdict": "undecided"},
    },
    "two": {"error": 0.5, "pair": {"difference": 0.3, "low": 0.1, "high": 0.4, "verdict": "rival"}},
}


@pytest.fixture
def docs(tmp_path: Path) -> Path:
    (tmp_path / "kept").mkdir()
    (tmp_path / "results.toml").write_text(RESULTS)
    (tmp_path / "claims.toml").write_text("claim = []\n")
    recipes = read_recipes(tmp_path)
    for name, figures in FIGURES.items():
        store_result(recipes[name], docs=tmp_path, figures=figures, code={}, processor_s=1.0)
    (tmp_path / "claims.toml").write_text(CLAIMS)
    return tmp_path


def test_figures_of_an_earlier_version_are_marked(docs: Path) -> None:
    text = "Now{{earlier}}: {{one|rows[method=c]/error:.2f}} {{two|error}}"
    assert fill_page(text, docs) == "Now: 0.20 0.5"
    path = docs / "results.toml"
    path.write_text(path.read_text().replace('origin = "real"', 'origin = "real"\nearlier = "why"'))
    (claim,) = read_claims(docs)
    assert "| 12.3 % (of an earlier version) |" in claims_table([claim])
    assert claim["second"].endswith("+0.400)")
    line, figures = fill_page(text, docs).split(": 0.20")
    assert "`one` (why)" in line
    assert figures == "† 0.5"


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('verdict = "undecided"', 'verdict = "ours"', "its interval 'undecided'"),
        ('second_verdict = "rival"', 'second_verdict = "ours"', "its interval 'rival'"),
        ("method=c]/error}", "method=d]/error}", "matches 0 rows"),
        ('difference = "pair"', 'difference = "pear"', "has no 'pear'"),
        ("ends/1", "ends/2", "has no '2'"),
    ],
)
def test_read_claims_unsupported_claim_raises(
    docs: Path, old: str, new: str, complaint: str
) -> None:
    path = docs / "claims.toml"
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(InputError, match=complaint):
        read_claims(docs)
