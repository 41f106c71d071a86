"""A mixed crate: the kind of each item by touch alone, strangers among them.

The baseline is the nearest class mean in size and stiffness, which may call an item unknown.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
import typer

from palpate.arrays import FloatArray
from palpate.estimate.measurement import Measurement
from palpate.produce.identify.identifier import FEATURES, Identifier, Identity
from palpate.produce.identify.kinds import touches_of
from palpate.produce.learning import FALSE_REJECT, UNKNOWN
from palpate_studies.identify_data import (
    SORTED_GRASPS,
    CrateItemGrasps,
    measured_crates,
    read_crates,
    write_crates,
)
from palpate_studies.protocol.paired import paired_difference
from palpate_studies.report import SecondOption, StudyReport, Table, as_command
from palpate_studies.rows import LEVELS, group

#: Names a kind, or unknown, from the measurements of one grasp.
Guess: TypeAlias = Callable[[Mapping[str, Measurement]], str]
NEAREST_MEAN = "nearest mean, may abstain"
_NAMES = ("size_mm", "stiffness_n_per_mm")
#: Items of each kind that teach. A packhouse has that many at hand.
TAUGHT = 10
#: Ours: a linear discriminant with a background class.
OURS = "ours"
#: Learners in its place, with the same background class -> their names in
#: `palpate.produce.learning.METHODS`.
LEARNERS = {"logistic regression": "logistic", "boosted trees": "trees"}
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


class NearestMean:
    """Class means learned from points.

    Distances are in the spread that all kinds share. An item farther from every mean than all but
    a twentieth of the training items are from theirs is unknown: the same fraction as ours, chosen
    on the training items alone.

    Parameters
    ----------
    points : ndarray, shape (items, features)
        Logarithms of the measurements of each training item.
    kinds : sequence of str, length items
        The kind of each.

    Examples
    --------
    >>> points = np.array([[3.0, 0.0], [3.1, 0.1], [3.05, 0.0], [4.0, 2.0], [4.1, 2.1], [4.0, 2.1]])
    >>> known = NearestMean(points, 3 * ["grape"] + 3 * ["egg"])
    >>> known.name(np.array([4.05, 2.0])), known.name(np.array([9.0, 9.0]))
    ('egg', 'unknown')
    """

    def __init__(self, points: FloatArray, kinds: Sequence[str]) -> None:
        self.kinds = sorted(set(kinds))
        of = np.array([self.kinds.index(kind) for kind in kinds])
        self._means = np.array([points[of == k].mean(axis=0) for k in range(len(self.kinds))])
        self._spread = np.sqrt(np.mean((points - self._means[of]) ** 2, axis=0)) + 1e-9
        # Left out of its own mean, an item of n lies farther from it by n / (n - 1).
        count = np.bincount(of)[of]
        own = self._distances(points)[np.arange(len(of)), of] * count / np.maximum(count - 1, 1)
        self._limit = float(np.quantile(own, 1.0 - FALSE_REJECT))

    def name(self, point: FloatArray) -> str:
        """Return the kind, or `UNKNOWN`."""
        distances = self._distances(point[None])[0]
        best = int(np.argmin(distances))
        return UNKNOWN if distances[best] > self._limit else self.kinds[best]

    def _distances(self, points: FloatArray) -> FloatArray:
        off = (points[:, None, :] - self._means) / self._spread
        return np.asarray(np.sqrt(np.sum(off**2, axis=2)))


def learn_nearest_mean(teaching: Sequence[CrateItemGrasps]) -> Guess:
    """Learn the means from every grasp that measured both size and stiffness."""
    found = [
        ([np.log(one.grasp.measurements[name].middle) for name in _NAMES], item.kind)
        for item in teaching
        for one in item.grasps
        if all(name in one.grasp.measurements for name in _NAMES)
    ]
    known = NearestMean(np.array([values for values, _ in found]), [kind for _, kind in found])
    return lambda measured: known.name(np.log([measured[name].middle for name in _NAMES]))


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """The answer of one method on one item."""

    level: str
    method: str
    item: CrateItemGrasps
    said: str
    identity: Identity | None = None


def report(
    *,
    sensors: SensorsOption = 1,
    items: ItemsOption = 2,
    crates: CratesOption = None,
    second: SecondOption = False,
) -> StudyReport:
    """Identify the kinds of a mixed crate, strangers among them, from one to three grasps.

    Example: palpate study identify --out reports
    """
    return judge(crates_of(crates, sensors=sensors, items=items, second=second), second=second)


command = as_command(report)


def crates_of(
    path: Path | None,
    *,
    sensors: int,
    items: int,
    second: bool = False,
) -> list[CrateItemGrasps]:
    """Return crates from a file, or grasp them; `second`: of the second generator."""
    if path is not None:
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
        )
    ]


def taught_items(crates: Sequence[CrateItemGrasps]) -> list[tuple[str, tuple[FloatArray, ...]]]:
    """Return what teaches, as the identifier takes it."""
    return [
        (item.kind, touches_of([one.grasp for one in item.grasps]))
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
    found, guess = list[Answer](), learn_nearest_mean(teaching)
    for item in sorting:
        measured = item.grasps[0].grasp.measurements
        guessed = guess(measured) if set(FEATURES) <= set(measured) else UNKNOWN
        found.append(Answer(level=level, method=NEAREST_MEAN, item=item, said=guessed))
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
    """Return ours, and learners in its place, taught with the same items."""
    taught = taught_items(teaching)
    learners = {name: Identifier(taught, methods=[method]) for name, method in LEARNERS.items()}
    return {OURS: Identifier(taught), **learners}


def _asked(
    known: Identifier, items: Sequence[CrateItemGrasps], *, method: str, level: str, count: int
) -> list[Answer]:
    found = []
    for item in items:
        touches = touches_of([one.grasp for one in item.grasps[:count]])
        identity = known.identify(touches) if touches else None
        guessed = UNKNOWN if identity is None else identity.kind
        found.append(Answer(level=level, method=method, item=item, said=guessed, identity=identity))
    return found


def against_learners(given: Sequence[Answer]) -> list[dict[str, Any]]:
    """Return ours against each learner in its place at equal grasps, paired by item.

    An item's loss is 1 where its answer, a kind or unknown, is not true.
    """
    found = []
    for key, mine in group(given, "level"):
        for count in range(1, SORTED_GRASPS + 1):
            lost = {
                name: {
                    f"{one.item.sensor}/{one.item.item_id}": float(one.said != one.item.named)
                    for one in mine
                    if one.method == f"{name}, {count} grasp{'s' if count > 1 else ''}"
                }
                for name in (OURS, *LEARNERS)
            }
            items = list(lost[OURS])
            ours = [lost[OURS][item] for item in items]
            for learner in LEARNERS:
                theirs = [lost[learner][item] for item in items]
                found.append(
                    {
                        **key,
                        "grasps": count,
                        "learner": learner,
                        "ours_wrong": float(np.mean(ours)),
                        "learner_wrong": float(np.mean(theirs)),
                        **paired_difference(ours, theirs, items, statistic=np.mean).to_dict(),
                    }
                )
    return found


def summed(given: Sequence[Answer]) -> list[dict[str, Any]]:
    """Return how many items each method named rightly, level by level."""
    return [{**key, **counted(mine)} for key, mine in group(given, "level", "method")]


def counted(answers: Sequence[Answer]) -> dict[str, Any]:
    """Return shares of known items and strangers that one method named rightly."""
    known = [one for one in answers if one.item.known]
    strangers = [one for one in answers if not one.item.known]
    best = [one.said if one.identity is None else one.identity.best_guess for one in known]
    return {
        "items": len(known),
        "right": float(
            np.mean([said == one.item.kind for said, one in zip(best, known, strict=True)])
        ),
        "falsely_unknown": float(np.mean([one.said == UNKNOWN for one in known])),
        "strangers": len(strangers),
        "strangers_found": float(np.mean([one.said == UNKNOWN for one in strangers])),
    }


def judge(crates: Sequence[CrateItemGrasps], *, second: bool = False) -> StudyReport:
    """Put the answers into tables."""
    given = answers(crates)
    summary = summed(given)
    sensors = len({(item.level, item.sensor) for item in crates})
    return StudyReport(
        name="identify",
        title="What is it? Kinds of a mixed crate by size and stiffness (simulated)",
        provenance=(
            *([_SECOND] if second else []),
            f"Simulated: {sensors} sensors and grippers, each calibrated by a user's steps, then "
            "taught with items of each kind (two grasps each), then a crate that it never saw. "
            "Every measurement is that of a grasp by the controller; no method knows the truth. "
            "Every item is squeezed gently.",
            "Ranges of the kinds were fixed beforehand (palpate_studies.fruit_ranges). Several "
            "kinds overlap in both size and stiffness, and strangers may feel like a taught kind.",
        ),
        tables=[
            Table.of(
                "Kinds named, and strangers found (stated: 5 % of known items called unknown)",
                summary,
            )
        ],
        payload={
            "study": "identify",
            "simulated": True,
            "second_generator": second,
            "false_reject": FALSE_REJECT,
            "summary": summary,
            "against_learners": against_learners(given),
        },
        files={"crates.json": partial(write_crates, crates)},
    )
