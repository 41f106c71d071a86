"""Detection of bruises on simulated apples, with every method on the same grasps.

A grasp follows a user's steps: search for contact, close further, hold, read every pixel.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from scipy.stats import rankdata

from palpate.arrays import FloatArray
from palpate.files import atomic_path
from palpate.sensor.sample import SampleReader, relative_change_percent
from palpate.signal.relative import CONTACT_PERCENT, mean_change
from palpate.twin.devices import TwinArray
from palpate_station.bruise.model import (
    BRUISED,
    REFERENCES,
    BruiseModel,
    Side,
    build_contrast_tables,
    default_model,
    load_simulated_sides,
)
from palpate_station.bruise.shape import LoadShape, fit_load_shape, median_shape
from palpate_station.learning import LabelledTable, make_pipeline
from palpate_studies.fruit_ranges import BRUISES
from palpate_studies.processes import map_batches
from palpate_studies.protocol.paired import Difference, IntArray, bootstrap_difference
from palpate_studies.report import SecondOption, StudyReport, Table, as_command
from palpate_studies.rows import LEVELS
from palpate_studies.second.fruit import corky, rotten
from palpate_studies.twin_apple import Apple, draw_apple
from palpate_studies.twin_session import HOLD_S, SETTLED_MEAN_S, Session

#: Width of the open fingers before an apple of unknown size, and gap to the last contact before
#: another grasp of the same apple.
OPEN_MM, GAP_MM = 72.0, 8.0
#: Speed of the search for contact, and fast closure beyond the contact.
SEARCH_MM_PER_S, CLOSURE_MM = 6.0, 2.0
#: Still time of the open fingers before each grasp; the rest values are the mean of its last half
#: second.
REST_S = 10.0
#: Smallest width of the search for contact.
_TIGHTEST_MM = 40.0
#: Time of the early answer after the end of the search, seconds.
EARLY_S = 2.5
#: Largest distance of the middle of the bruise from the middle of the fingers, in both directions:
#: the user presents the tested side with the placement error of the twin (`off_centre` of
#: `palpate.twin.ranges`: 0.6 of the pitch).
PLACED_WITHIN_MM = 6.0
#: Sound apples of the class reference of each sensor, and the grasped sides of each.
REFERENCE_APPLES, REFERENCE_SIDES_DEG = 8, (0.0, 90.0)
APPLES_PER_SENSOR = 24
#: First seed of the sensors of each purpose.
_FIRST_SENSOR = {"learn": 20_000, "test": 30_000}
#: Method without training: the paper's mean over all pixels after 20 s, as named in stored results.
SAME_WIDTH = "change of the 20 s mean since before, at one width (the paper's way)"
#: Baseline with the same contrasts as input, and its name in `palpate_station.learning.METHODS`.
TREES, _TREES_METHOD = "boosted trees", "trees"
#: The shipped pipeline with all references at once.
TOGETHER = f"logistic regression against all three references at once, {EARLY_S:g} s"
FALSE_ALARMS = 0.05
#: Decimals of the contrasts in the file of simulated sides.
_DIGITS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class ApplePress:
    """One grasp of one apple.

    Attributes
    ----------
    width_mm : float
        Width at contact; without a search for contact, the final width plus `CLOSURE_MM`.
    time_s : ndarray, shape (times,)
        Times from the end of the search to the early answer.
    change_percent : ndarray, shape (times, rows, cols)
        Relative change of each pixel at these times.
    settled_percent : ndarray, shape (rows, cols)
        Relative change of each pixel at the end of the hold.
    """

    width_mm: float
    time_s: FloatArray
    change_percent: FloatArray
    settled_percent: FloatArray

    def shape(self, cutoff_s: float) -> LoadShape:
        """Return the load distribution over the last three frames before a time."""
        change = self.settled_percent
        if cutoff_s < HOLD_S:
            change = self.change_percent[self.time_s <= cutoff_s][-3:].mean(axis=0)
        return fit_load_shape(change, width_mm=self.width_mm)

    @property
    def mean_percent(self) -> float:
        """The paper's aggregate after 20 s: the mean over all pixels."""
        return float(mean_change(self.settled_percent))


