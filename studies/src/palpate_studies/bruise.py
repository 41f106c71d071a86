"""How reliably bruised apples differ from sound ones, by every method on the same grasps.

A grasp of a twin apple follows a user's steps: search for contact, close on, hold, read every
pixel.
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
from palpate.produce.bruise.model import (
    BRUISED,
    REFERENCES,
    BruiseModel,
    Side,
    default_model,
    load_simulated_sides,
    table_sides,
)
from palpate.produce.bruise.shape import LoadShape, fit_load_shape, median_shape
from palpate.produce.learning import LabelledTable, make_pipeline
from palpate.signal.circuit import resistance_ohm
from palpate.signal.relative import CONTACT_PERCENT, mean_change, relative_change_percent
from palpate.twin.devices import TwinArray
from palpate_studies.fruit_ranges import BRUISES
from palpate_studies.processes import map_batches
from palpate_studies.protocol.paired import Difference, IntArray, bootstrap_difference
from palpate_studies.report import SecondOption, StudyReport, Table, as_command
from palpate_studies.rows import LEVELS
from palpate_studies.second.fruit import corky, rotten
from palpate_studies.twin_apple import Apple, draw_apple
from palpate_studies.twin_session import HOLD_S, SETTLED_MEAN_S, Session

#: The fingers stand this wide before an apple whose size nobody knows, and this much wider than
#: the last contact before the next grasp of the same one.
OPEN_MM, GAP_MM = 72.0, 8.0
#: Speed while looking for contact, and how far they close on, fast, from where it was seen.
SEARCH_MM_PER_S, CLOSURE_MM = 6.0, 2.0
#: Still time of the open fingers before each grasp; its last half second gives the rest values.
REST_S = 10.0
#: The early answer.
CUTOFF_S = 2.5
_TIGHTEST_MM = 40.0
#: When the answer is given, seconds after the fingers close on.
EARLY_S = 2.5
#: How far the middle of the bruise lies from the middle of the fingers, at most, in both
#: directions: the user presents the side in question and lays it as the twin lays everything
#: (`off_centre` of `palpate.twin.ranges`: 0.6 of the pitch).
PLACED_WITHIN_MM = 6.0
#: A sensor's own idea of its class: sound apples, two sides of each.
REFERENCE_APPLES, REFERENCE_SIDES_DEG = 8, (0.0, 90.0)
APPLES_PER_SENSOR = 24
#: Sensors of one purpose never serve another.
_FIRST_SENSOR = {"learn": 20_000, "test": 30_000}
#: The way that needs no learning: the paper's mean over all pixels after 20 s.
SAME_WIDTH = "change of the 20 s mean since before, at one width (the paper's way)"
#: Pipelines in place of the shipped one, on the same contrasts -> their names in
#: `palpate.produce.learning.METHODS`.
LEARNERS = {"linear discriminant": "discriminant", "boosted trees": "trees"}
#: All references at once, by the shipped pipeline.
TOGETHER = f"logistic regression against all three references at once, {EARLY_S:g} s"
FALSE_ALARMS = 0.05
#: Digits of contrasts in the file of simulated sides.
_DIGITS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class ApplePress:
    """One grasp of one apple.

    Attributes
    ----------
    width_mm : float
        Width at which contact was seen, the closure before the end where none was looked for.
    time_s : ndarray, shape (times,)
        From the moment that the fingers close on, up to the early answer.
    change_percent : ndarray, shape (times, rows, cols)
        Relative change of each pixel then.
    settled_percent : ndarray, shape (rows, cols)
        The same after 20 s.
    """

    width_mm: float
    time_s: FloatArray
    change_percent: FloatArray
    settled_percent: FloatArray

    def shape(self, cutoff_s: float) -> LoadShape:
        """Return the load's distribution over the last three frames before a time, or the end."""
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
    """Lay an apple between the fingers, one side to the first of them; grasp it.

    The fingers close slowly until both feel the paper's 10 %, then on by a fixed way;
    or, without looking for contact, to a width that is given.
    """
    clock, world = session.world.clock, session.world
    session.close_to(open_mm)
    clock.sleep_s(1.0)
    world.place(apple.facing(angle_deg))
    clock.sleep_s(REST_S - 1.0 - SETTLED_MEAN_S)
    rest_ohm = session.mean_ohm()
    width_mm = _search(session, rest_ohm) if to_mm is None else to_mm + CLOSURE_MM
    session.close_to(width_mm - CLOSURE_MM)
    change = relative_change_percent(session.read(CUTOFF_S), rest_ohm=rest_ohm)
    clock.sleep_s(HOLD_S - CUTOFF_S - SETTLED_MEAN_S)
    settled = relative_change_percent(session.mean_ohm(), rest_ohm=rest_ohm)
    return ApplePress(
        width_mm=width_mm,
        time_s=np.arange(1, len(change) + 1) / world.frame_rate_hz,
        change_percent=change,
        settled_percent=settled,
    )


