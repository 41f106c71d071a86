"""A mixed crate: what each item is, by touch alone, and what is none of the kinds taught."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from palpate.plots.identify import confusion_figure, kinds_figure, reliability_figure
from palpate.produce.identify import FALSE_REJECT, UNKNOWN, Identifier, Identity, TaughtItem
from palpate.produce.identify_store import touches_of
from palpate.studies.identify_baselines import nearest_mean, size_thresholds
from palpate.studies.identify_data import (
    LEVELS,
    SORTED_GRASPS,
    CrateItemGrasps,
    measured_crates,
    read_crates,
    write_crates,
)
from palpate.studies.report import JsonOption, OutOption, StudyReport, Table

#: Items of each kind that teach. A packhouse has that many at hand.
TAUGHT = 10
#: Seeds of the sensors; others were used while this was made.
FIRST_SENSOR = 900
#: Edges of the classes of stated probability in the reliability plot.
_RELIABILITY_EDGES = (0.0, 0.5, 0.7, 0.85, 0.95, 1.0)

SensorsOption = Annotated[
    int, typer.Option(help="Sensors and crates of each level; the published figures: 3.", min=1)
]
ItemsOption = Annotated[
    int, typer.Option(help="Items of each kind in a crate; the published figures: 6.", min=1)
]
CratesOption = Annotated[
    Path | None,
    typer.Option(
        "--crates", help="crates.json of an earlier --out, instead of grasping.", metavar="FILE"
    ),
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What one method said of one item."""

    level: str
    method: str
    item: CrateItemGrasps
    said: str
    identity: Identity | None = None


