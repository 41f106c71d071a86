"""The generated tables of README.md and docs/scoreboard.md."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from palpate.errors import InputError
from palpate_studies.scoreboard import (
    Claim,
    Finding,
    Kept,
    read_claims,
    read_findings,
    read_kept,
)

_VERDICTS = {"ours": "palpate", "rival": "baseline", "undecided": "undecided"}


def generated_pages(docs: Path) -> dict[Path, str]:
    """Return README.md and the scoreboard with their tables made from the kept results."""
    claims, readme, scoreboard = (
        read_claims(docs),
        docs.parent / "README.md",
        docs / "scoreboard.md",
    )
    page = with_table(scoreboard.read_text(), as_table(claims))
    page = with_table(page, as_findings(read_findings(docs)), name="findings")
    page = with_table(page, as_looks(read_kept(docs)), name="looks")
    return {readme: with_table(readme.read_text(), as_first_table(claims)), scoreboard: page}


def as_table(claims: Sequence[Claim]) -> str:
    """Return the Markdown table of all claims, for the scoreboard."""
    columns = ("claim", "", "n", "palpate", "strongest baseline", "difference (90 %)", "better")
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
    return _markdown(
        ("", "n", "palpate", "strongest baseline", "better; on simulated others"), rows
    )


def _markdown(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    lines += ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
    return "\n".join(lines)


def as_findings(findings: Sequence[Finding]) -> str:
    """Return the Markdown table of what was criticised."""
    rows = [(one.found, one.now, one.origin, f"`{one.command}`") for one in findings]
    return _markdown(("found", "now", "", "command"), rows)


def as_looks(kept: Sequence[Kept]) -> str:
    """Return the Markdown table of what made each kept result, and of the looks at it."""
    rows = [
        (f"`{one.name}`", one.made_on, f"`{one.code_sha256[:8]}`", one.note or "-") for one in kept
    ]
    return _markdown(("result", "made on", "code", "seeds and looks"), rows)


def with_table(page: str, table: str, *, name: str = "scoreboard") -> str:
    """Return a page with the table between the marks of this name.

    Raises
    ------
    InputError
        If the page has no such marks, or more than one pair.

    Examples
    --------
    >>> begin, end = marks("scoreboard")
    >>> with_table(f"a\\n{begin}\\nold\\n{end}\\nb", "new").split("\\n")[2:5]
    ['', 'new', '']
    """
    begin, end = marks(name)
    if page.count(begin) != 1 or page.count(end) != 1:
        raise InputError(f"a page needs one {begin} and one {end}")
    before, rest = page.split(begin)
    after = rest.split(end)[1]
    return f"{before}{begin}\n\n{table}\n\n{end}{after}"


def marks(name: str) -> tuple[str, str]:
    """Return the lines between which a page holds a table, and nothing else."""
    return f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