def press(
    session: Session,
    apple: Apple,
    *,
    angle_deg: float,
    open_mm: float = OPEN_MM,
    to_mm: float | None = None,
) -> ApplePress:
    """Place an apple with one side at the first finger, and grasp it.

    The fingers close slowly until a pixel of each finger falls by the paper's 10 %, then by
    `CLOSURE_MM`. With `to_mm`, they close to this width without a search for contact.
    """
    clock, world = session.world.clock, session.world
    session.close_to(open_mm)
    clock.sleep_s(1.0)
    world.place(apple.facing(angle_deg))
    clock.sleep_s(REST_S - 1.0 - SETTLED_MEAN_S)
    rest_ohm = session.mean_ohm()
    width_mm = _search(session, rest_ohm) if to_mm is None else to_mm + CLOSURE_MM
    session.close_to(width_mm - CLOSURE_MM)
    change = relative_change_percent(session.read(EARLY_S), rest_ohm=rest_ohm)
    clock.sleep_s(HOLD_S - EARLY_S - SETTLED_MEAN_S)
    settled = relative_change_percent(session.mean_ohm(), rest_ohm=rest_ohm)
    return ApplePress(
        width_mm=width_mm,
        time_s=np.arange(1, len(change) + 1) / world.frame_rate_hz,
        change_percent=change,
        settled_percent=settled,
    )


def _search(session: Session, rest_ohm: FloatArray) -> float:
    """Close slowly until a pixel of every finger detects contact; return the reported width.

    Until both fingers touch, one finger only pushes the fruit.
    """
    session.close_to(_TIGHTEST_MM, speed_mm_per_s=SEARCH_MM_PER_S)
    array, layout = TwinArray(session.world), session.world.layout
    weakest, reader = 0.0, SampleReader(layout, rest_ohm)
    while weakest > CONTACT_PERCENT:
        change = reader.read(array.read(timeout_s=1.0)).change_percent
        weakest = max(
            float(change[layout.finger_mask(finger)].min()) for finger in range(layout.fingers)
        )
    array.close()
    return session.gripper.state().width_mm


@dataclass(frozen=True, slots=True, kw_only=True)
class Examined:
    """One apple with its tested side and its grasps.

    Attributes
    ----------
    purpose, level : str
        ``learn`` or ``test``, and level of the twin.
    sensor : int
        Seed of sensor and gripper.
    apple : Apple
        The apple, with its bruise if any.
    angle_deg : float
        Angle of the tested side, which faces the first finger.
    presses : mapping of str to ApplePress
        ``before``: the side before the bruise; ``now``: the tested side, placed again; ``other``:
        the sides a quarter turn from it; ``same_width``: the tested side at the width of
        ``before``.
    sound : LoadShape
        Median load distribution of the sensor's sound apples.
    """

    purpose: str
    level: str
    sensor: int
    apple: Apple
    angle_deg: float
    presses: Mapping[str, ApplePress]
    sound: LoadShape

    @property
    def is_bruised(self) -> bool:
        """Whether the apple is bruised."""
        return self.apple.bruise is not None

    def side(self) -> Side:
        """Return the inputs of every method at the time of the early answer."""
        shapes = {name: one.shape(EARLY_S) for name, one in self.presses.items()}
        return Side(
            shape=shapes["now"],
            against={
                "history": shapes["before"],
                "class": self.sound,
                "item": median_shape([shapes["other"]], with_width=True),
            },
        )


def examine(
    purposes: Mapping[str, int],
    *,
    levels: Sequence[str],
    seed: int,
    change_apple: Callable[[Apple], Apple] | None = None,
) -> list[Examined]:
    """Draw apples for each purpose and level, half of them bruised, and grasp them.

    Parameters
    ----------
    purposes : mapping of str to int
        Purpose (``learn``, ``test``) -> number of apples at each level.
    levels : sequence of str
        Levels of the twin.
    seed : int
        Seed of the sensors, from which the apples are drawn.
    change_apple : callable, optional
        Function from a drawn apple to an apple of another generator.
    """
    batches = [
        _Batch(
            purpose=purpose,
            level=level,
            sensor=_FIRST_SENSOR[purpose] + 1000 * seed + first // APPLES_PER_SENSOR,
            apples=min(apples - first, APPLES_PER_SENSOR),
            change_apple=change_apple,
        )
        for purpose, apples in purposes.items()
        for level in levels
        for first in range(0, apples, APPLES_PER_SENSOR)
    ]
    return map_batches(_examine_batch, batches)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Batch:
    """Apples of one sensor."""

    purpose: str
    level: str
    sensor: int
    apples: int
    change_apple: Callable[[Apple], Apple] | None


