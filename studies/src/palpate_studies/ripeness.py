"""Figure 16 of the paper, and ripeness of many fruits: stages, days to ripe, drift separated."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import numpy as np
import typer

from palpate.commands.options import JsonOption
from palpate.errors import InputError
from palpate.produce.ripeness.rule import SURE
from palpate.twin.world import GripperKind
from palpate_studies.report import OutOption, StudyReport
from palpate_studies.ripeness_felt import Felt, drift_of
from palpate_studies.ripeness_scores import (
    WAYS,
    Judged,
    compared,
    confusion,
    judged,
    ours_exact,
    scores,
)
from palpate_studies.ripeness_station import (
    DAYS,
    GRASPS_AT_ONCE,
    LABELLED_GRASPS,
    LATER_DAYS,
    MOST_GRASPS,
    REFERENCE_GRASPS,
    run_station,
)
from palpate_studies.ripeness_tables import (
    Condition,
    accuracy_table,
    compared_table,
    confusion_table,
    days_table,
    figure16_table,
    limits_table,
    named,
    ripened,
    sensors_table,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Levels of the twin that the study has conditions at.
StudiedLevel: TypeAlias = Literal["lab", "field"]
CONDITIONS: tuple[Condition, ...] = (
    ("lab", "rigid", True),
    ("lab", "soft", True),
    ("lab", "rigid", False),
    ("lab", "soft", False),
    ("field", "rigid", True),
    ("field", "soft", True),
)
#: Seed of the first sensor that is reported, written down before anything was scored on it. Looked
#: at before: 93_011 to 93_014.
SEED, LABELLED = 93_021, 24


def command(
    sensors: Annotated[int, typer.Option(help="Sensors of each condition.", min=1)] = 1,
    fruits: Annotated[
        int,
        typer.Option(
            help="Fruits that each sensor judges, besides two dozen labelled ones.", min=2
        ),
    ] = 10,
    level: Annotated[
        StudiedLevel | None, typer.Option(help="Only at this level of the twin.")
    ] = None,
    gripper: Annotated[GripperKind | None, typer.Option(help="Only with this gripper.")] = None,
    aging: Annotated[
        bool | None,
        typer.Option("--aging/--no-aging", help="Only on sensors that age, or that do not."),
    ] = None,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Follow avocados of the twin over four days with both grippers, on sensors that age.

    By default it takes a quarter of an hour; `--sensors 5 --fruits 40` takes some hours. The
    conditions do not depend on each other: pick some with --level, --gripper and --aging, and give
    each processor its own.

    Example: palpate study ripeness --out reports
    """
    found = {
        condition: [
            run_station(
                SEED + sensor,
                level=condition[0],
                gripper=condition[1],
                aging=condition[2],
                labelled=LABELLED,
                others=fruits,
            )
            for sensor in range(sensors)
        ]
        for condition in chosen(level=level, gripper=gripper, aging=aging)
    }
    report(found).emit(as_json=as_json, out=out)


def chosen(
    *,
    level: StudiedLevel | None = None,
    gripper: GripperKind | None = None,
    aging: bool | None = None,
) -> list[Condition]:
    """Return the conditions that agree with all that was asked for.

    Raises
    ------
    InputError
        If there are none: sensors that do not age are compared at level lab alone.

    Examples
    --------
    >>> chosen(gripper="soft", aging=True)
    [('lab', 'soft', True), ('field', 'soft', True)]
    """
    asked = (level, gripper, aging)
    found = [
        condition
        for condition in CONDITIONS
        if all(want in (None, has) for want, has in zip(asked, condition, strict=True))
    ]
    if not found:
        raise InputError(
            "at level field every sensor ages; leave --no-aging out, or take --level lab"
        )
    return found


