"""Pages say what the kept results of studies say, or the build fails."""

from __future__ import annotations

import ast
import json
import re
import shutil
import tomllib
from pathlib import Path

import pytest

import palpate
from palpate.errors import InputError
from palpate_studies.catalogue import STUDIES
from palpate_studies.scoreboard import keep, quotes, read_claims, read_findings, read_kept
from palpate_studies.scoreboard_tables import (
    as_findings,
    as_first_table,
    as_looks,
    as_table,
    generated_pages,
    marks,
    with_table,
)
from palpate_studies.study_code import code_hash, study_files

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


def test_generated_tables_are_what_the_kept_results_say() -> None:
    for page, wanted in generated_pages(DOCS).items():
        assert page.read_text() == wanted, f"{page} is stale: run docs/generate_scoreboard.py"


def test_the_first_page_has_no_table_of_results_but_the_generated_one() -> None:
    text = (ROOT / "README.md").read_text()
    begin, end = marks("scoreboard")
    outside = text.split(begin)[0] + text.split(end)[1]
    assert not re.findall(r"^\|.*\d.*\|$", outside, flags=re.MULTILINE)


def test_pages_quote_kept_results() -> None:
    found = quotes(DOCS)
    assert found
    for claim, page, text in found:
        assert text in (DOCS / page).read_text(), f"{claim}: docs/{page} does not say {text!r}"


def test_every_kept_result_says_what_made_it_and_is_used() -> None:
    document = tomllib.loads((DOCS / "claims.toml").read_text())
    rows = [row for kind in ("claim", "finding", "page") for row in document[kind]]
    named = {row[key] for row in rows for key in ("result", "second_result") if key in row}
    assert {one.name for one in read_kept(DOCS)} == named
    for one in read_kept(DOCS):
        assert json.loads((DOCS / "kept" / f"{one.name}.json").read_text())["origin"] in (
            "real",
            "simulated",
        )
        assert one.command.startswith(f"palpate study {one.study}")
        assert one.study in STUDIES
        assert re.fullmatch(r"[0-9a-f]{64}", one.code_sha256)
        assert one.note, f"{one.name} does not say how often it was looked at"


@pytest.fixture
def docs(tmp_path: Path) -> Path:
    (tmp_path / "kept").mkdir()
    keep(
        "one",
        docs=tmp_path,
        command="palpate study one",
        origin="real",
        figures={
            "rows": [
                {"method": "a, b", "error": 0.1234},
                {"method": "c", "error": 0.2, "ends": [1, 3]},
            ],
            "pair": {"difference": -0.1, "low": -0.2, "high": 0.01, "verdict": "undecided"},
        },
        note="Looked at once.",
        code_sha256="1" * 64,
    )
    keep(
        "two",
        docs=tmp_path,
        command="palpate study one --second",
        origin="simulated",
        figures={
            "error": 0.5,
            "pair": {"difference": 0.3, "low": 0.1, "high": 0.4, "verdict": "rival"},
        },
        code_sha256="0" * 64,
    )
    (tmp_path / "claims.toml").write_text(
        '[[claim]]\nname = "x"\nclaim = "error"\nresult = "one"\ncount = "3"\n'
        'ours = "{100*rows[method=a, b]/error:.1f} %"\nrival = "{rows[method=c]/error}"\n'
        'rival_name = "c"\ndifference = "pair"\nverdict = "undecided"\n'
        'quotes = [["page.md", "{rows[method=c]/error:.2f} to {rows[method=c]/ends/1}"]]\n'
        'second_result = "two"\n'
        'second = "{error:.1f}"\nsecond_difference = "pair"\nsecond_verdict = "rival"\n'
        'second_quotes = [["page.md", "second {error:.2f}"]]\n'
        '[[finding]]\nfound = "0.1 is wrong"\nresult = "one"\n'
        'now = "{rows[method=c]/error:.1f}"\n'
        '[[page]]\nresult = "two"\nquotes = [["page.md", "alone {error}"]]\n'
    )
    return tmp_path


def test_what_made_a_result_is_read_and_shown(docs: Path) -> None:
    one, two = read_kept(docs)
    assert (one.name, one.study, two.command) == ("one", "one", "palpate study one --second")
    table = as_looks([one, two])
    assert "`11111111` | Looked at once. |" in table
    assert "`00000000` | - |" in table


def test_a_finding_has_the_figures_of_its_result(docs: Path) -> None:
    table = as_findings(read_findings(docs))
    assert "| 0.1 is wrong | 0.2 | real | `palpate study one` |" in table
    path = docs / "claims.toml"
    path.write_text(path.read_text().replace('now = "{rows[method=c]', 'now = "{rows[method=x]'))
    with pytest.raises(InputError, match=r"0\.1 is wrong: 0 rows"):
        read_findings(docs)


def test_the_code_of_a_study_is_what_it_imports(tmp_path: Path) -> None:
    files = {path.name for path in study_files("rupture")}
    assert {"rupture.py", "damage_learning.py", "errors.py"} <= files
    assert not files & {"scoreboard.py", "controller.py", "report.py", "verbs.py"}
    assert "model.json" in {path.name for path in study_files("bruise")}
    assert "controller.py" in {path.name for path in study_files("size")}
    assert code_hash("rupture") == code_hash("rupture") != code_hash("presses")


