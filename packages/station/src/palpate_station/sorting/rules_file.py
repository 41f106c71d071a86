"""Rules in a TOML file; every error names its line."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from palpate.errors import InputError
from palpate_station.learning import FEWEST_ITEMS, UNKNOWN
from palpate_station.sorting.conditions import CONDITIONS, OneOf
from palpate_station.sorting.rules import CONFIDENCE, MOST_GRASPS, Rule, RuleBook

_Value = TypeVar("_Value")

_TOP_KEYS = ("default", "confidence", "most_grasps", "require_item", "rule")
_RULE_KEYS = ("bin", *CONDITIONS, "confidence")
_HEADER = re.compile(r"\s*\[\[\s*rule\s*\]\]")


def read_rules(path: str | Path) -> RuleBook:
    """Read a rules file.

    Top-level keys are ``default``, the bin of items without a rule, and optionally ``confidence``,
    ``most_grasps`` and ``require_item``. Each ``[[rule]]`` has a ``bin`` and at least one
    condition: ``class`` or ``ripeness`` (a name or a list of names), ``size_mm`` or ``firmness``
    (``[from, to]``), or ``bruised`` (true or false). A rule may override ``confidence``.

    Raises `InputError` if the file can't be read, a key is unknown or missing, a value is invalid,
    or a rule never applies or partly overlaps another.
    """
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
        stated = tomllib.loads(text)
    except UnicodeDecodeError as error:
        raise InputError(
            f"rules file {path}: not UTF-8 at byte {error.start}; save it as UTF-8"
        ) from error
    except OSError as error:
        raise InputError(f"rules file {path}: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"rules file {path}: {error}") from error
    lines = text.splitlines()
    starts = [number for number, line in enumerate(lines, 1) if _HEADER.match(line)]
    ends = [*starts, len(lines) + 1]
    defaults = {"confidence": CONFIDENCE, "most_grasps": MOST_GRASPS, "require_item": False}
    stated = defaults | stated
    top = _Section(str(path), lines, range(1, ends[0]), stated)
    top.check_keys(_TOP_KEYS)
    tables = stated.get("rule")
    is_list = isinstance(tables, list) and all(isinstance(table, dict) for table in tables)
    if not is_list or not tables:
        raise top.fault("has no [[rule]]; add at least one, with `bin` and a condition")
    if "default" not in stated:
        raise top.fault('has no default; add one, such as default = "by hand"')
    default = top.read("default", _read_name)
    confidence = top.read("confidence", _read_confidence)
    most = top.read("most_grasps", _read_most_grasps)
    requires_item = top.read("require_item", _read_flag)
    spans = list(map(range, starts, ends[1:]))
    if len(spans) != len(tables):  # an inline array has no [[rule]] headers
        spans = [range(1, len(lines) + 1)] * len(tables)
    rules = tuple(
        _read_rule(_Section(str(path), lines, span, {"confidence": confidence} | table))
        for span, table in zip(spans, tables, strict=True)
    )
    check_reachable(rules, path=str(path))
    return RuleBook(rules=rules, default_bin=default, most_grasps=most, requires_item=requires_item)


def check_kinds(book: RuleBook, *, known_kinds: Collection[str], path: str | Path) -> None:
    """Refuse a rule that names a kind with too few labelled items to be identified.

    Raises `InputError` with the rule's line and the known kinds.
    """
    for fault in unlearned_classes(book, known_kinds=known_kinds, path=path):
        names = ", ".join([*sorted(known_kinds), UNKNOWN])
        raise InputError(f"{fault}; choose one of: {names}")


def unlearned_classes(
    book: RuleBook, *, known_kinds: Collection[str], path: str | Path
) -> Iterator[str]:
    """Yield the place and name of each class with too few labelled items to be identified."""
    for rule in book.rules:
        kinds = (one for one in rule.conditions if isinstance(one, OneOf) and one.key == "class")
        for kind in sorted({name for one in kinds for name in one.names} - {UNKNOWN, *known_kinds}):
            yield (
                f"rules file {path} line {rule.line}: class {kind!r} has fewer than "
                f"{FEWEST_ITEMS} labelled items"
            )


def unknown_stages(
    book: RuleBook, *, known_stages: Collection[str], path: str | Path
) -> Iterator[str]:
    """Yield the place and name of each stage of ripeness that no item has been labelled with."""
    for rule in book.rules:
        stages = (
            one for one in rule.conditions if isinstance(one, OneOf) and one.key == "ripeness"
        )
        for stage in sorted({name for one in stages for name in one.names} - {*known_stages}):
            yield f"rules file {path} line {rule.line}: ripeness {stage!r} is no stage"


def check_reachable(rules: Sequence[Rule], *, path: str) -> None:
    """Refuse a rule that an earlier rule hides or partly overlaps.

    The first match applies, so an exception may precede a general rule. A rule is unreachable if an
    earlier rule accepts all its items with the same or a lower confidence. Two rules overlap partly
    if they have conditions on the same keys and different bins, and each accepts items that the
    other does not. The bin of a common item would then depend only on the order of the lines.

    Raises `InputError` with both line numbers.

    >>> from palpate_station.sorting.conditions import Within
    >>> small = Rule(bin="small", conditions=(Within("size_mm", 0, 45),), line=3)
    >>> large = Rule(bin="large", conditions=(Within("size_mm", 40, 90),), line=7)
    >>> try:
    ...     check_reachable([small, large], path="r.toml")
    ... except InputError as error:
    ...     print(str(error).split(";")[0])
    rules file r.toml line 7: overlaps the rule on line 3 with a different bin (size_mm 40 to 45)
    """
    for later, rule in enumerate(rules):
        for earlier in rules[:later]:
            if earlier.confidence <= rule.confidence and _is_wider(earlier, rule):
                raise InputError(
                    f"rules file {path} line {rule.line}: this rule never applies, because the "
                    f"rule on line {earlier.line} accepts all of its items; move this rule up or "
                    "remove it"
                )
            if common := _partial_overlap(earlier, rule):
                raise InputError(
                    f"rules file {path} line {rule.line}: overlaps the rule on line {earlier.line} "
                    f"with a different bin ({common}); separate the conditions"
                )


def _is_wider(one: Rule, other: Rule) -> bool:
    """Return whether one rule accepts every item that the other accepts."""
    by_key = {condition.key: condition for condition in other.conditions}
    return all(each.key in by_key and each.covers(by_key[each.key]) for each in one.conditions)


def _partial_overlap(one: Rule, other: Rule) -> str | None:
    """Return the overlap of two rules on the same keys, if neither contains the other."""
    by_key = {condition.key: condition for condition in one.conditions}
    if one.bin == other.bin or set(by_key) != {condition.key for condition in other.conditions}:
        return None
    if _is_wider(one, other) or _is_wider(other, one):
        return None
    common = [by_key[second.key].describe_overlap(second) for second in other.conditions]
    return None if None in common else ", ".join(filter(None, common))


@dataclass(frozen=True, slots=True)
class _Section:
    """The top-level keys or one rule of a rules file, with line numbers for errors."""

    path: str
    lines: Sequence[str]
    #: Line numbers of the section.
    span: range
    stated: Mapping[str, Any]

    def fault(self, text: str, *, key: str = "") -> InputError:
        """Return an error with the line of a key, or the first line."""
        pattern = re.compile(
            rf"""\s*["']?{re.escape(key)}["']?\s*[=.\]]|\s*\[+\s*{re.escape(key)}"""
        )
        found = (number for number in self.span if key and pattern.match(self.lines[number - 1]))
        return InputError(f"rules file {self.path} line {next(found, self.span.start)}: {text}")

    def check_keys(self, known: Sequence[str]) -> None:
        """Refuse an unknown key."""
        for key in self.stated:
            if key not in known:
                raise self.fault(f"unknown key {key!r}; choose one of: {', '.join(known)}", key=key)

    def read(self, key: str, reader: Callable[[Any], _Value]) -> _Value:
        """Return the value of a key.

        `reader`: converts the value; raises `ValueError` with the expected form.
        """
        try:
            return reader(self.stated[key])
        except ValueError as error:
            raise self.fault(f"{key} is {self.stated[key]!r}, not {error}", key=key) from error


