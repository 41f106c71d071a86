"""Pages say what the kept results of studies say, or the build fails."""

from __future__ import annotations

import json
import re
import shutil
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from palpate.errors import InputError
from palpate_studies.scoreboard import (
    BEGIN,
    END,
    Claim,
    as_first_table,
    as_table,
    code_hash,
    keep,
    quotes,
    read_claims,
    with_table,
)

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


@pytest.mark.parametrize(
    ("page", "table"), [(ROOT / "README.md", as_first_table), (DOCS / "scoreboard.md", as_table)]
)
def test_the_tables_of_claims_are_what_the_kept_results_say(
    page: Path, table: Callable[[Sequence[Claim]], str]
) -> None:
    text = page.read_text()
    wanted = with_table(text, table(read_claims(DOCS)))
    assert text == wanted, f"{page} is stale: run python docs/generate_scoreboard.py"


def test_the_first_page_has_no_table_of_results_but_the_generated_one() -> None:
    text = (ROOT / "README.md").read_text()
    outside = text.split(BEGIN)[0] + text.split(END)[1]
    assert not re.findall(r"^\|.*\d.*\|$", outside, flags=re.MULTILINE)


def test_pages_quote_kept_results() -> None:
    found = quotes(DOCS)
    assert found
    for claim, page, text in found:
        assert text in (DOCS / page).read_text(), f"{claim}: docs/{page} does not say {text!r}"


def test_every_kept_result_says_what_made_it_and_is_used() -> None:
    rows = tomllib.loads((DOCS / "claims.toml").read_text())["claim"]
    named = {row[key] for row in rows for key in ("result", "second_result") if key in row}
    for path in sorted((DOCS / "kept").glob("*.json")):
        document = json.loads(path.read_text())
        assert document["origin"] in ("real", "simulated")
        assert document["command"].startswith("palpate study ")
        assert re.fullmatch(r"[0-9a-f]{64}", document["code_sha256"] or 64 * "0")
        assert (document["code_sha256"] is None) == path.stem.startswith("earlier-")
        assert path.stem in named
    for claim in read_claims(DOCS):
        assert claim.verdict in ("ours", "rival", "undecided")
        if claim.name in {row["name"] for row in rows if row["result"].startswith("earlier-")}:
            assert "earlier" in claim.note or claim.verdict == "rival"


@pytest.fixture
def docs(tmp_path: Path) -> Path:
    (tmp_path / "kept").mkdir()
    keep(
        "one",
        docs=tmp_path,
        command="palpate study one",
        origin="real",
        figures={
            "rows": [{"method": "a, b", "error": 0.1234}, {"method": "c", "error": 0.2}],
            "pair": {"difference": -0.1, "low": -0.2, "high": 0.01, "verdict": "undecided"},
        },
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
        'quotes = [["page.md", "{rows[method=c]/error:.2f}"]]\nsecond_result = "two"\n'
        'second = "{error:.1f}"\nsecond_difference = "pair"\nsecond_verdict = "rival"\n'
        'second_quotes = [["page.md", "second {error:.2f}"]]\n'
    )
    return tmp_path


def test_a_kept_result_has_the_hash_of_the_code_that_ran(docs: Path) -> None:
    hashes = [
        json.loads((docs / "kept" / f"{name}.json").read_text())["code_sha256"]
        for name in ("one", "two")
    ]
    assert hashes == [code_hash(), "0" * 64]


def test_figures_are_looked_up_and_scaled(docs: Path) -> None:
    (claim,) = read_claims(docs)
    assert (claim.ours, claim.rival, claim.origin) == ("12.3 %", "0.2", "real")
    assert claim.difference == "-0.100 (-0.200 to +0.010)"
    assert claim.second == "0.5 (difference +0.300, +0.100 to +0.400)"
    assert "| **the rival**: 0.5 (difference" in as_table([claim])
    assert quotes(docs) == [("x", "page.md", "0.20"), ("x", "page.md", "second 0.50")]
    assert "| 12.3 % | 0.2 (c) |" in as_table([claim])


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('verdict = "undecided"', 'verdict = "ours"', "its interval 'undecided'"),
        ('second_verdict = "rival"', 'second_verdict = "ours"', "its interval 'rival'"),
        ("method=c]/error}", "method=d]/error}", "0 rows"),
        ('difference = "pair"', 'difference = "pear"', "no 'pear'"),
    ],
)
def test_a_claim_that_its_result_does_not_support_is_refused(
    docs: Path, old: str, new: str, complaint: str
) -> None:
    path = docs / "claims.toml"
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(InputError, match=complaint):
        read_claims(docs)


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