def _search(session: Session, rest_ohm: FloatArray) -> float:
    """Close slowly until a pixel of every finger feels something; return the width reported.

    Until both fingers touch, the first one only pushes the fruit along.
    """
    session.close_to(_TIGHTEST_MM, speed_mm_per_s=SEARCH_MM_PER_S)
    array, layout = TwinArray(session.world), session.world.layout
    lightest = 0.0
    while lightest > CONTACT_PERCENT:
        ohm = resistance_ohm(array.read(timeout_s=1.0).counts, divider=layout.divider)
        change = relative_change_percent(ohm, rest_ohm=rest_ohm)
        lightest = max(
            float(change[layout.finger_mask(finger)].min()) for finger in range(layout.fingers)
        )
    array.close()
    return session.gripper.state().width_mm


@dataclass(frozen=True, slots=True, kw_only=True)
class Examined:
    """One apple, one side of it in question, and its grasps.

    Attributes
    ----------
    purpose, level : str
        What for, and on which level of the twin.
    sensor : int
        Seed of sensor and gripper.
    apple : Apple
        The truth.
    angle_deg : float
        The side in question, to the first finger.
    presses : mapping of str to ApplePress
        ``before`` the bruise; ``now``, placed again; the ``other`` sides, a quarter turn on; at the
        ``same_width`` as before.
    sound : LoadShape
        How the sensor's sound apples load it.
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
        """Whether it is."""
        return self.apple.bruise is not None

    def side(self, cutoff_s: float) -> Side:
        """Return the inputs of every method at a time of the hold."""
        shapes = {name: one.shape(cutoff_s) for name, one in self.presses.items()}
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
    replace_sheet: Callable[[Apple], Apple] | None = None,
) -> list[Examined]:
    """Draw this many apples for each purpose and level, half of them bruised; grasp them.

    Parameters
    ----------
    purposes : mapping of str to int
        ``learn`` and ``test``.
    levels : sequence of str
        Levels of the twin.
    seed : int
        Seed of everything.
    replace_sheet : callable, optional
        Makes the apples of another generator out of those that are drawn.
    """
    batches = [
        _Batch(
            purpose=purpose,
            level=level,
            sensor=_FIRST_SENSOR[purpose] + 1000 * seed + first // APPLES_PER_SENSOR,
            apples=min(apples - first, APPLES_PER_SENSOR),
            replace_sheet=replace_sheet,
        )
        for purpose, apples in purposes.items()
        for level in levels
        for first in range(0, apples, APPLES_PER_SENSOR)
    ]
    return map_batches(_examine_batch, batches)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Batch:
    """Apples that one sensor examines."""

    purpose: str
    level: str
    sensor: int
    apples: int
    replace_sheet: Callable[[Apple], Apple] | None


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
    apple = apple if batch.replace_sheet is None else batch.replace_sheet(apple)
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
    if batch.purpose == "test":
        # Not judged: it keeps the load history of the sheet as in the stored results.
        turned["again"] = (apple, angle_deg)
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
    """Grasp each apple, or one apple turned; the fingers open fully before the first."""
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
        The truth.
    score : ndarray, shape (apples,)
        One per apple.
    sensors : sequence of str
        On which sensor.
    """

    bruised: NDArray[np.bool_]
    score: FloatArray
    sensors: Sequence[str]

    @property
    def auc(self) -> float:
        """Area under the ROC curve."""
        return area(self.bruised, self.score)

    def summarise(self) -> dict[str, float]:
        """Return the area, and the fraction of bruised sides above 95 % of sound ones."""
        limit = np.quantile(self.score[~self.bruised], 1.0 - FALSE_ALARMS)
        found = float(np.mean(self.score[self.bruised] > limit))
        return {"auc": self.auc, "found": found}