def report(found: Mapping[Condition, Sequence[Felt]]) -> StudyReport:
    """Judge what the stations felt, condition by condition."""
    apart = {c: _judged(stations) for c, stations in found.items()}
    rows = {c: [row for station in stations for row in station] for c, stations in apart.items()}
    if not all(any(row.wait_days > 0 for row in one) for one in rows.values()):
        raise InputError("all fruits were ripe from the first day on: judge more with --fruits")
    each = {condition: scores(rows[condition]) for condition in rows}
    by_sensor = {c: [ours_exact(station) for station in stations] for c, stations in apart.items()}
    settled = {c: days for c in _drawn(found) if (days := ripened(found[c]))}
    return StudyReport(
        name="ripeness",
        title="Figure 16 and ripeness over days (simulated)",
        provenance=_provenance(found),
        tables=[
            accuracy_table(each),
            compared_table({c: compared(rows[c]) for c in rows}),
            sensors_table(by_sensor),
            limits_table(each),
            days_table(each),
            *(confusion_table(c, rows[c]) for c in _drawn(rows)),
            *([figure16_table(settled)] if settled else []),
        ],
        payload={
            "study": "ripeness",
            "origin": "twin",
            "conditions": [
                _condition(c, found[c])
                | {
                    "compared": compared(rows[c]),
                    "confusion": confusion(rows[c]).tolist(),
                    "exact_by_sensor": by_sensor[c],
                }
                | each[c]
                for c in found
            ],
        },
        figures=_figures(each, {c: rows[c] for c in _drawn(rows)}, settled),
    )


def _judged(stations: Sequence[Felt]) -> list[list[Judged]]:
    """Judge the fruits of every station of a condition; learners see the labels of all of them."""
    return [
        judged(felt, taught=[*stations[:index], *stations[index + 1 :]], name=str(index))
        for index, felt in enumerate(stations)
    ]


def _drawn(conditions: Mapping[Condition, object]) -> list[Condition]:
    """Return the first condition of each gripper: the one that is shown in detail."""
    first: dict[GripperKind, Condition] = {}
    for condition in conditions:
        first.setdefault(condition[1], condition)
    return list(first.values())


def _condition(condition: Condition, stations: Sequence[Felt]) -> dict[str, object]:
    level, gripper, aging = condition
    return {
        "level": level,
        "gripper": gripper,
        "aging": aging,
        "sensors": len(stations),
        "fruits": sum(len(felt.others) for felt in stations),
        "grasps": sum(len(felt.grasps) for felt in stations),
        "damaged": sum(felt.damaged for felt in stations),
        "reference_moved": [[float(one) for one in drift_of(felt).moved] for felt in stations],
    }


def _provenance(found: Mapping[Condition, Sequence[Felt]]) -> list[str]:
    damaged = sum(felt.damaged for stations in found.values() for felt in stations)
    grasps = sum(len(felt.grasps) for stations in found.values() for felt in stations)
    return [
        "Simulated throughout. The paper prints no numbers in Figure 16 (one avocado, four days, "
        "ten grasps a day, each gripper); no published number was a calibration input here. The "
        "avocados' ranges stand in `palpate_studies.fruit_ranges` with their reasons.",
        f"Each sensor: a calibration by a user's steps, then {LABELLED} labelled fruits for {DAYS} "
        f"days (more where these did not show every stage), {LABELLED_GRASPS} grasps a day, and, "
        f"{LATER_DAYS} days after their first, the others, which are judged: {GRASPS_AT_ONCE} "
        f"grasps a day, and {GRASPS_AT_ONCE} more up to {MOST_GRASPS} while the stage is less than "
        f"{100 * SURE:.0f} % sure. A nest centres the fruit. {REFERENCE_GRASPS} grasps of a rubber "
        "ball each morning, half before the fruit and half after it; rest values taken again each "
        "morning with the hand empty. Judged on each day by the days up to then.",
        "Aging: break-in and wear by 100 to 400 other grasps a day, mornings at 14.8 to 26.8 C.",
        "Labels are true stages; people err, and then no one is right more often than they are.",
        f"Pressed beyond its yield: {damaged} of {grasps} grasps.",
    ]


def _figures(
    each: Mapping[Condition, Mapping[str, Any]],
    rows: Mapping[Condition, Sequence[Judged]],
    settled: Mapping[Condition, Sequence[tuple[float, float]]],
) -> dict[str, Callable[[], Figure]]:
    def figure_16() -> Figure:
        from palpate_studies.plots.ripeness_study import figure16

        return figure16({named(c): days for c, days in settled.items()})

    def ripeness() -> Figure:
        from palpate_studies.plots.ripeness_study import study_figure

        accuracy = {
            named(c): {
                way: None if score[way] is None else 100 * score[way]["exact"] for way in WAYS
            }
            for c, score in each.items()
        }
        waits = {
            named(c): np.array(
                [
                    (row.wait_days, row.value_days, row.low_days, row.high_days)
                    for row in judgements
                    if row.wait_days > 0
                ]
            )
            for c, judgements in rows.items()
        }
        return study_figure(accuracy, waits)

    return ({"figure16": figure_16} if settled else {}) | {"ripeness": ripeness}
