"""Records of a ripeness station, and a rule learned from their labels."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.calibration import Calibration
from palpate_station.records import Grasp
from palpate_station.ripeness.firmness import DayFirmness
from palpate_station.ripeness.history import firmness_history
from palpate_station.ripeness.rule import RipenessRule
from palpate_station.ripeness.stages import STAGES
from palpate_studies.twin_avocado import Avocado


@dataclass(frozen=True, slots=True, kw_only=True)
class StationRecords:
    """The records of one station.

    Attributes
    ----------
    calibration : Calibration
        Calibration before the first day.
    labelled, others : tuple of Avocado
        Fruits of the items `labelled-N` and `fruit-N`.
    grasps : tuple of Grasp
        All grasps.
    damaged : int
        Grasps that pressed a fruit beyond its yield.
    as_published : dict of (str, int) to float
        Item and day -> settled change in percent by the paper's method: fingers closed to one width
        per fruit (3 mm below the caliper size) or to one pressure for all fruits, held for 20 s,
        mean of the pixels.
    """

    calibration: Calibration
    labelled: tuple[Avocado, ...]
    others: tuple[Avocado, ...]
    grasps: tuple[Grasp, ...]
    damaged: int
    as_published: dict[tuple[str, int], float]


def days_of(records: StationRecords, item_id: str) -> tuple[DayFirmness, ...]:
    """Return the days of an item."""
    grasps = [grasp for grasp in records.grasps if grasp.item_id == item_id]
    drive = records.grasps[0].drive
    return firmness_history(grasps, item_id=item_id, drive=drive).days


def select_labelled(records: StationRecords) -> list[tuple[Avocado, tuple[DayFirmness, ...]]]:
    """Return every labelled fruit with its days."""
    return [
        (fruit, days_of(records, f"labelled-{number}"))
        for number, fruit in enumerate(records.labelled)
    ]


def learn_rule(records: StationRecords) -> RipenessRule:
    """Learn a rule from the labelled fruits with their true stages."""
    known = select_labelled(records)
    return RipenessRule.learn(
        [days for _, days in known],
        labels=[[fruit.stage(round(day.day)) for day in days] for fruit, days in known],
        stages=STAGES,
    )
