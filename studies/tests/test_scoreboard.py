"""Generated pages show the figures of the stored results."""

from __future__ import annotations

import ast
import json
import re
import shutil
from functools import cache
from pathlib import Path

import pytest

import palpate
from palpate.errors import InputError
from palpate_studies.catalogue import STUDIES
from palpate_studies.scoreboard import (
    MARKS,
    claims_table,
    fill_page,
    first_page_table,
    generate_pages,
    insert_table,
    read_claims,
)
from palpate_studies.stored_results import read_recipes, store_result
from palpate_studies.study_code import ProductCode

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


def test_generated_pages_match_stored_results() -> None:
    for page, wanted in generate_pages(DOCS).items():
        assert page.read_text() == wanted, f"{page} is stale: run docs/generate_scoreboard.py"


def test_readme_has_only_the_generated_results_table() -> None:
    text = (ROOT / "README.md").read_text()
    begin, end = MARKS
    outside = text.split(begin)[0] + text.split(end)[1]
    assert not re.findall(r"^\|.*\d.*\|$", outside, flags=re.MULTILINE)


def test_results_have_origin_and_are_quoted() -> None:
    quoting = (DOCS / "claims.toml").read_text() + (DOCS / "kept" / "results.md.in").read_text()
    recipes = read_recipes(DOCS)
    assert recipes.keys() == {path.stem for path in (DOCS / "kept").glob("*.json")}
    for name, recipe in recipes.items():
        assert f'"{name}"' in quoting or f"{{{{{name}|" in quoting, name
        assert recipe.origin in ("real", "simulated")
        assert recipe.note, f"{name} does not report its seeds and evaluations"


@pytest.fixture
def docs(tmp_path: Path) -> Path:
    (tmp_path / "kept").mkdir()
    (tmp_path / "results.toml").write_text(
        '[one]\nstudy = "rupture"\nkeys = ["rows", "pair"]\norigin = "real"\nnote = "Once."\n'
        '[two]\nstudy = "rupture --second"\nkeys = []\norigin = "simulated"\nnote = "Once."\n'
    )
    (tmp_path / "claims.toml").write_text("claim = []\n")
    recipes = read_recipes(tmp_path)
    store_result(
        recipes["one"],
        docs=tmp_path,
        figures={
            "rows": [
                {"method": "a, b", "error": 0.1234},
                {"method": "c", "error": 0.2, "ends": [1, 3]},
            ],
            "pair": {"difference": -0.1, "low": -0.2, "high": 0.01, "verdict": "undecided"},
        },
        code={},
        processor_s=1.0,
    )
    store_result(
        recipes["two"],
        docs=tmp_path,
        figures={
            "error": 0.5,
            "pair": {"difference": 0.3, "low": 0.1, "high": 0.4, "verdict": "rival"},
        },
        code={},
        processor_s=1.0,
    )
    (tmp_path / "claims.toml").write_text(
        '[[claim]]\nname = "x"\ncode = "palpate.a:B"\nclaim = "error"\nresult = "one"\n'
        'count = "3"\nheld = "sensors"\n'
        'ours = "{100*rows[method=a, b]/error:.1f} %"\nrival = "{rows[method=c]/error}"\n'
        'rival_name = "c"\ndifference = "pair"\nverdict = "undecided"\n'
        'note = "{rows[method=c]/ends/1}"\nsecond_result = "two"\n'
        'second = "{error:.1f}"\nsecond_difference = "pair"\nsecond_verdict = "rival"\n'
    )
    return tmp_path


def test_read_claims_looks_up_and_scales_figures(docs: Path) -> None:
    (claim,) = read_claims(docs)
    assert (claim["ours"], claim["rival"], claim["origin"]) == ("12.3 %", "0.2", "real")
    assert claim["difference"] == "-0.100 (-0.200 to +0.010)"
    assert claim["second"] == "**baseline**: 0.5 (+0.300, +0.100 to +0.400)"
    table = claims_table([claim])
    assert (
        "| error (3) | 3; sensors; `rupture` | 12.3 % | 0.2 (c) | **undecided**: -0.100 " in table
    )
    page = fill_page("{{one|rows[method=c]/error:.2f}} {{one|rows[method=c]/ends:.0f}}", docs)
    assert page == "0.20 2"


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


