"""Rules that no item can reach, and rules whose ranges overlap in part."""

from __future__ import annotations

from collections.abc import Sequence

from palpate.errors import InputError
from palpate.produce.sorting.rules import Rule, Span


def refuse_hidden(rules: Sequence[Rule], *, path: str) -> None:
    """Refuse a rule that an earlier one hides, or that overlaps an earlier one in part.

    The first match wins, so an exception comes before the general rule, and that is welcome. A
    rule is unreachable where an earlier one takes all that it takes, as easily. It overlaps where
    both state the same conditions, each takes something the other does not, and what both take
    would go to another bin only by the order of the lines.

    Raises `InputError`: one line with the numbers of both lines.

    >>> small = Rule(bin="small", size_mm=Span(low=0, high=45), line=3)
    >>> large = Rule(bin="large", size_mm=Span(low=40, high=90), line=7)
    >>> try:
    ...     refuse_hidden([small, large], path="r.toml")
    ... except InputError as error:
    ...     print(str(error).split(", and")[0])
    rules file r.toml line 7: overlaps the rule of line 3 (size_mm 40 to 45 fits both
    """
    for later, rule in enumerate(rules):
        for earlier in rules[:later]:
            if _takes_all_of(earlier, rule):
                raise InputError(
                    f"rules file {path} line {rule.line}: no item reaches this rule, because that "
                    f"of line {earlier.line} takes them all; move it up or remove it"
                )
            if common := _half_overlap(earlier, rule):
                raise InputError(
                    f"rules file {path} line {rule.line}: overlaps the rule of line {earlier.line} "
                    f"({common} fits both, and they name different bins); set their ranges apart"
                )


def _takes_all_of(one: Rule, other: Rule) -> bool:
    return one.confidence <= other.confidence and _wider(one, other)


def _wider(one: Rule, other: Rule) -> bool:
    """Whether every item that meets the other's conditions meets this one's."""
    return (
        _names_within(other.kinds, one.kinds)
        and _names_within(other.ripeness, one.ripeness)
        and (
            one.size_mm is None or (other.size_mm is not None and other.size_mm.within(one.size_mm))
        )
        and (one.bruised is None or one.bruised == other.bruised)
    )


def _names_within(inner: frozenset[str] | None, outer: frozenset[str] | None) -> bool:
    return outer is None or (inner is not None and inner <= outer)


def _half_overlap(one: Rule, other: Rule) -> str | None:
    """Return what both rules take, if they ask for the same things and neither holds the other."""
    if one.bin == other.bin or _stated(one) != _stated(other):
        return None
    if _wider(one, other) or _wider(other, one) or one.bruised != other.bruised:
        return None
    common = []
    for name, ours, theirs in (
        ("class", one.kinds, other.kinds),
        ("ripeness", one.ripeness, other.ripeness),
    ):
        if ours is not None and theirs is not None:
            if not ours & theirs:
                return None
            common.append(f"{name} {', '.join(sorted(ours & theirs))}")
    if one.size_mm is not None and other.size_mm is not None:
        if not one.size_mm.meets(other.size_mm):
            return None
        shared = _common(one.size_mm, other.size_mm)
        common.append(f"size_mm {shared.low:g} to {shared.high:g}")
    return ", ".join(common)


def _stated(rule: Rule) -> tuple[bool, ...]:
    return tuple(
        condition is not None
        for condition in (rule.kinds, rule.size_mm, rule.ripeness, rule.bruised)
    )


def _common(one: Span, other: Span) -> Span:
    return Span(low=max(one.low, other.low), high=min(one.high, other.high))
