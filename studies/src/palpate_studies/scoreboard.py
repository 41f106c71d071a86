"""The scoreboard: every claim as data, its figures taken from kept results of studies.

`docs/claims.toml` states what is claimed; `docs/kept/NAME.json` holds what a study gave, with its
command, seeds, date and the hash of the code that ran. A figure on a page that neither gives fails
a test. Studies take minutes to hours, so they are not run again there; `keep` writes a new result.
"""

from __future__ import annotations

import hashlib
import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import palpate
import palpate_studies
from palpate.errors import InputError
from palpate.files import atomic_path

#: Between these lines a page holds the claims' table, and nothing else.
BEGIN, END = "<!-- scoreboard: begin -->", "<!-- scoreboard: end -->"
_PART = re.compile(r"([^/\[\]]+)(?:\[([^\]]*)\])?")
_VERDICTS = {"ours": "ours", "rival": "the rival", "undecided": "undecided"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """One row of the scoreboard, as text.

    Attributes
    ----------
    name, claim : str
        For reference, and in words, with the unit.
    origin : str
        ``"real"`` or ``"simulated"``.
    count : str
        How many of what.
    ours, rival, rival_name : str
        Both figures, and what the strongest rival is.
    difference : str
        Ours less the rival with its interval; empty where nothing was paired.
    verdict : str
        Who is better: ``ours``, ``rival`` or ``undecided``.
    second : str
        The figure on a second generator or other specimens; empty if there is none yet.
    second_verdict : str
        Who is better there: ``ours``, ``rival`` or ``undecided``; empty if nothing was compared.
    command, note : str
        What regenerates it, and what else must be stated.
    first_page : bool
        Whether README.md shows it too.
    """

    name: str
    claim: str
    origin: str
    count: str
    ours: str
    rival: str
    rival_name: str
    difference: str
    verdict: str
    second: str
    second_verdict: str
    command: str
    note: str
    first_page: bool


def read_claims(docs: Path) -> list[Claim]:
    """Read the claims, with every figure taken from its kept result.

    Raises
    ------
    InputError
        If a claim names a figure that its result does not hold, or a verdict that its interval does
        not support.
    """
    rows = tomllib.loads((docs / "claims.toml").read_text())["claim"]
    return [_claim(row, docs) for row in rows]


def quotes(docs: Path) -> list[tuple[str, str, str]]:
    """Return claim, page and text that the page has to hold, figures filled in."""
    rows = tomllib.loads((docs / "claims.toml").read_text())["claim"]
    return [
        (row["name"], page, _filled(text, _kept(docs, row[result])["figures"], claim=row["name"]))
        for row in rows
        for result, quoted in (("result", "quotes"), ("second_result", "second_quotes"))
        for page, text in row.get(quoted, [])
    ]


def _claim(row: Mapping[str, Any], docs: Path) -> Claim:
    kept = _kept(docs, row["result"])

    def filled(key: str) -> str:
        return _filled(row.get(key, ""), kept["figures"], claim=row["name"])

    verdict, difference = row["verdict"], ""
    if "difference" in row:
        ends = _compared(row, "difference", kept["figures"], verdict=verdict)
        difference = "{} ({} to {})".format(*ends)
    second, second_verdict = row.get("second", ""), row.get("second_verdict", "")
    if "second_result" in row:
        figures = _kept(docs, row["second_result"])["figures"]
        second = _filled(second, figures, claim=row["name"])
        if "second_difference" in row:
            ends = _compared(row, "second_difference", figures, verdict=second_verdict)
            second += " (difference {}, {} to {})".format(*ends)
    return Claim(
        name=row["name"],
        claim=row["claim"],
        origin=kept["origin"],
        count=filled("count"),
        ours=filled("ours"),
        rival=filled("rival"),
        rival_name=filled("rival_name"),
        difference=difference,
        verdict=verdict,
        second=second,
        second_verdict=second_verdict,
        command=kept["command"],
        note=filled("note"),
        first_page=row.get("first_page", False),
    )


def _compared(row: Mapping[str, Any], key: str, figures: Any, *, verdict: str) -> list[str]:
    """Return a difference and the ends of its interval as text.

    Raises
    ------
    InputError
        If the claim states another verdict than the interval supports.
    """
    found = _looked_up(row[key], figures, claim=row["name"])
    if found["verdict"] != verdict:
        raise InputError(
            f"claims.toml: {row['name']} says {verdict!r}, its interval {found['verdict']!r}"
        )
    scale, form = row.get("scale", 1.0), row.get("form", "+.3f")
    return [f"{scale * found[end]:{form}}" for end in ("difference", "low", "high")]


def _kept(docs: Path, name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((docs / "kept" / f"{name}.json").read_text())
    return found


def _filled(text: str, figures: Any, *, claim: str) -> str:
    """Put figures in place of `{path}` or `{path:form}`, or `{100*path:form}`."""

    def put(match: re.Match[str]) -> str:
        path, _, form = match.group(1).partition(":")
        scale = 1.0
        if "*" in path:
            factor, path = path.split("*", 1)
            scale = float(factor)
        value = _looked_up(path, figures, claim=claim)
        return f"{scale * value:{form}}" if form else f"{value}"

    return re.sub(r"\{([^}]*)\}", put, text)


def _looked_up(path: str, figures: Any, *, claim: str) -> Any:
    """Follow a path such as ``rows[method=ours;rate=0.05]/firmness``."""
    found = figures
    for part in path.split("/"):
        match = _PART.fullmatch(part)
        if match is None or not isinstance(found, dict) or match.group(1) not in found:
            raise InputError(f"claims.toml: {claim}: no {part!r} of {path!r} in its result")
        found = found[match.group(1)]
        if match.group(2) is not None:
            wanted = dict(pair.split("=", 1) for pair in match.group(2).split(";"))
            chosen = [one for one in found if all(str(one.get(k)) == v for k, v in wanted.items())]
            if len(chosen) != 1:
                raise InputError(f"claims.toml: {claim}: {len(chosen)} rows for {part!r}")
            found = chosen[0]
    return found


def keep(
    name: str,
    *,
    docs: Path,
    command: str,
    origin: str,
    figures: Mapping[str, Any],
    note: str = "",
    code_sha256: str | None = None,
) -> Path:
    """Write what a study gave to `docs/kept`, with what made it.

    Parameters
    ----------
    name : str
        Of the result.
    docs : Path
        The folder of the pages.
    command : str
        What regenerates it.
    origin : {"real", "simulated"}
        Of the data.
    figures : mapping
        The part of the study's JSON that claims may quote.
    note : str
        Seeds, looks, and what was cut short.
    code_sha256 : str, optional
        `code_hash` when the study began; without, the present one.
    """
    document = {
        "command": command,
        "origin": origin,
        "made_on": date.today().isoformat(),
        "code_sha256": code_sha256 or code_hash(),
        "note": note,
        "figures": figures,
    }
    path = docs / "kept" / f"{name}.json"
    with atomic_path(path) as partial:
        partial.write_text(json.dumps(document, allow_nan=False, indent=1) + "\n")
    return path


def code_hash() -> str:
    """Return the SHA-256 of all Python files of product and studies, by path."""
    found = hashlib.sha256()
    for package in (palpate, palpate_studies):
        root = Path(str(package.__file__)).parent
        for path in sorted(root.rglob("*.py")):
            found.update(str(path.relative_to(root)).encode() + path.read_bytes())
    return found.hexdigest()


def as_table(claims: Sequence[Claim]) -> str:
    """Return the Markdown table of all claims, for the scoreboard."""
    columns = ("claim", "", "n", "ours", "strongest rival", "difference (90 %)", "better")
    rows = [
        (
            one.claim + (f" ({one.note})" if one.note else ""),
            one.origin,
            one.count,
            one.ours,
            f"{one.rival} ({one.rival_name})",
            one.difference or "not paired",
            _VERDICTS[one.verdict],
            _with_verdict(one) or "none yet",
            f"`{one.command}`",
        )
        for one in claims
    ]
    return _markdown((*columns, "second generator", "command"), rows)


def _with_verdict(one: Claim) -> str:
    """Return the second generator's figures, led by who is better there."""
    if not one.second_verdict:
        return one.second
    return f"**{_VERDICTS[one.second_verdict]}**: {one.second}"


def as_first_table(claims: Sequence[Claim]) -> str:
    """Return the Markdown table of the few claims that the first page shows."""
    rows = [
        (
            one.claim,
            one.count,
            one.ours,
            f"{one.rival} ({one.rival_name})",
            f"{_VERDICTS[one.verdict]}; {_VERDICTS.get(one.second_verdict, 'not compared')}",
        )
        for one in claims
        if one.first_page
    ]
    return _markdown(("", "n", "ours", "strongest rival", "better; on simulated others"), rows)


def _markdown(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    lines += ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
    return "\n".join(lines)


def with_table(page: str, table: str) -> str:
    """Return a page with the table between its marks.

    Raises
    ------
    InputError
        If the page has no marks, or more than one pair.

    Examples
    --------
    >>> with_table(f"a\\n{BEGIN}\\nold\\n{END}\\nb", "new").split("\\n")[2:5]
    ['', 'new', '']
    """
    if page.count(BEGIN) != 1 or page.count(END) != 1:
        raise InputError(f"a page needs one {BEGIN} and one {END}")
    before, rest = page.split(BEGIN)
    after = rest.split(END)[1]
    return f"{before}{BEGIN}\n\n{table}\n\n{END}{after}"
