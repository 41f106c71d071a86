"""Rules in a file that people read: TOML, every fault named by its line."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from palpate.errors import InputError
from palpate.produce.learning import FEWEST_ITEMS, UNKNOWN
from palpate.produce.sorting.conditions import CONDITIONS, Condition, OneOf
from palpate.produce.sorting.rules import CONFIDENCE, MOST_GRASPS, Rule, RuleBook

_TOP_KEYS = ("default", "confidence", "most_grasps", "rule")
_RULE_KEYS = ("bin", *CONDITIONS, "confidence")
_HEADER = re.compile(r"\s*\[\[\s*rule\s*\]\]")


def read_rules(path: str | Path) -> RuleBook:
    """Read a rules file.

    At the top stand ``default``, the bin of whatever no rule takes, and perhaps ``confidence`` and
    ``most_grasps``. Each ``[[rule]]`` has a ``bin`` and at least one of ``class`` and ``ripeness``
    (a name or a list of names), ``size_mm`` and ``firmness`` (``[from, to]``), ``bruised`` (true or
    false), and perhaps a ``confidence`` of its own.

    Raises `InputError` if the file can't be read, a key is not known or a value not possible, or a
    rule can never decide anything; one line with the number of the line.
    """
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
        stated = tomllib.loads(text)
    except OSError as error:
        raise InputError(f"rules file {path}: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"rules file {path}: {error}") from error
    return _Reader(str(path), text).book(stated)


def check_kinds(book: RuleBook, *, taught: Collection[str], path: str | Path) -> None:
    """Refuse a rule for a kind that nobody taught: it would never take anything.

    Raises `InputError`: with the rule's line, and the kinds that are known.
    """
    for rule in book.rules:
        kinds = (one for one in rule.conditions if isinstance(one, OneOf) and one.key == "class")
        for kind in sorted({name for one in kinds for name in one.names} - {UNKNOWN, *taught}):
            raise InputError(
                f"rules file {path} line {rule.line}: class {kind!r} was not taught by "
                f"{FEWEST_ITEMS} labelled items; known are {', '.join(sorted(taught))} and "
                f"{UNKNOWN}"
            )


def refuse_hidden(rules: Sequence[Rule], *, path: str) -> None:
    """Refuse a rule that an earlier one hides, or that overlaps an earlier one in part.

    The first match wins, so an exception comes before the general rule, and that is welcome. A
    rule is unreachable where an earlier one takes all that it takes, as easily. It overlaps where
    both state the same conditions, each takes something the other does not, and what both take
    would go to another bin only by the order of the lines.

    Raises `InputError`: one line with the numbers of both lines.

    >>> from palpate.produce.sorting.conditions import Within
    >>> small = Rule(bin="small", conditions=(Within("size_mm", 0, 45),), line=3)
    >>> large = Rule(bin="large", conditions=(Within("size_mm", 40, 90),), line=7)
    >>> try:
    ...     refuse_hidden([small, large], path="r.toml")
    ... except InputError as error:
    ...     print(str(error).split(", and")[0])
    rules file r.toml line 7: overlaps the rule of line 3 (size_mm 40 to 45 fits both
    """
    for later, rule in enumerate(rules):
        for earlier in rules[:later]:
            if earlier.confidence <= rule.confidence and _is_wider(earlier, rule):
                raise InputError(
                    f"rules file {path} line {rule.line}: no item reaches this rule, because that "
                    f"of line {earlier.line} takes them all; move it up or remove it"
                )
            if common := _half_overlap(earlier, rule):
                raise InputError(
                    f"rules file {path} line {rule.line}: overlaps the rule of line {earlier.line} "
                    f"({common} fits both, and they name different bins); set their ranges apart"
                )


def _is_wider(one: Rule, other: Rule) -> bool:
    """Whether every item that meets the other's conditions meets this one's."""
    theirs = {condition.key: condition for condition in other.conditions}
    return all(ours.key in theirs and ours.covers(theirs[ours.key]) for ours in one.conditions)


def _half_overlap(one: Rule, other: Rule) -> str | None:
    """Return what both rules take, if they ask for the same things and neither holds the other."""
    ours = {condition.key: condition for condition in one.conditions}
    if one.bin == other.bin or set(ours) != {condition.key for condition in other.conditions}:
        return None
    if _is_wider(one, other) or _is_wider(other, one):
        return None
    common = [ours[theirs.key].common(theirs) for theirs in other.conditions]
    return None if None in common else ", ".join(filter(None, common))


class _Reader:
    """One file on its way to rules; it knows which line to blame."""

    def __init__(self, path: str, text: str) -> None:
        self._path, self._lines = path, text.splitlines()
        self._headers = [n for n, line in enumerate(self._lines, 1) if _HEADER.match(line)]

    def book(self, stated: Mapping[str, Any]) -> RuleBook:
        """Return the rules, checked."""
        end = self._headers[0] - 1 if self._headers else len(self._lines)
        self._check_keys(stated, _TOP_KEYS, start=1, end=end)
        tables = stated.get("rule")
        is_list = isinstance(tables, list) and all(isinstance(table, dict) for table in tables)
        if not is_list or not tables:
            raise self._fault(1, "has no [[rule]]; give at least one, with `bin` and a condition")
        if "default" not in stated:
            raise self._fault(1, 'has no default; give one, e.g. default = "by hand"')
        default = self._text(stated, "default", start=1, end=end)
        confidence = self._confidence(stated, CONFIDENCE, start=1, end=end)
        most = stated.get("most_grasps", MOST_GRASPS)
        if not isinstance(most, int) or isinstance(most, bool) or not 1 <= most <= 20:
            raise self._fault(
                self._line("most_grasps", 1, end), f"most_grasps is {most!r}, not 1 to 20"
            )
        rules = tuple(self._rule(n, table, confidence) for n, table in enumerate(tables))
        refuse_hidden(rules, path=self._path)
        return RuleBook(rules=rules, default_bin=default, most_grasps=most)

    def _rule(self, index: int, table: Mapping[str, Any], confidence: float) -> Rule:
        start, end = self._lines_of(index)
        where = {"start": start, "end": end}
        self._check_keys(table, _RULE_KEYS, **where)
        if "bin" not in table:
            raise self._fault(start, "this rule has no bin; state where its items go")
        if not any(key in table for key in CONDITIONS):
            raise self._fault(
                start, f"this rule has no condition; give one of {', '.join(CONDITIONS)}"
            )
        return Rule(
            bin=self._text(table, "bin", **where),
            conditions=tuple(
                self._condition(table, key, **where) for key in CONDITIONS if key in table
            ),
            confidence=self._confidence(table, confidence, **where),
            line=start,
        )

    def _check_keys(
        self, table: Mapping[str, Any], known: tuple[str, ...], *, start: int, end: int
    ) -> None:
        for key in table:
            if key not in known:
                raise self._fault(
                    self._line(key, start, end),
                    f"no key {key!r} here; known are {', '.join(known)}",
                )

    def _text(self, table: Mapping[str, Any], key: str, *, start: int, end: int) -> str:
        found = table[key]
        if not isinstance(found, str) or not found.strip():
            raise self._fault(self._line(key, start, end), f"{key} is {found!r}, not a name")
        return found

    def _condition(self, table: Mapping[str, Any], key: str, *, start: int, end: int) -> Condition:
        try:
            return CONDITIONS[key](key, table[key])
        except ValueError as error:
            line = self._line(key, start, end)
            raise self._fault(line, f"{key} is {table[key]!r}, not {error}") from error

    def _confidence(
        self, table: Mapping[str, Any], default: float, *, start: int, end: int
    ) -> float:
        found = table.get("confidence", default)
        if not isinstance(found, float | int) or not 0.5 <= found < 1:
            raise self._fault(
                self._line("confidence", start, end),
                f"confidence is {found!r}, not from 0.5 up to below 1",
            )
        return float(found)

    def _lines_of(self, index: int) -> tuple[int, int]:
        """Return the first and last line of a rule; all lines for rules in an inline array."""
        if index >= len(self._headers):
            return 1, len(self._lines)
        end = self._headers[index + 1] - 1 if index + 1 < len(self._headers) else len(self._lines)
        return self._headers[index], end

    def _line(self, key: str, start: int, end: int) -> int:
        wanted = re.compile(
            rf"""\s*["']?{re.escape(key)}["']?\s*[=.\]]|\s*\[+\s*{re.escape(key)}"""
        )
        span = range(start, end + 1)
        return next((n for n in span if wanted.match(self._lines[n - 1])), start)

    def _fault(self, line: int, what: str) -> InputError:
        return InputError(f"rules file {self._path} line {line}: {what}")
