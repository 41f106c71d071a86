"""Generate the claims of README.md and docs/results.md from stored results of studies.

`docs/claims.toml` contains the claims, `docs/kept/results.md.in` the template of the results page,
and `docs/kept/NAME.json` the figures of one run, as `docs/results.toml` states it. Studies take
minutes to hours, so the pages are generated from stored results. A figure of a result with
`earlier` in `docs/results.toml` is marked.
"""

from __future__ import annotations

import re
import tomllib
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any, TypeAlias

from palpate.errors import InputError
from palpate_studies.stored_results import Recipe, read_recipes, read_result

_PART = re.compile(r"([^/\[\]]+)(?:\[([^\]]*)\])?")
_VERDICTS = {"ours": "palpate", "rival": "baseline", "undecided": "undecided"}
#: Keys in claims.toml whose texts contain figures.
_FILLED = ("count", "ours", "rival", "rival_name", "note")
#: Marks of a figure that the present code did not make, in a table of claims and in a text.
_EARLIER, _EARLIER_MARK = " (of an earlier version)", "†"


#: A row of the table of claims with its figures: the keys of `claims.toml`, and `study`, `origin`
#: ("real" or "simulated"), `difference` (palpate minus the baseline with its interval; empty if the
#: cases are not paired) and `second` (the better method and the figure on the second generator; may
#: be empty).
Claim: TypeAlias = Mapping[str, Any]


def generate_pages(docs: Path) -> dict[Path, str]:
    """Return README.md and the results page with the stored figures."""
    claims, readme = read_claims(docs), docs.parent / "README.md"
    page = (docs / "kept" / "results.md.in").read_text(encoding="utf-8")
    for origin in ("real", "simulated"):
        chosen = [one for one in claims if one["origin"] == origin]
        page = page.replace(f"{{{{claims {origin}}}}}", claims_table(chosen))
    return {
        readme: insert_table(readme.read_text(encoding="utf-8"), first_page_table(claims)),
        docs / "results.md": fill_page(page, docs),
    }


def fill_page(text: str, docs: Path) -> str:
    """Replace `{{RESULT|path:format}}` with figures; a list is replaced with its median.

    `{{earlier}}` is replaced with the results of earlier versions, whose figures are marked.

    Raises
    ------
    InputError
        If a result does not contain a figure.
    """
    recipes = read_recipes(docs)

    def substitute(match: re.Match[str]) -> str:
        figures = read_result(docs, match[1])["figures"]
        mark = _EARLIER_MARK if recipes[match[1]].earlier else ""
        return _fill(f"{{{match[2]}}}", figures, claim="results.md.in") + mark

    text = text.replace("{{earlier}}", _list_earlier(recipes))
    return re.sub(r"\{\{([\w-]+)\|([^}]*)\}\}", substitute, text)


def _list_earlier(recipes: Mapping[str, Recipe]) -> str:
    """Return the line about marked figures; empty without any."""
    names = defaultdict[str, list[str]](list)
    for one in recipes.values():
        if one.earlier:
            names[one.earlier].append(f"`{one.name}`")
    if not names:
        return ""
    parts = [f"{', '.join(of)} ({reason})" for reason, of in names.items()]
    return f"\n- *{_EARLIER_MARK}*: of an earlier version of palpate: {'; '.join(parts)}."


def read_claims(docs: Path) -> list[Claim]:
    """Read the claims, and fill in the figures of the stored results.

    Raises
    ------
    InputError
        If a result lacks a figure of its claim, or its interval does not support the verdict.
    """
    document = tomllib.loads((docs / "claims.toml").read_text(encoding="utf-8"))
    recipes = read_recipes(docs)
    return [_read_claim(row, docs, recipes) for row in document["claim"]]


def _read_claim(row: Mapping[str, Any], docs: Path, recipes: Mapping[str, Recipe]) -> Claim:
    recipe, kept = recipes[row["result"]], read_result(docs, row["result"])
    verdict, difference, second = row["verdict"], "", ""
    if "difference" in row:
        ends = _compare(row, "difference", kept["figures"], verdict=verdict)
        difference = "{} ({} to {})".format(*ends)
    if "second_result" in row:
        figures = read_result(docs, row["second_result"])["figures"]
        second = _fill(row["second"], figures, claim=row["name"])
        better = row["second_verdict"]
        ends = _compare(row, "second_difference", figures, verdict=better)
        second = f"**{_VERDICTS[better]}**: {second} ({{}}, {{}} to {{}})".format(*ends)
        second += _EARLIER if recipes[row["second_result"]].earlier else ""
    filled = {key: _fill(row.get(key, ""), kept["figures"], claim=row["name"]) for key in _FILLED}
    return {
        **row,
        **filled,
        "ours": filled["ours"] + (_EARLIER if recipe.earlier else ""),
        "study": recipe.study.split()[0],
        "origin": recipe.origin,
        "difference": difference,
        "second": second,
    }