def _read_rule(section: _Section) -> Rule:
    section.check_keys(_RULE_KEYS)
    if "bin" not in section.stated:
        raise section.fault('this rule has no bin; add one, such as bin = "large"')
    keys = [key for key in CONDITIONS if key in section.stated]
    if not keys:
        raise section.fault(f"this rule has no condition; add one of: {', '.join(CONDITIONS)}")
    return Rule(
        bin=section.read("bin", _read_name),
        conditions=tuple(section.read(key, partial(CONDITIONS[key], key)) for key in keys),
        confidence=section.read("confidence", _read_confidence),
        line=section.span.start,
    )


def _read_name(stated: Any) -> str:
    if not isinstance(stated, str) or not stated.strip():
        raise ValueError("a name")
    return stated


def _read_confidence(stated: Any) -> float:
    if not isinstance(stated, float | int) or not 0.5 <= stated < 1:
        raise ValueError("a number of at least 0.5 and less than 1")
    return float(stated)


def _read_most_grasps(stated: Any) -> int:
    if not isinstance(stated, int) or isinstance(stated, bool) or not 1 <= stated <= 20:
        raise ValueError("a whole number from 1 to 20")
    return stated


def _read_flag(stated: Any) -> bool:
    if not isinstance(stated, bool):
        raise ValueError("true or false")
    return stated