def command(
    sensors: SensorsOption = 1,
    items: ItemsOption = 2,
    crates: CratesOption = None,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Tell the kinds of a mixed crate, strangers among them, from one to three grasps.

    Example: palpate study identify --out reports
    """
    found = crates_of(crates, sensors=sensors, items=items)
    report(found).emit(as_json=as_json, out=out)
    if out is not None:
        write_crates(found, out / "crates.json")


def crates_of(path: Path | None, *, sensors: int, items: int) -> list[CrateItemGrasps]:
    """Return crates from a file, or grasp them."""
    if path is not None:
        return read_crates(path)
    return [
        item
        for level in LEVELS
        for sensor in range(FIRST_SENSOR, FIRST_SENSOR + sensors)
        for item in measured_crates(level=level, sensor=sensor, taught=TAUGHT, sorted_items=items)
    ]


def taught_items(crates: Sequence[CrateItemGrasps]) -> list[TaughtItem]:
    """Return what teaches, as the identifier takes it."""
    return [
        TaughtItem(
            kind=item.kind, touches=touches_of([one.grasp for one in item.grasps], drive="width")
        )
        for item in crates
        if item.teaches
    ]


def answers(crates: Sequence[CrateItemGrasps]) -> list[Answer]:
    """Let every method name every item of the crates, each level and sensor on its own."""
    found = []
    for level in sorted({item.level for item in crates}, key=LEVELS.index):
        of_level = [item for item in crates if item.level == level]
        for sensor in sorted({item.sensor for item in of_level}):
            mine = [item for item in of_level if item.sensor == sensor]
            others = [item for item in of_level if item.sensor != sensor]
            found += _by_sensor(mine, others, level=level)
    return found


def _by_sensor(
    mine: Sequence[CrateItemGrasps], others: Sequence[CrateItemGrasps], *, level: str
) -> list[Answer]:
    """Let every method, taught on this sensor, name its crate; ours also taught on the others."""
    teaching = [item for item in mine if item.teaches]
    sorting = [item for item in mine if not item.teaches]
    found = []
    for method, guess in (
        ("size thresholds", size_thresholds(teaching)),
        ("nearest mean", nearest_mean(teaching)),
    ):
        for item in sorting:
            measured = item.grasps[0].grasp.measurements
            said = guess(measured) if len(measured) == 4 else UNKNOWN
            found.append(Answer(level=level, method=method, item=item, said=said))
    known = Identifier(taught_items(teaching))
    for count in range(1, SORTED_GRASPS + 1):
        method = f"ours, {count} grasp{'s' if count > 1 else ''}"
        found += _ours(known, sorting, method=method, level=level, count=count)
    if others:
        abroad = Identifier(taught_items(others))
        found += _ours(
            abroad,
            sorting,
            method="ours, taught on other sensors",
            level=level,
            count=SORTED_GRASPS,
        )
    return found


def _ours(
    known: Identifier, items: Sequence[CrateItemGrasps], *, method: str, level: str, count: int
) -> list[Answer]:
    found = []
    for item in items:
        touches = touches_of([one.grasp for one in item.grasps[:count]], drive="width")
        identity = known.identify(touches) if touches else None
        said = UNKNOWN if identity is None else identity.kind
        found.append(Answer(level=level, method=method, item=item, said=said, identity=identity))
    return found


def report(crates: Sequence[CrateItemGrasps]) -> StudyReport:
    """Put the answers into tables and figures."""
    said = answers(crates)
    levels = [level for level in LEVELS if any(item.level == level for item in crates)]
    methods = list(dict.fromkeys(one.method for one in said))
    summary = [
        _summary([one for one in said if (one.level, one.method) == (level, method)])
        for level in levels
        for method in methods
        if any((one.level, one.method) == (level, method) for one in said)
    ]
    last = f"ours, {SORTED_GRASPS} grasps"
    best = [one for one in said if one.method == last]
    sensors = len({(item.level, item.sensor) for item in crates})
    return StudyReport(
        name="identify",
        title="What is it? Kinds of a mixed crate by size and stiffness (simulated)",
        provenance=(
            f"Simulated: {sensors} sensors and grippers, each calibrated by a user's steps, then "
            "taught with items of each kind (two grasps each), then a crate that it never saw. "
            "Every measurement is that of a grasp by the controller; nothing is told of the truth.",
            "Ranges of the kinds were fixed beforehand (palpate.twin.produce_ranges). Several "
            "kinds overlap in both size and stiffness, and strangers may feel like a taught kind.",
        ),
        tables=[
            _summary_table(summary),
            _strangers_table(best, levels),
            *[_confusion_table([o for o in best if o.level == level], level) for level in levels],
        ],
        payload={
            "simulated": True,
            "false_reject": FALSE_REJECT,
            "summary": summary,
            "reliability": {level: _reliability(best, level) for level in levels},
            "rows": [_row(one) for one in best],
        },
        figures={
            "identify-confusion": lambda: confusion_figure(
                {level: _confusion(best, level) for level in levels}
            ),
            "identify-kinds": lambda: kinds_figure(_points(crates, levels)),
            "identify-reliability": lambda: reliability_figure(
                {level: _reliability(best, level) for level in levels}
            ),
        },
    )


def _summary(said: Sequence[Answer]) -> dict[str, Any]:
    known = [one for one in said if one.item.known]
    strangers = [one for one in said if not one.item.known]
    named = [one for one in known if one.said != UNKNOWN]
    best = [_best_guess(one) == one.item.kind for one in known]
    ours = [one for one in known if one.identity is not None]
    return {
        "level": said[0].level,
        "method": said[0].method,
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


def _summary_table(summary: Sequence[dict[str, Any]]) -> Table:
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


def _strangers_table(best: Sequence[Answer], levels: Sequence[str]) -> Table:
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


def _confusion(best: Sequence[Answer], level: str) -> tuple[list[str], list[str], np.ndarray]:
    """Return true kinds, said kinds and counts, strangers last."""
    mine = [one for one in best if one.level == level]
    kinds = list(dict.fromkeys(one.item.kind for one in mine if one.item.known))
    true = [*kinds, "strangers"]
    said = [*kinds, UNKNOWN]
    counts = np.zeros((len(true), len(said)), dtype=int)
    for one in mine:
        row = kinds.index(one.item.kind) if one.item.known else len(kinds)
        counts[row, said.index(one.said)] += 1
    return true, said, counts


def _confusion_table(best: Sequence[Answer], level: str) -> Table:
    true, said, counts = _confusion(best, level)
    return Table(
        title=f"True kind (rows) and what was said, {level}, {SORTED_GRASPS} grasps",
        columns=("", *said),
        rows=[
            [kind, *("" if n == 0 else str(n) for n in row)]
            for kind, row in zip(true, counts, strict=True)
        ],
    )


def _reliability(best: Sequence[Answer], level: str) -> list[dict[str, Any]]:
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


def _points(crates: Sequence[CrateItemGrasps], levels: Sequence[str]) -> dict[str, list[Any]]:
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


def _row(one: Answer) -> dict[str, Any]:
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