def _examine_batch(batch: _Batch) -> list[Examined]:
    """Examine apples on one sensor."""
    sensor = batch.sensor
    session = Session(sensor, level=batch.level)
    sound = [
        grasped
        for index in range(REFERENCE_APPLES)
        for grasped in _presses(
            session,
            [
                (draw_apple(np.random.default_rng([sensor, 1, index]), bruises=None), angle_deg)
                for angle_deg in REFERENCE_SIDES_DEG
            ],
        )
    ]
    classes = median_shape([one.shape(EARLY_S) for one in sound], with_width=False)
    return [_examine(session, batch, index, sound=classes) for index in range(batch.apples)]


def _examine(session: Session, batch: _Batch, index: int, *, sound: LoadShape) -> Examined:
    rng = np.random.default_rng([batch.sensor, 2, index])
    near = replace(BRUISES, height_mm=(-PLACED_WITHIN_MM, PLACED_WITHIN_MM))
    apple = draw_apple(rng, bruises=near if index % 2 == 1 else None)
    apple = apple if batch.change_apple is None else batch.change_apple(apple)
    angle_deg = rng.uniform(0.0, 360.0)
    if apple.bruise is not None:
        beside_mm = rng.uniform(-PLACED_WITHIN_MM, PLACED_WITHIN_MM)
        angle_deg = apple.bruise.angle_deg + math.degrees(beside_mm / apple.radius_mm)
        angle_deg += 180.0 * rng.integers(2)
    before = replace(apple, bruise=None)
    turned = {
        "before": (before, angle_deg),
        "now": (apple, angle_deg),
        "other": (apple, angle_deg + 90.0),
    }
    made = dict(zip(turned, _presses(session, list(turned.values())), strict=True))
    if batch.purpose == "test":
        made["same_width"] = press(
            session, apple, angle_deg=angle_deg, to_mm=made["before"].width_mm - CLOSURE_MM
        )
    session.world.place(None)
    return Examined(
        purpose=batch.purpose,
        level=batch.level,
        sensor=batch.sensor,
        apple=apple,
        angle_deg=angle_deg,
        presses=made,
        sound=sound,
    )


def _presses(session: Session, turned: Sequence[tuple[Apple, float]]) -> list[ApplePress]:
    """Grasp apples at their angles in turn; the fingers open fully before the first grasp."""
    made: list[ApplePress] = []
    for apple, angle_deg in turned:
        open_mm = min(made[-1].width_mm + GAP_MM, OPEN_MM) if made else OPEN_MM
        made.append(press(session, apple, angle_deg=angle_deg, open_mm=open_mm))
    session.world.place(None)
    return made


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoredSides:
    """Scores of one method on the test apples of a level; higher means bruised.

    Attributes
    ----------
    bruised : ndarray of bool, shape (apples,)
        Whether each apple is bruised.
    score : ndarray, shape (apples,)
        Score of each apple.
    sensors : sequence of str
        Sensor of each apple.
    """

    bruised: NDArray[np.bool_]
    score: FloatArray
    sensors: Sequence[str]

    @property
    def auc(self) -> float:
        """Area under the ROC curve."""
        return area(self.bruised, self.score)

    def summarise(self) -> dict[str, float]:
        """Return the area, and the fraction of bruises detected at the nominal false alarms."""
        limit = np.quantile(self.score[~self.bruised], 1.0 - FALSE_ALARMS)
        found = float(np.mean(self.score[self.bruised] > limit))
        return {"auc": self.auc, "found": found}


def area(bruised: NDArray[np.bool_], score: FloatArray) -> float:
    """Return the area under the ROC curve; ties count half, NaN with one class only.

    Examples
    --------
    >>> area(np.array([False, True, True]), np.array([0.1, 0.9, 0.1]))
    0.75
    """
    truth = np.asarray(bruised, dtype=bool)
    positive, negative = int(truth.sum()), int((~truth).sum())
    if not positive or not negative:
        return float("nan")
    rank_sum = rankdata(score)[truth].sum()
    return float((rank_sum - positive * (positive + 1) / 2) / (positive * negative))


