"""Answers of methods on crates, counted: tables, confusion, reliability."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from palpate.produce.identify.identifier import UNKNOWN, Identity
from palpate_studies.identify_data import SORTED_GRASPS, CrateItemGrasps
from palpate_studies.report import Table

#: Edges of the classes of stated probability in the reliability plot.
_RELIABILITY_EDGES = (0.0, 0.5, 0.7, 0.85, 0.95, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """The answer of one method on one item."""

    level: str
    method: str
    item: CrateItemGrasps
    said: str
    identity: Identity | None = None


def counted(answers: Sequence[Answer]) -> dict[str, Any]:
    """Return shares of known items and strangers that one method named rightly."""
    known = [one for one in answers if one.item.known]
    strangers = [one for one in answers if not one.item.known]
    named = [one for one in known if one.said != UNKNOWN]
    best = [_best_guess(one) == one.item.kind for one in known]
    ours = [one for one in known if one.identity is not None]
    return {
        "level": answers[0].level,
        "method": answers[0].method,
        "items": len(known),
        "right": float(np.mean(best)),
        "named_right": float(np.mean([one.said == one.item.kind for one in named])),
        "log_loss": (
            float(np.mean([-np.log(max(_given(one), 1e-6)) for one in ours])) if ours else None
        ),
        "falsely_unknown": float(np.mean([one.said == UNKNOWN for one in known])),
        "strangers": len(strangers),
        "strangers_found": float(np.mean([one.said == UNKNOWN for one in strangers])),
    }


def _best_guess(one: Answer) -> str:
    return one.said if one.identity is None else one.identity.best_guess


def _given(one: Answer) -> float:
    """Return the probability that was given to the true kind."""
    return 0.0 if one.identity is None else one.identity.probability[one.item.kind]


def summary_table(summary: Sequence[dict[str, Any]]) -> Table:
    """Return how many items each method named, how many rightly, how many strangers it found."""
    return Table(
        title="Kinds named, and strangers found (stated: 5 % of known items called unknown)",
        columns=(
            "level",
            "method",
            "known items",
            "best guess right, %",
            "log loss",
            "falsely unknown, %",
            "strangers",
            "found, %",
        ),
        rows=[
            [
                row["level"],
                row["method"],
                str(row["items"]),
                f"{100 * row['right']:.0f}",
                "-" if row["log_loss"] is None else f"{row['log_loss']:.2f}",
                f"{100 * row['falsely_unknown']:.1f}",
                str(row["strangers"]),
                f"{100 * row['strangers_found']:.0f}",
            ]
            for row in summary
        ],
    )


def strangers_table(best: Sequence[Answer], levels: Sequence[str]) -> Table:
    """Return what each kind that was never taught was taken for."""
    rows = []
    for kind in dict.fromkeys(one.item.kind for one in best if not one.item.known):
        row = [kind]
        for level in levels:
            mine = [one for one in best if (one.level, one.item.kind) == (level, kind)]
            others = [one.said for one in mine if one.said != UNKNOWN]
            taken = ", ".join(f"{other} {others.count(other)}" for other in sorted(set(others)))
            found = len(mine) - len(others)
            row.append(f"{found} of {len(mine)}" + (f" ({taken})" if taken else ""))
        rows.append(row)
    return Table(
        title=f"Strangers found, {SORTED_GRASPS} grasps (and what the others were taken for)",
        columns=("stranger", *levels),
        rows=rows,
    )


def confusion(best: Sequence[Answer], level: str) -> tuple[list[str], list[str], np.ndarray]:
    """Return true kinds, named kinds and counts, strangers last."""
    mine = [one for one in best if one.level == level]
    kinds = list(dict.fromkeys(one.item.kind for one in mine if one.item.known))
    true = [*kinds, "strangers"]
    named = [*kinds, UNKNOWN]
    counts = np.zeros((len(true), len(named)), dtype=int)
    for one in mine:
        row = kinds.index(one.item.kind) if one.item.known else len(kinds)
        counts[row, named.index(one.said)] += 1
    return true, named, counts


def confusion_table(best: Sequence[Answer], level: str) -> Table:
    """Return true kinds against named ones, at one level."""
    true, named, counts = confusion(best, level)
    return Table(
        title=f"True kind (rows) and what was named, {level}, {SORTED_GRASPS} grasps",
        columns=("", *named),
        rows=[
            [kind, *("" if n == 0 else str(n) for n in row)]
            for kind, row in zip(true, counts, strict=True)
        ],
    )


def reliability(best: Sequence[Answer], level: str) -> list[dict[str, Any]]:
    """Return how often the best guess was right, by the probability that was stated for it."""
    pairs = [
        (one.identity.probability[one.identity.best_guess], _best_guess(one) == one.item.kind)
        for one in best
        if one.level == level and one.identity is not None
    ]
    found = []
    for low, high in pairwise(_RELIABILITY_EDGES):
        inside = [pair for pair in pairs if low < pair[0] <= high]
        if inside:
            found.append(
                {
                    "stated": float(np.mean([stated for stated, _ in inside])),
                    "right": float(np.mean([right for _, right in inside])),
                    "items": len(inside),
                }
            )
    return found


def points(crates: Sequence[CrateItemGrasps], levels: Sequence[str]) -> dict[str, list[Any]]:
    """Return kind, size and stiffness of each sorted item's first grasp, by level."""
    return {
        level: [
            (item.kind, item.known, measured["size_mm"].value, measured["stiffness_n_per_mm"].value)
            for item in crates
            if item.level == level and not item.teaches
            for measured in [item.grasps[0].grasp.measurements]
            if "stiffness_n_per_mm" in measured and "size_mm" in measured
        ]
        for level in levels
    }


def as_row(one: Answer) -> dict[str, Any]:
    identity = one.identity
    return {
        "level": one.level,
        "sensor": one.item.sensor,
        "item": one.item.item_id,
        "kind": one.item.kind,
        "taught": one.item.known,
        "said": one.said,
        "probability": None
        if identity is None
        else round(identity.probability[identity.best_guess], 4),
        "usual": None if identity is None else round(identity.usual, 4),
        "damaged": one.item.damaged,
    }
