"""Grasps of simulated crates, the input of the sorting study."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from palpate.errors import InputError
from palpate.files import atomic_path
from palpate.grasp.planning import plan_grasp
from palpate.measurement import Measurement, Status
from palpate.twin.crate import TRAINED_KINDS, UNTRAINED_KINDS, CrateTable, draw_crate
from palpate.twin.rig import calibrate_twin
from palpate_station.learning import UNKNOWN
from palpate_station.records import MEASURED, Grasp
from palpate_station.sorting.hand import SortingHand, TimedGrasp
from palpate_studies.second.objects import other_item

#: Grasps per training item and per sorted item.
TRAINING_GRASPS, SORTED_GRASPS = 2, 3
#: Fields of an item in the file, besides its grasps.
_TRUTH = ("level", "sensor", "item_id", "kind", "teaches", "known", "size_mm", "damaged")
#: Start of the simulated clock.
_BEGAN_AT = datetime(2026, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, slots=True, kw_only=True)
class CrateItemGrasps:
    """One item of a crate with its true properties and its grasps.

    Attributes
    ----------
    level, sensor
        Level of the twin, and the seed of sensor and gripper.
    item_id, kind : str
        Name and true kind.
    teaches : bool
        Whether the item belongs to the training set; other items are sorted.
    known : bool
        Whether the training set contains this kind.
    size_mm : float
        True mean diameter.
    damaged : bool
        Whether any grasp exceeded the yield force.
    grasps : tuple of TimedGrasp
        Grasps in order of time.
    """

    level: str
    sensor: int
    item_id: str
    kind: str
    teaches: bool
    known: bool
    size_mm: float
    damaged: bool
    grasps: tuple[TimedGrasp, ...]

    @property
    def true_answer(self) -> str:
        """The correct answer: the kind, or unknown for an untrained kind."""
        return self.kind if self.known else UNKNOWN


def measure_crates(
    *,
    level: str,
    sensor: int,
    training_items: int,
    sorted_items: int,
    second: bool = False,
) -> list[CrateItemGrasps]:
    """Calibrate a sensor, grasp training items of each kind, then a crate to sort.

    The crate has `sorted_items` of each trained kind, and half as many (rounded up) of each
    untrained kind. A quarter of the crate is then unknown if the number is even. With `second`,
    all items come from the second generator.
    """
    calibration = calibrate_twin(seed=sensor, level=level, apart_from="")
    table = CrateTable(sensor=sensor, seed=sensor + 500_009, level=level)
    hand = SortingHand(
        array=table.array,
        gripper=table.gripper,
        clock=table.clock,
        plan=plan_grasp(calibration, gripper=table.gripper),
        rig="sim-rigid",
        origin="twin",
        calibration_id=calibration.sensor_id,
        now=lambda: _BEGAN_AT + timedelta(seconds=table.clock.now_s()),
    )
    training = draw_crate(list(TRAINED_KINDS) * training_items, seed=sensor, prefix="taught")
    sorting = [*TRAINED_KINDS] * sorted_items + [*UNTRAINED_KINDS] * ((sorted_items + 1) // 2)
    crate = draw_crate(sorting, seed=sensor + 250_007)
    found = []
    for drawn in (*training, *crate):
        item, teaches = other_item(drawn) if second else drawn, drawn.item_id.startswith("taught")
        grasps, damaged = list[TimedGrasp](), False
        for turn in range(TRAINING_GRASPS if teaches else SORTED_GRASPS):
            table.place(item, turn=turn)
            size = grasps[-1].grasp.measurements.get("size_mm") if grasps else None
            grasps.append(hand.grasp(item.item_id, expected=size))
            damaged = damaged or table.is_damaged()
        found.append(
            CrateItemGrasps(
                level=level,
                sensor=sensor,
                item_id=item.item_id,
                kind=item.kind,
                teaches=teaches,
                known=item.is_trained,
                size_mm=item.mean.size_mm,
                damaged=damaged,
                grasps=tuple(grasps),
            )
        )
    return found


def write_crates(items: Sequence[CrateItemGrasps], path: Path) -> None:
    """Write the grasps to a file, so that a study can reuse them."""
    rows = [
        {name: getattr(item, name) for name in _TRUTH}
        | {
            "grasps": [
                {
                    "lasted_s": round(one.lasted_s, 3),
                    "outcome": str(one.grasp.outcome),
                    "calibration_id": one.grasp.calibration_id,
                    "taken_at": one.grasp.taken_at.isoformat(),
                    "measured": {
                        name: [m.value, m.low, m.high, str(m.status)]
                        for name, m in one.grasp.measurements.items()
                    },
                }
                for one in item.grasps
            ]
        }
        for item in items
    ]
    with atomic_path(path) as partial:
        document = {"origin": "twin", "simulated": True, "items": rows}
        partial.write_text(json.dumps(document, allow_nan=False) + "\n")


def read_crates(path: Path) -> list[CrateItemGrasps]:
    """Read a file of `write_crates`.

    Raises
    ------
    InputError
        If the file can't be read or has another format.
    """
    try:
        document = json.loads(path.read_text())
        return [_from_json(row) for row in document["items"]]
    except OSError as error:
        raise InputError(f"crates {path}: {error.strerror}") from error
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"crates {path}: not crates.json of `palpate study sorting --out`"
        ) from error


def _from_json(row: Mapping[str, Any]) -> CrateItemGrasps:
    grasps = tuple(
        TimedGrasp(
            lasted_s=one["lasted_s"],
            grasp=Grasp(
                item_id=row["item_id"],
                taken_at=datetime.fromisoformat(one["taken_at"]),
                rig="sim-rigid",
                drive="width",
                origin="twin",
                outcome=one["outcome"],
                calibration_id=one["calibration_id"],
                measurements={
                    name: Measurement(
                        value=value, low=low, high=high, unit=MEASURED[name], status=Status(status)
                    )
                    for name, (value, low, high, status) in one["measured"].items()
                },
            ),
        )
        for one in row["grasps"]
    )
    return CrateItemGrasps(**{name: row[name] for name in _TRUTH}, grasps=grasps)