def compare_areas(ours: ScoredSides, baseline: ScoredSides) -> Difference:
    """Return the area of a baseline minus palpate's; negative values favour palpate."""

    def of(chosen: IntArray) -> np.floating:
        truth = ours.bruised[chosen]
        return np.float64(area(truth, baseline.score[chosen]) - area(truth, ours.score[chosen]))

    return bootstrap_difference(of, ours.sensors)


def table_contrasts(examined: Sequence[Examined]) -> dict[str, LabelledTable]:
    """Return the labelled contrasts of the tested sides to each reference."""
    return build_contrast_tables(
        [(str(number), one.is_bruised, one.side()) for number, one in enumerate(examined)]
    )


def score_all(
    tested: Sequence[Examined], model: BruiseModel, *, known: Mapping[str, LabelledTable]
) -> dict[str, ScoredSides]:
    """Score the test apples with every method; return method -> scores.

    `known`: training contrasts of the model and of the baselines.
    """
    unknown = table_contrasts(tested)
    changes = [
        one.presses["same_width"].mean_percent - one.presses["before"].mean_percent
        for one in tested
    ]
    scores = {SAME_WIDTH: np.array(changes)}
    sides = [one.side() for one in tested]
    for name in REFERENCES:
        scores[name_method("ours", name)] = np.array(
            [model.log_odds(replace(one, against={name: one.against[name]})) for one in sides]
        )
        scores[name_method(TREES, name)] = _learn_and_score(
            _TREES_METHOD, [known[name]], [unknown[name]]
        )
    scores[TOGETHER] = _learn_and_score("logistic", list(known.values()), list(unknown.values()))
    bruised = np.array([one.is_bruised for one in tested])
    sensors = [str(one.sensor) for one in tested]
    return {
        name: ScoredSides(bruised=bruised, score=score, sensors=sensors)
        for name, score in scores.items()
    }


def compare_all(scores: Mapping[str, ScoredSides]) -> list[dict[str, Any]]:
    """Compare palpate with boosted trees against each reference."""
    return [
        {
            "reference": name,
            **compare_areas(
                scores[name_method("ours", name)], scores[name_method(TREES, name)]
            ).to_dict(),
        }
        for name in REFERENCES
    ]


def _learn_and_score(
    method: str, known: Sequence[LabelledTable], unknown: Sequence[LabelledTable]
) -> FloatArray:
    """Train another pipeline on the known sides; return a score for each tested side."""
    bruised = np.array(known[0].labels) == BRUISED
    pipeline = make_pipeline(method).fit(np.hstack([one.rows for one in known]), bruised)
    return np.asarray(pipeline.decision_function(np.hstack([one.rows for one in unknown])))


def name_method(method: str, reference: str) -> str:
    """Return the name of a method with one reference."""
    return f"{method} against {reference}, {EARLY_S:g} s"


