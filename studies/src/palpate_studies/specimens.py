"""Which holds are of one specimen, and the holds of a file that can be scored."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from palpate.errors import InputError
from palpate.holds import Hold, read_holds, settled_value

#: When a hold counts as settled (paper, section 2.2).
HORIZON_S = 20.0
#: A part of a name that distinguishes runs of one specimen: `20mm`, `0.3Strain`, `v4`, `h00`.
_RUN_PART = re.compile(r"\d+(\.\d+)?[A-Za-z]+|[vh]\d+")


def settled_holds(file: Path) -> list[Hold]:
    """Return the holds of a file that reach the horizon.

    Raises
    ------
    InputError
        If none does.
    """
    known = [
        hold
        for hold in read_holds(file, until_s=HORIZON_S)
        if np.isfinite(settled_value(hold.time_s, hold.values, horizon_s=HORIZON_S))
    ]
    if not known:
        raise InputError(f"{file}: no hold reaches {HORIZON_S:g} s, so none can be scored")
    return known


def specimen_of(hold_id: str, *, pattern: re.Pattern[str] | None = None) -> str:
    """Return the specimen that a hold is of, from its name.

    The name is cut at the first part (between underscores) that is a number with a unit, a version
    or a hold number; then the run number at the end of a name that begins with a letter is dropped.

    Parameters
    ----------
    hold_id : str
        As in the file.
    pattern : compiled regular expression, optional
        Instead of the rule: its first group, or all it matches, is the specimen.

    Raises
    ------
    InputError
        If the pattern is not found in the name.

    Examples
    --------
    >>> [specimen_of(name) for name in ("1_10_E4pin_20mm_v4_0.3Strain_h00", "test15_h02", "12_h03")]
    ['1_10_E4pin', 'test', '12']
    >>> specimen_of("left_pad_7_h02", pattern=re.compile("[a-z]+_pad"))
    'left_pad'
    """
    if pattern is not None:
        found = pattern.search(hold_id)
        if found is None:
            raise InputError(
                f"--specimen-pattern {pattern.pattern!r} is not found in hold {hold_id}; "
                "give one that fits every hold_id"
            )
        return found.group(1) if pattern.groups else found.group(0)
    first, *others = hold_id.split("_")
    kept = [first]
    for part in others:
        if _RUN_PART.fullmatch(part):
            break
        kept.append(part)
    name = "_".join(kept)
    return name.rstrip("0123456789") if name[0].isalpha() else name