def _compare(row: Mapping[str, Any], key: str, figures: Any, *, verdict: str) -> list[str]:
    """Return a difference and its interval; refuse an unsupported verdict."""
    found = _look_up(row[key], figures, claim=row["name"])
    if found["verdict"] != verdict:
        raise InputError(
            f"claims.toml: {row['name']} states {verdict!r}, its interval {found['verdict']!r}; "
            "correct the verdict"
        )
    scale, form = row.get("scale", 1.0), row.get("form", "+.3f")
    return [f"{scale * found[end]:{form}}" for end in ("difference", "low", "high")]


def _fill(text: str, figures: Any, *, claim: str) -> str:
    """Replace `{path}`, `{path:format}` or `{100*path:format}` with figures."""

    def substitute(match: re.Match[str]) -> str:
        path, _, form = match.group(1).partition(":")
        factor, star, rest = path.partition("*")
        value = _look_up(rest if star else path, figures, claim=claim)
        if isinstance(value, list):
            value = median(value)
        return f"{float(factor if star else 1) * value:{form}}" if form else f"{value}"

    return re.sub(r"\{([^}]*)\}", substitute, text)


def _look_up(path: str, figures: Any, *, claim: str) -> Any:
    """Follow a path such as ``rows[method=ours;rate=0.05]/firmness`` or ``interval/0``."""
    found = figures
    for part in path.split("/"):
        if isinstance(found, list) and part.isdecimal() and int(part) < len(found):
            found = found[int(part)]
            continue
        match = _PART.fullmatch(part)
        if match is None or not isinstance(found, dict) or match.group(1) not in found:
            raise InputError(f"claims.toml: {claim}: the result has no {part!r} for {path!r}")
        found = found[match.group(1)]
        if match.group(2) is not None:
            wanted = dict(pair.split("=", 1) for pair in match.group(2).split(";"))
            chosen = [one for one in found if all(str(one.get(k)) == v for k, v in wanted.items())]
            if len(chosen) != 1:
                raise InputError(
                    f"claims.toml: {claim}: {part!r} matches {len(chosen)} rows; it must match one"
                )
            found = chosen[0]
    return found


def claims_table(claims: Sequence[Claim]) -> str:
    """Return the Markdown table of claims for the results page."""
    rows = [
        (
            f"{one['claim']} ({one['note']})".replace(") (", "; ") if one["note"] else one["claim"],
            f"{one['count']}; {one['held']}; `{one['study']}`",
            one["ours"],
            f"{one['rival']} ({one['rival_name']})",
            f"**{_VERDICTS[one['verdict']]}**: {one['difference'] or 'not paired'}",
            one["second"],
        )
        for one in claims
    ]
    head = ("claim", "n; held out by; study", "palpate", "strongest baseline")
    return _markdown((*head, "better: difference (90 %)", "second generator"), rows)


def first_page_table(claims: Sequence[Claim]) -> str:
    """Return the Markdown table of the claims in README.md."""
    rows = [
        (
            one["claim"],
            one["count"],
            one["ours"],
            f"{one['rival']} ({one['rival_name']})",
            _VERDICTS[one["verdict"]],
        )
        for one in claims
        if one.get("first_page")
    ]
    return _markdown(("", "n", "palpate", "strongest baseline", "better"), rows)


def _markdown(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    lines += ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
    return "\n".join(lines)


def insert_table(page: str, table: str) -> str:
    """Return a page with the table of claims between its marks.

    Raises
    ------
    InputError
        If the page does not have exactly one pair of marks.

    Examples
    --------
    >>> begin, end = MARKS
    >>> insert_table(f"a\\n{begin}\\nold\\n{end}\\nb", "new").split("\\n")[2:5]
    ['', 'new', '']
    """
    begin, end = MARKS
    if page.count(begin) != 1 or page.count(end) != 1:
        raise InputError(f"a page needs exactly one {begin} and one {end}")
    before, rest = page.split(begin)
    after = rest.split(end)[1]
    return f"{before}{begin}\n\n{table}\n\n{end}{after}"


#: Lines of README.md before and after the table of claims.
MARKS = ("<!-- scoreboard: begin -->", "<!-- scoreboard: end -->")
