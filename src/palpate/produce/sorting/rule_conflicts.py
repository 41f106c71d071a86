"""Rules that no item can reach, and rules whose ranges overlap in part."""

from __future__ import annotations

from collections.abc import Sequence

from palpate.errors import InputError
from palpate.produce.sorting.rules import Rule


def refuse_hidden(rules: Sequence[Rule], *, path: str) -> None:
    """Refuse a rule that an earlier one hides, or that overlaps an earlier one in part.

    The first match wins, so an exception comes before the general rule, and that is welcome. A
    rule is unreachable where an earlier one takes all that it takes, as easily. It overlaps where
    both state the same conditions, each takes something the other does not, and what both take
    would go to another bin only by the order of the lines.

    Raises `InputError`: one line with the numbers of both lines.

    >>> from palpate.produce.sorting.conditions import SizeWithin
    >>> small = Rule(bin="small", conditions=(SizeWithin(low=0, high=45),), line=3)
    >>> large = Rule(bin="large", conditions=(SizeWithin(low=40, high=90),), line=7)
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
    return all(
        any(type(theirs) is type(ours) and ours.covers(theirs) for theirs in other.conditions)
        for ours in one.conditions
    )


def _half_overlap(one: Rule, other: Rule) -> str | None:
    """Return what both rules take, if they ask for the same things and neither holds the other."""
    pairs = {type(ours): ours for ours in one.conditions}
    if one.bin == other.bin or set(pairs) != {type(theirs) for theirs in other.conditions}:
        return None
    if _wider(one, other) or _wider(other, one):
        return None
    common = [pairs[type(theirs)].common(theirs) for theirs in other.conditions]
    return None if None in common else ", ".join(filter(None, common))