def area(bruised: NDArray[np.bool_], score: FloatArray) -> float:
    """Return the area under the ROC curve: how often bruised scores above sound.

    Examples
    --------
    >>> area(np.array([False, True, True]), np.array([0.1, 0.9, 0.1]))
    0.75
    """
    truth = np.asarray(bruised, dtype=bool)
    many, rest = int(truth.sum()), int((~truth).sum())
    if not many or not rest:
        return float("nan")
    ranks = rankdata(score)
    return float((ranks[truth].sum() - many * (many + 1) / 2) / (many * rest))


def area_lost(ours: ScoredSides, rival: ScoredSides) -> Difference:
    """Return our area missing under the ROC curve less a rival's."""

    def of(chosen: IntArray) -> np.floating:
        truth = ours.bruised[chosen]
        return np.float64(area(truth, rival.score[chosen]) - area(truth, ours.score[chosen]))

    return bootstrap_difference(of, ours.sensors)


def contrast_known(examined: Sequence[Examined]) -> dict[str, LabelledTable]:
    """Return the contrasts of sides to each reference, with the truth."""
    return table_sides(
        [(str(number), one.is_bruised, one.side(EARLY_S)) for number, one in enumerate(examined)]
    )


def score_all(
    tested: Sequence[Examined], model: BruiseModel, *, known: Mapping[str, LabelledTable]
) -> dict[str, ScoredSides]:
    """Return the scores of every way on the test apples; way -> scores.

    `known`: the sides that the model, and the learners in its place, are learned from.
    """
    felt = contrast_known(tested)
    changes = [
        one.presses["same_width"].mean_percent - one.presses["before"].mean_percent
        for one in tested
    ]
    scores = {SAME_WIDTH: np.array(changes)}
    for name in REFERENCES:
        sides = [one.side(EARLY_S) for one in tested]
        scores[way("ours", name)] = np.array(
            [model.log_odds(replace(one, against={name: one.against[name]})) for one in sides]
        )
        scores |= {
            way(learner, name): _learn_and_score(method, [known[name]], [felt[name]])
            for learner, method in LEARNERS.items()
        }
    scores[TOGETHER] = _learn_and_score("logistic", list(known.values()), list(felt.values()))
    bruised = np.array([one.is_bruised for one in tested])
    sensors = [str(one.sensor) for one in tested]
    return {
        name: ScoredSides(bruised=bruised, score=score, sensors=sensors)
        for name, score in scores.items()
    }


def compare_all(scores: Mapping[str, ScoredSides]) -> list[dict[str, Any]]:
    """Return what ours lacks against each reference, less what each other way lacks."""
    return [
        {
            "reference": name,
            "rival": rival,
            **area_lost(scores[way("ours", name)], scores[rival]).to_dict(),
        }
        for name in REFERENCES
        for rival in (SAME_WIDTH, *(way(learner, name) for learner in LEARNERS), TOGETHER)
    ]


def _learn_and_score(
    method: str, known: Sequence[LabelledTable], felt: Sequence[LabelledTable]
) -> FloatArray:
    """Learn from known sides by another pipeline, and return a score for each tested one."""
    bruised = np.array(known[0].labels) == BRUISED
    pipeline = make_pipeline(method).fit(np.hstack([one.rows for one in known]), bruised)
    return np.asarray(pipeline.decision_function(np.hstack([one.rows for one in felt])))


def way(method: str, reference: str) -> str:
    """Return the name of a judgement against one reference."""
    return f"{method} against {reference}, {EARLY_S:g} s"