def report(
    *,
    apples: Annotated[
        int, typer.Option(help="Test apples at each level; 500 for precise figures.", min=24)
    ] = 48,
    seed: Annotated[int, typer.Option(help="Seed of apples and sensors.", min=0)] = 1,
    second: SecondOption = False,
) -> StudyReport:
    """Grasp simulated apples, sound and bruised, and classify them with every method.

    With --out, the training sides of each level are written too. --second tests the shipped model
    on bruises of another shape and on rot, with 24 apples on each sensor.

    Example: palpate study bruise --apples 96 --out reports
    """
    if second:
        return second_report(range(seed, seed + apples // 24))
    purposes = {
        "learn": max(2 * apples // 24 * 24, 48),
        "test": apples,
    }
    return judge(examine(purposes, levels=LEVELS, seed=seed))


command = as_command(report)


def judge(examined: Sequence[Examined]) -> StudyReport:
    """Score all methods at every level, and return the report."""
    levels = list(dict.fromkeys(one.level for one in examined))
    counts, summary, compared = dict[str, Any](), dict[str, Any](), list[dict[str, Any]]()
    known = {}
    for level in levels:
        of = {
            purpose: [one for one in examined if (one.purpose, one.level) == (purpose, level)]
            for purpose in dict.fromkeys(one.purpose for one in examined)
        }
        sensors = len({one.sensor for one in of["learn"]})
        learned_on = (
            f"{len(of['learn'])} simulated apples on {sensors} simulated sensors, level {level}"
        )
        known[level] = table_contrasts(of["learn"]), learned_on
        model = BruiseModel.learn(known[level][0], learned_on=learned_on)
        scores = score_all(of["test"], model, known=known[level][0])
        counts[level] = {purpose: len(mine) for purpose, mine in of.items()}
        summary[level] = {name: one.summarise() for name, one in scores.items()}
        compared += [{"level": level, **row} for row in compare_all(scores)]
    return StudyReport(
        name="bruise",
        title="Bruised and sound apples (simulated)",
        provenance=[
            f"Simulated, at each level: {counts[levels[0]]['test']} test apples, and "
            f"{counts[levels[0]]['learn']} training apples on other sensors. Half of the apples "
            f"are bruised within {PLACED_WITHIN_MM:g} mm of the middle of a finger. The tested "
            "side is grasped once, closed from contact. Apples differ in size, roundness, and "
            "firmness around the fruit; bruises differ in diameter, depth, softness, dent and "
            "position (ranges: `palpate_studies.fruit_ranges`).",
            f"References: class, {REFERENCE_APPLES} other sound apples on the same sensor; item, "
            "one grasp a quarter turn from the side; history, one earlier grasp of the same side "
            "before the bruise.",
        ],
        tables=[
            Table.wide(
                "Bruised or sound, from one grasp of the side: area under the ROC curve, and "
                f"percent detected at {100 * FALSE_ALARMS:g} % false alarms",
                [
                    {"level": level, "way": name, **one}
                    for level in levels
                    for name, one in summary[level].items()
                ],
                {"method": _label_method},
                over="level",
                form="{auc:.3f}, {found:.0p}",
            )
        ],
        payload={
            "origin": "twin",
            "apples": counts,
            "ways": summary,
            "compared": compared,
        },
        files={
            f"bruise-sides-{level}.json": partial(save_sides, *sides)
            for level, sides in known.items()
        },
    )


def _label_method(row: Mapping[str, Any]) -> str:
    name = str(row["way"])
    return "settled mean change at one width (the paper's method)" if name == SAME_WIDTH else name


def second_report(seeds: Sequence[int]) -> StudyReport:
    """Score the shipped model on apples of the second generator, and on rot."""
    generators = {"second": corky, "rot": rotten}
    compared, summary = list[dict[str, Any]](), list[dict[str, Any]]()
    _, known = load_simulated_sides()
    for name, change_apple in generators.items():
        found = [
            one
            for seed in seeds
            for one in examine({"test": 24}, levels=["lab"], seed=seed, change_apple=change_apple)
        ]
        scores = score_all(found, default_model(), known=known)
        counts = {"apples": len(found), "sensors": len({one.sensor for one in found})}
        summary += [
            {"generator": name, "way": method, **counts, **one.summarise()}
            for method, one in scores.items()
        ]
        compared += [{"generator": name, **row} for row in compare_all(scores)]
    return StudyReport(
        name="bruise",
        title="Bruises of another shape, and rot (simulated)",
        provenance=(
            "Simulated, at level lab. The second generator is described in "
            "`palpate_studies.second.fruit`, which was fixed before anything was scored on it. "
            "The shipped model was trained on the first generator.",
        ),
        tables=[
            Table.wide(
                "Bruised or sound: area under the ROC curve, and percent detected at "
                f"{100 * FALSE_ALARMS:g} % false alarms",
                summary,
                {"method": _label_method},
                over="generator",
                form="{auc:.3f}, {found:.0p}",
            )
        ],
        payload={"simulated": True, "ways": summary, "compared": compared},
    )


def save_sides(known: Mapping[str, LabelledTable], learned_on: str, path: Path) -> None:
    """Write training sides as JSON, in the format of the file that palpate ships."""
    document = {
        "learned_on": learned_on,
        "sides": {
            name: {"labels": table.labels, "contrasts": table.rows.round(_DIGITS).tolist()}
            for name, table in known.items()
        },
    }
    with atomic_path(path) as unfinished:
        unfinished.write_text(json.dumps(document, allow_nan=False, separators=(",", ":")) + "\n")
