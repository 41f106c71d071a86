"""The scoreboard: every claim as data, its figures taken from kept results of studies.

`docs/claims.toml` states what is claimed, what was criticised, and what pages quote;
`docs/kept/NAME.json` holds what a study gave, with its command, seeds, date and the hash of its
code. A figure on a page that neither gives fails a test. Studies take minutes to hours, so they are
not run again there; `keep` writes a new result.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

from palpate.errors import InputError
from palpate.files import atomic_path

_PART = re.compile(r"([^/\[\]]+)(?:\[([^\]]*)\])?")


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One point of criticism, and what its command gives now.

    Attributes
    ----------
    found, now : str
        What was found, and the figures of the kept result in words.
    command : str
        What regenerates them.
    origin : str
        ``"real"``, ``"simulated"``, or ``"printed"``: from published numbers alone.
    """

    found: str
    now: str
    command: str
    origin: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Kept:
    """A kept result without its figures: what made it, and how often it was looked at."""

    name: str
    command: str
    made_on: str
    code_sha256: str
    note: str

    @property
    def study(self) -> str:
        """The study that gave it."""
        return self.command.split()[2]


def read_kept(docs: Path) -> list[Kept]:
    """Read what made every kept result, by name."""
    return [
        Kept(
            name=path.stem,
            **{key: one[key] for key in ("command", "made_on", "code_sha256", "note")},
        )
        for path in sorted((docs / "kept").glob("*.json"))
        for one in [_kept(docs, path.stem)]
    ]


def read_findings(docs: Path) -> list[Finding]:
    """Read the points of criticism, with every figure taken from its kept result.

    Raises
    ------
    InputError
        If one names a figure that its result does not hold.
    """
    return [
        Finding(
            found=row["found"],
            now=_filled(row["now"], kept["figures"], claim=row["found"]),
            command=row.get("command", kept["command"]),
            origin=row.get("origin", kept["origin"]),
        )
        for row in _rows(docs, "finding")
        for kept in [_kept(docs, row["result"])]
    ]


def read_claims(docs: Path) -> list[Claim]:
    """Read the claims, with every figure taken from its kept result.

    Raises
    ------
    InputError
        If a claim names a figure that its result does not hold, or a verdict that its interval does
        not support.
    """
    return [_claim(row, docs) for row in _rows(docs, "claim")]


def quotes(docs: Path) -> list[tuple[str, str, str]]:
    """Return claim or result, page and text that the page has to hold, figures filled in."""
    return [
        (name, page, _filled(text, _kept(docs, row[result])["figures"], claim=name))
        for row in (*_rows(docs, "claim"), *_rows(docs, "page"))
        for name in [row.get("name", row["result"])]
        for result, quoted in (("result", "quotes"), ("second_result", "second_quotes"))
        for page, text in row.get(quoted, [])
    ]


def _rows(docs: Path, kind: str) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = tomllib.loads((docs / "claims.toml").read_text()).get(kind, [])
    return rows


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
    """Follow a path such as ``rows[method=ours;rate=0.05]/firmness`` or ``interval/0``."""
    found = figures
    for part in path.split("/"):
        if isinstance(found, list) and part.isdecimal() and int(part) < len(found):
            found = found[int(part)]
            continue
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
    code_sha256: str,
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
    code_sha256 : str
        `study_code.code_hash` of the study when it began.
    """
    document = {
        "command": command,
        "origin": origin,
        "made_on": date.today().isoformat(),
        "code_sha256": code_sha256,
        "note": note,
        "figures": figures,
    }
    path = docs / "kept" / f"{name}.json"
    with atomic_path(path) as partial:
        partial.write_text(json.dumps(document, allow_nan=False, indent=1) + "\n")
    return path