def test_insert_table_changes_with_stored_result(tmp_path: Path) -> None:
    shutil.copytree(DOCS / "kept", tmp_path / "kept")
    for name in ("claims.toml", "results.toml"):
        shutil.copy(DOCS / name, tmp_path)
    page = (ROOT / "README.md").read_text()
    path = tmp_path / "kept" / "rupture.json"
    document = json.loads(path.read_text())
    for row in document["figures"]["tradeoff"]:
        row["firmness"] += 0.1
    path.write_text(json.dumps(document))
    assert insert_table(page, first_page_table(read_claims(tmp_path))) != page
    with pytest.raises(InputError, match="needs exactly one"):
        insert_table("no marks", "")


def test_paper_notes_count_misses_like_stored_results() -> None:
    notes = (DOCS / "paper-notes.md").read_text()
    for table, of in (("1", "family"), ("4", "level"), ("5", "level")):
        stored = json.loads((DOCS / "kept" / f"table{table}.json").read_text())["figures"]
        for name, parts in stored["misfit"].items():
            fitted, predicted = (
                f"{part['missed']} of {part['entries']}" if part["entries"] else "-"
                for part in (parts["fitted"], parts["predicted"])
            )
            assert f"| Table {table}, {of} `{name}` | {fitted} | {predicted} |" in notes


@pytest.mark.slow
def test_claimed_symbols_are_used_by_study_and_command() -> None:
    """The study reaches the named class or function of palpate, and a command imports it."""
    code = ProductCode()
    for row in read_claims(DOCS):
        module, symbol = row["code"].split(":")
        public = {one for one, home in palpate._MODULES.items() if home == module}
        in_study = code.find_definitions([f"{STUDIES[row['study']][0]}:command"])
        assert (module, symbol) in in_study, row["name"]
        assert any(imports(path, module, symbol, public) for path in list_product_files()), row[
            "name"
        ]


def imports(path: Path, module: str, symbol: str, public: set[str]) -> bool:
    """Return whether a file imports the symbol from its module or as a public name."""
    if path.suffix != ".py":
        return False
    return any(
        symbol in [one.name for one in node.names]
        and (node.module == module or (node.module == "palpate" and symbol in public))
        for node in list_imports(path.read_text())
    )


@cache
def list_imports(code: str) -> list[ast.ImportFrom]:
    """Return the imports of a program; every claim asks the same files."""
    return [node for node in ast.walk(ast.parse(code)) if isinstance(node, ast.ImportFrom)]


@cache
def list_product_files() -> list[Path]:
    """Return the product files imported by commands, directly or indirectly."""
    commands = (ROOT / "src" / "palpate" / "cli").glob("*.py")
    files, waiting = dict[Path, None](), list(commands)
    while waiting:
        path = waiting.pop()
        if path in files:
            continue
        files[path] = None
        for node in list_imports(path.read_text()):
            if (node.module or "").startswith("palpate."):
                place = (ROOT / "src").joinpath(*str(node.module).split("."))
                waiting += [one for one in (place.with_suffix(".py"),) if one.is_file()]
    return list(files)


def test_imports_detects_study_of_other_code(tmp_path: Path) -> None:
    own = tmp_path / "own.py"
    own.write_text("from palpate_studies.force_model import ForceLaw\n")
    module = "palpate.estimate.force_law"
    assert not imports(own, module, "ForceLaw", {"ForceLaw"})
    own.write_text("from palpate import ForceLaw\n")
    assert imports(own, module, "ForceLaw", {"ForceLaw"})
    assert not imports(own, module, "ForceLaw", set())
