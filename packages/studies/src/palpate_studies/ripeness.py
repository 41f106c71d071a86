"""Ripeness of simulated avocados: stages and days to ripe."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, TypeAlias

import typer

from palpate.errors import InputError
from palpate.twin.ranges import Level
from palpate.twin.world import GripperKind
from palpate_station.ripeness.rule import CONFIDENT_PROBABILITY
from palpate_station.ripeness.stages import RIPE
from palpate_studies import ripeness_virtual
from palpate_studies.report import SecondOption, StudyReport, Table, as_command
from palpate_studies.ripeness_scores import METHODS, compare_methods, judge_days, scores
from palpate_studies.ripeness_station import (
    DAYS,
    GRASPS_AT_ONCE,
    LABELLED_GRASPS,
    LATER_DAYS,
    MOST_GRASPS,
    run_station,
)
from palpate_studies.station_records import StationRecords

#: Levels of the twin in the study.
StudiedLevel: TypeAlias = Literal["lab", "field"]
#: Level, gripper, and whether the sensor ages.
Condition: TypeAlias = tuple[Level, GripperKind, bool]
CONDITIONS: tuple[Condition, ...] = (
    ("lab", "rigid", True),
    ("lab", "soft", True),
    ("lab", "rigid", False),
    ("lab", "soft", False),
    ("field", "rigid", True),
    ("field", "soft", True),
)
#: Seed of the first reported sensor, fixed before anything was scored on it, and number of labelled
#: fruits. Sensors 93_011 to 93_014 were evaluated earlier.
SEED, LABELLED = 93_021, 24


def report(
    *,
    sensors: Annotated[int, typer.Option(help="Sensors of each condition.", min=1)] = 1,
    fruits: Annotated[
        int,
        typer.Option(
            help="Fruits judged by each sensor, in addition to 24 labelled fruits.", min=2
        ),
    ] = 10,
    level: Annotated[
        StudiedLevel | None, typer.Option(help="Only at this level of the twin.")
    ] = None,
    gripper: Annotated[GripperKind | None, typer.Option(help="Only with this gripper.")] = None,
    aging: Annotated[
        bool | None,
        typer.Option("--aging/--no-aging", help="Only sensors that age, or only those that don't."),
    ] = None,
    second: SecondOption = False,
) -> StudyReport:
    """Track avocados of the twin over four days with both grippers, on sensors that age.

    The default takes a quarter of an hour; `--sensors 5 --fruits 40` takes some hours. The
    conditions are independent: select some with --level, --gripper and --aging to run them in
    parallel. --second judges fruit with other softening curves on virtual sensors.

    Example: palpate study ripeness --out reports
    """
    if second:
        if (level, gripper, aging) != (None, None, None):
            raise InputError(
                "--second uses virtual sensors: leave out --level, --gripper and --aging"
            )
        return ripeness_virtual.report(sensors=sensors, fruits=fruits)
    return judge(
        {
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
            for condition in choose_conditions(level=level, gripper=gripper, aging=aging)
        }
    )


command = as_command(report)


def choose_conditions(
    *,
    level: StudiedLevel | None = None,
    gripper: GripperKind | None = None,
    aging: bool | None = None,
) -> list[Condition]:
    """Return the conditions that match all given values.

    Raises
    ------
    InputError
        If no condition matches: sensors that do not age are studied at level lab only.

    Examples
    --------
    >>> choose_conditions(gripper="soft", aging=True)
    [('lab', 'soft', True), ('field', 'soft', True)]
    """
    selected = (level, gripper, aging)
    found = [
        condition
        for condition in CONDITIONS
        if all(want in (None, has) for want, has in zip(selected, condition, strict=True))
    ]
    if not found:
        raise InputError(
            "at level field every sensor ages; leave --no-aging out, or use --level lab"
        )
    return found


def judge(found: Mapping[Condition, Sequence[StationRecords]]) -> StudyReport:
    """Judge the records of all stations, and return the report."""
    rows = [_judge_condition(condition, stations) for condition, stations in found.items()]
    lead: dict[str, Any] = {
        "level": "{level}",
        "gripper": "{gripper}",
        "aging": lambda row: "on" if row["aging"] else "off",
    }
    damaged, grasps = (sum(row[key] for row in rows) for key in ("damaged", "grasps"))
    return StudyReport(
        name="ripeness",
        title="Ripeness over days (simulated)",
        provenance=[
            "Simulated throughout. `palpate_studies.fruit_ranges` contains the ranges of the "
            "avocados and their reasons.",
            f"Each sensor is calibrated with a user's steps. Then {LABELLED} labelled fruits (more "
            f"if a stage is missing) are grasped {LABELLED_GRASPS} times a day for {DAYS} days. "
            f"The fruits to judge follow {LATER_DAYS} days after the first labelled day, with "
            f"{GRASPS_AT_ONCE} grasps a day, repeated up to {MOST_GRASPS} grasps while the stage "
            f"has a probability below {100 * CONFIDENT_PROBABILITY:.0f} %. A nest centres the "
            "fruit. Each morning new rest values are taken with the hand empty. A judgement uses "
            "the days up to its own.",
            "Aging: break-in and wear from 100 to 400 other grasps a day, mornings at 14.8 to "
            "26.8 C.",
            "Labels are true stages. People make errors, and their labels then limit the accuracy.",
            f"Pressed beyond the yield: {damaged} of {grasps} grasps.",
        ],
        tables=[
            Table.of(
                "Stage of four: exact / within one, % of fruit days",
                rows,
                lead
                | {"fruit days": "{fruit_days}", "grasps a day": "{grasps_a_day:.1f}"}
                | {name: f"{{{name}[exact]:.1p}} / {{{name}[within_one]:.1p}}" for name in METHODS},
            ),
            Table.of(
                "Wrong stages: palpate minus the other method, points (90 % over fruits)",
                [row | one for row in rows for one in row["compared"]],
                lead
                | {
                    "other method": "{rival}",
                    "difference": "{difference:+.1p} ({low:+.1p} to {high:+.1p})",
                    "fewer errors": "{verdict}",
                },
            ),
            Table.of(
                "Days to ripe, for unripe fruit; 90 % interval",
                rows,
                lead
                | {
                    "fruit days": "{days_to_ripe[fruit_days]}",
                    "coverage": "{days_to_ripe[coverage]:.2f}",
                    "median error": "{days_to_ripe[median_abs_error_days]:.2f} d",
                    "width": "{days_to_ripe[median_width_days]:.1f} d",
                },
            ),
        ],
        payload={"study": "ripeness", "origin": "twin", "conditions": rows},
    )


def _judge_condition(condition: Condition, stations: Sequence[StationRecords]) -> dict[str, Any]:
    """Judge the fruits of every station; the learners are trained on all stations."""
    if not any(fruit.day_of(RIPE) > 0 for records in stations for fruit in records.others):
        raise InputError(
            "all fruits were ripe from the first day on; judge more fruits with --fruits"
        )
    rows = [
        row
        for index, records in enumerate(stations)
        for row in judge_days(
            records, others=[*stations[:index], *stations[index + 1 :]], name=str(index)
        )
    ]
    level, gripper, aging = condition
    return {
        "level": level,
        "gripper": gripper,
        "aging": aging,
        "sensors": len(stations),
        "fruits": sum(len(records.others) for records in stations),
        "grasps": sum(len(records.grasps) for records in stations),
        "damaged": sum(records.damaged for records in stations),
        "compared": compare_methods(rows),
        **scores(rows),
    }