def test_figures_are_looked_up_and_scaled(docs: Path) -> None:
    (claim,) = read_claims(docs)
    assert (claim.ours, claim.rival, claim.origin) == ("12.3 %", "0.2", "real")
    assert claim.difference == "-0.100 (-0.200 to +0.010)"
    assert claim.second == "0.5 (difference +0.300, +0.100 to +0.400)"
    assert "| **baseline**: 0.5 (difference" in as_table([claim])
    assert quotes(docs) == [
        ("x", "page.md", "0.20 to 3"),
        ("x", "page.md", "second 0.50"),
        ("two", "page.md", "alone 0.5"),
    ]
    assert "| 12.3 % | 0.2 (c) |" in as_table([claim])


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('verdict = "undecided"', 'verdict = "ours"', "its interval 'undecided'"),
        ('second_verdict = "rival"', 'second_verdict = "ours"', "its interval 'rival'"),
        ("method=c]/error}", "method=d]/error}", "0 rows"),
        ('difference = "pair"', 'difference = "pear"', "no 'pear'"),
        ("ends/1", "ends/2", "no '2'"),
    ],
)
def test_a_claim_that_its_result_does_not_support_is_refused(
    docs: Path, old: str, new: str, complaint: str
) -> None:
    path = docs / "claims.toml"
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(InputError, match=complaint):
        read_claims(docs), quotes(docs)


def test_a_figure_changed_on_a_page_or_in_a_result_is_noticed(tmp_path: Path) -> None:
    shutil.copytree(DOCS / "kept", tmp_path / "kept")
    shutil.copy(DOCS / "claims.toml", tmp_path)
    page = (ROOT / "README.md").read_text()
    path = tmp_path / "kept" / "rupture.json"
    document = json.loads(path.read_text())
    for row in document["figures"]["tradeoff"]:
        row["firmness"] += 0.1
    path.write_text(json.dumps(document))
    assert with_table(page, as_first_table(read_claims(tmp_path))) != page
    with pytest.raises(InputError, match="needs one"):
        with_table("no marks", "")


def test_the_notes_on_the_paper_count_misses_as_the_results_page_does() -> None:
    counted = re.findall(
        r"Missed of (Table \d) by the (family|level) ([\w-]+), within its rounding: (.*)\.",
        (DOCS / "results.md").read_text(),
    )
    assert len(counted) == 7
    notes = (DOCS / "paper-notes.md").read_text()
    for table, of, name, counts in counted:
        found = {word: count for count, word in re.findall(r"(\d+ of \d+) (\w+)", counts)}
        fitted, predicted = found.get("fitted", "-"), found["predicted"]
        assert f"| {table}, {of} `{name}` | {fitted} | {predicted} |" in notes


def test_claims_of_shipped_code_rest_on_the_symbol_that_a_verb_reaches() -> None:
    """The study imports the named class or function from palpate, and so does a command."""
    claims = [
        row for row in tomllib.loads((DOCS / "claims.toml").read_text())["claim"] if "code" in row
    ]
    assert claims
    for row in claims:
        module, symbol = row["code"].split(":")
        public = {one for one, home in palpate._HOMES.items() if home == module}
        study = json.loads((DOCS / "kept" / f"{row['result']}.json").read_text())["command"]
        judged = study_files(study.split()[2])
        in_study = [path for path in judged if "palpate_studies" in path.parts]
        assert any(imports(path, module, symbol, public) for path in in_study), row["name"]
        assert any(imports(path, module, symbol, public) for path in reached()), row["name"]


def imports(path: Path, module: str, symbol: str, public: set[str]) -> bool:
    """Return whether a file imports the symbol from its module, or under its public name."""
    if path.suffix != ".py":
        return False
    return any(
        isinstance(node, ast.ImportFrom)
        and any(
            (node.module == module and one.name == symbol)
            or (node.module == "palpate" and symbol in public and one.name == symbol)
            for one in node.names
        )
        for node in ast.walk(ast.parse(path.read_text()))
    )


def reached() -> list[Path]:
    """Return the files of the product that its commands import, directly or not."""
    commands = (ROOT / "src" / "palpate" / "cli").glob("*.py")
    files, waiting = dict[Path, None](), list(commands)
    while waiting:
        path = waiting.pop()
        if path in files:
            continue
        files[path] = None
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("palpate."):
                place = (ROOT / "src").joinpath(*str(node.module).split("."))
                waiting += [one for one in (place.with_suffix(".py"),) if one.is_file()]
    return list(files)


def test_a_study_that_judges_other_code_is_found(tmp_path: Path) -> None:
    own = tmp_path / "own.py"
    own.write_text("from palpate_studies.force_model import ForceLaw\n")
    module = "palpate.estimate.force_law"
    assert not imports(own, module, "ForceLaw", {"ForceLaw"})
    own.write_text("from palpate import ForceLaw\n")
    assert imports(own, module, "ForceLaw", {"ForceLaw"})
    assert not imports(own, module, "ForceLaw", set())