def report(
    *,
    apples: Annotated[
        int, typer.Option(help="Apples tested on each level; 500 for reliable figures.", min=24)
    ] = 48,
    seed: Annotated[int, typer.Option(help="Seed of apples and sensors.", min=0)] = 1,
    second: SecondOption = False,
) -> StudyReport:
    """Grasp many simulated apples, sound and bruised, and classify them by every method.

    --out also writes the training sides of each level. --second judges bruises of another shape,
    rot, and apples of the first generator, 24 on each sensor, by the training sides in palpate.

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
    """Score everything and put it into tables."""
    levels = list(dict.fromkeys(one.level for one in examined))
    counts, ways, compared = dict[str, Any](), dict[str, Any](), list[dict[str, Any]]()
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
        known[level] = contrast_known(of["learn"]), learned_on
        model = BruiseModel.learn(known[level][0], learned_on=learned_on)
        scores = score_all(of["test"], model, known=known[level][0])
        counts[level] = {purpose: len(mine) for purpose, mine in of.items()}
        ways[level] = {name: one.summarise() for name, one in scores.items()}
        compared += [{"level": level, **row} for row in compare_all(scores)]
    return StudyReport(
        name="bruise",
        title="Bruised and sound apples (simulated)",
        provenance=[
            f"Simulated, each level: {counts[levels[0]]['test']} apples tested and "
            f"{counts[levels[0]]['learn']} others, on other sensors, learned from, half of them "
            f"bruised, each with its bruise within {PLACED_WITHIN_MM:g} mm of the middle of either "
            "finger; grasped once at the side in question, closed by contact. They differ in size, "
            "firmness, roundness, firmer sides; bruises in diameter, depth, softness, dent and "
            "place (ranges: `palpate_studies.fruit_ranges`).",
            f"References: class, {REFERENCE_APPLES} other sound apples on the same sensor; item, "
            "one grasp a quarter turn on; history, one earlier grasp of the same side, sound then.",
        ],
        tables=[
            Table.wide(
                "Bruised or not, from one grasp of the side: area under the ROC curve, and percent "
                f"found at {100 * FALSE_ALARMS:g} % false alarms",
                [
                    {"level": level, "way": name, **one}
                    for level in levels
                    for name, one in ways[level].items()
                ],
                {"way": "{way}"},
                over="level",
                form="{auc:.3f}, {found:.0p}",
            )
        ],
        payload={
            "origin": "twin",
            "apples": counts,
            "ways": ways,
            "compared": compared,
        },
        files={
            f"bruise-sides-{level}.json": partial(save_sides, *sides)
            for level, sides in known.items()
        },
    )


def second_report(seeds: Sequence[int]) -> StudyReport:
    """Judge the same apples, bruised in two ways or rotten, by the shipped model."""
    remakes: dict[str, Callable[[Apple], Apple] | None] = {
        "first": None,
        "second": corky,
        "rot": rotten,
    }
    rows, ways = list[dict[str, Any]](), list[dict[str, Any]]()
    _, known = load_simulated_sides()
    for name, replace_sheet in remakes.items():
        found = [
            one
            for seed in seeds
            for one in examine({"test": 24}, levels=["lab"], seed=seed, replace_sheet=replace_sheet)
        ]
        scores = score_all(found, default_model(), known=known)
        counts = {"apples": len(found), "sensors": len({one.sensor for one in found})}
        ways += [
            {
                "generator": name,
                "way": way,
                **counts,
                **one.summarise(),
            }
            for way, one in scores.items()
        ]
        rows += [{"generator": name, **row} for row in compare_all(scores)]
    return StudyReport(
        name="bruise",
        title="Bruises of another shape, and rot (simulated)",
        provenance=(
            "Simulated, at level lab. The second generator is described in "
            "`palpate_studies.second.fruit`, fixed before it was scored; the model that "
            "palpate ships was learned on the first.",
        ),
        tables=[
            Table.wide(
                "Bruised or sound: area under the ROC curve, and percent found at "
                f"{100 * FALSE_ALARMS:g} % false alarms",
                ways,
                {"way": "{way}"},
                over="generator",
                form="{auc:.3f}, {found:.0p}",
            )
        ],
        payload={"simulated": True, "ways": ways, "compared": rows},
    )


def save_sides(known: Mapping[str, LabelledTable], learned_on: str, path: Path) -> None:
    """Write known sides as JSON, in the form of those that come with palpate."""
    document = {
        "learned_on": learned_on,
        "sides": {
            name: {"labels": table.labels, "contrasts": table.rows.round(_DIGITS).tolist()}
            for name, table in known.items()
        },
    }
    with atomic_path(path) as unfinished:
        unfinished.write_text(json.dumps(document, allow_nan=False, separators=(",", ":")) + "\n")
