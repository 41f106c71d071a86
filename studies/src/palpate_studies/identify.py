"""A mixed crate: what each item is, by touch alone, and what is none of the kinds taught."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from palpate.commands.options import JsonOption, TargetForceOption
from palpate.errors import InputError
from palpate.produce.identify.identifier import FALSE_REJECT, UNKNOWN, Identifier, TaughtItem
from palpate.produce.identify.items import touches_of
from palpate_studies.baselines.lda_background import LdaBackground
from palpate_studies.identify_baselines import guesses
from palpate_studies.identify_data import (
    LEVELS,
    SORTED_GRASPS,
    CrateItemGrasps,
    measured_crates,
    read_crates,
    squeeze_in_words,
    write_crates,
)
from palpate_studies.identify_tables import (
    Answer,
    as_row,
    confusion,
    confusion_table,
    counted,
    points,
    reliability,
    strangers_table,
    summary_table,
)
from palpate_studies.plots.identify import confusion_figure, kinds_figure, reliability_figure
from palpate_studies.protocol.paired import paired_difference
from palpate_studies.report import OutOption, StudyReport

#: Items of each kind that teach. A packhouse has that many at hand.
TAUGHT = 10
#: What the tables call the strongest rival, and ours.
LDA, OURS = "LDA with a background class", "ours"
#: Seeds of the sensors; others were used while this was made, and for earlier figures.
FIRST_SENSOR = 910
#: That of the one look at the second generator.
SECOND_SENSOR = 960
_SECOND = (
    "Second generator: sizes of a kind crowd at both ends of its range, and everything but shells "
    "has a skin on softer flesh and a core."
)

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


def command(
    sensors: SensorsOption = 1,
    items: ItemsOption = 2,
    crates: CratesOption = None,
    second: Annotated[
        bool,
        typer.Option("--second", help="Two cultivars of each kind, with a skin on softer flesh."),
    ] = False,
    target_force_n: TargetForceOption = None,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Identify the kinds of a mixed crate, strangers among them, from one to three grasps.

    Example: palpate study identify --out reports
    """
    found = crates_of(
        crates, sensors=sensors, items=items, second=second, target_force_n=target_force_n
    )
    report(found, second=second).emit(as_json=as_json, out=out)
    if out is not None:
        write_crates(found, out / "crates.json")


def crates_of(
    path: Path | None,
    *,
    sensors: int,
    items: int,
    second: bool = False,
    target_force_n: float | None = None,
) -> list[CrateItemGrasps]:
    """Return crates from a file, or grasp them; `second`: of the second generator."""
    if path is not None:
        if target_force_n is not None:
            raise InputError(f"--target-force-n: {path} was grasped already; leave one of them out")
        return read_crates(path)
    first = SECOND_SENSOR if second else FIRST_SENSOR
    return [
        item
        for level in LEVELS
        for sensor in range(first, first + sensors)
        for item in measured_crates(
            level=level,
            sensor=sensor,
            taught=TAUGHT,
            sorted_items=items,
            second=second,
            target_force_n=target_force_n,
        )
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
    for method, guess in guesses(teaching).items():
        for item in sorting:
            measured = item.grasps[0].grasp.measurements
            guessed = guess(measured) if len(measured) == 4 else UNKNOWN
            found.append(Answer(level=level, method=method, item=item, said=guessed))
    for name, known in identifiers(teaching).items():
        for count in range(1, SORTED_GRASPS + 1):
            method = f"{name}, {count} grasp{'s' if count > 1 else ''}"
            found += _asked(known, sorting, method=method, level=level, count=count)
    if others:
        abroad = Identifier(taught_items(others))
        found += _asked(
            abroad,
            sorting,
            method="ours, taught on other sensors",
            level=level,
            count=SORTED_GRASPS,
        )
    return found


def identifiers(teaching: Sequence[CrateItemGrasps]) -> dict[str, Identifier]:
    """Return the strongest rival and ours, taught with the same items."""
    taught = taught_items(teaching)
    return {LDA: LdaBackground(taught), OURS: Identifier(taught)}


def _asked(
    known: Identifier, items: Sequence[CrateItemGrasps], *, method: str, level: str, count: int
) -> list[Answer]:
    found = []
    for item in items:
        touches = touches_of([one.grasp for one in item.grasps[:count]], drive="width")
        identity = known.identify(touches) if touches else None
        guessed = UNKNOWN if identity is None else identity.kind
        found.append(Answer(level=level, method=method, item=item, said=guessed, identity=identity))
    return found


def against_lda(given: Sequence[Answer], level: str) -> list[dict[str, Any]]:
    """Return ours against the discriminant analysis at equal grasps, paired by item.

    An item's loss is 1 where its answer, a kind or unknown, is not true.
    """
    found = []
    for count in range(1, SORTED_GRASPS + 1):
        grasps = f"{count} grasp{'s' if count > 1 else ''}"
        ours, rival = (
            {
                (one.item.sensor, one.item.item_id): float(one.said != one.item.named)
                for one in given
                if (one.level, one.method) == (level, f"{name}, {grasps}")
            }
            for name in (OURS, LDA)
        )
        found.append(
            {
                "level": level,
                "grasps": count,
                "ours_wrong": float(np.mean(list(ours.values()))),
                "lda_wrong": float(np.mean(list(rival.values()))),
                **paired_difference(
                    list(ours.values()),
                    [rival[key] for key in ours],
                    [f"{sensor}/{item}" for sensor, item in ours],
                    statistic=np.mean,
                ).to_dict(),
            }
        )
    return found


def summed(given: Sequence[Answer]) -> list[dict[str, Any]]:
    """Return how many items each method named rightly, level by level."""
    return [
        counted([one for one in given if (one.level, one.method) == (level, method)])
        for level, method in dict.fromkeys((one.level, one.method) for one in given)
    ]


def report(crates: Sequence[CrateItemGrasps], *, second: bool = False) -> StudyReport:
    """Put the answers into tables and figures."""
    given = answers(crates)
    levels = [level for level in LEVELS if any(item.level == level for item in crates)]
    summary = summed(given)
    last = f"ours, {SORTED_GRASPS} grasps"
    best = [one for one in given if one.method == last]
    sensors = len({(item.level, item.sensor) for item in crates})
    return StudyReport(
        name="identify",
        title="What is it? Kinds of a mixed crate by size and stiffness (simulated)",
        provenance=(
            *([_SECOND] if second else []),
            f"Simulated: {sensors} sensors and grippers, each calibrated by a user's steps, then "
            "taught with items of each kind (two grasps each), then a crate that it never saw. "
            "Every measurement is that of a grasp by the controller; no method knows the truth. "
            + squeeze_in_words(crates),
            "Ranges of the kinds were fixed beforehand (palpate_studies.fruit_ranges). Several "
            "kinds overlap in both size and stiffness, and strangers may feel like a taught kind.",
        ),
        tables=[
            summary_table(summary),
            strangers_table(best, levels),
            *[confusion_table([o for o in best if o.level == level], level) for level in levels],
        ],
        payload={
            "simulated": True,
            "second_generator": second,
            "false_reject": FALSE_REJECT,
            "summary": summary,
            "against_lda": [row for level in levels for row in against_lda(given, level)],
            "reliability": {level: reliability(best, level) for level in levels},
            "rows": [as_row(one) for one in best],
        },
        figures={
            "identify-confusion": lambda: confusion_figure(
                {level: confusion(best, level) for level in levels}
            ),
            "identify-kinds": lambda: kinds_figure(points(crates, levels)),
            "identify-reliability": lambda: reliability_figure(
                {level: reliability(best, level) for level in levels}
            ),
        },
    )
