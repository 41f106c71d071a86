"""Twin apples of the study `bruise`: how they are drawn, grasped and compared.

A grasp follows a user's steps: search for contact, close on, hold, read every pixel.
"""

from __future__ import annotations

import math
import multiprocessing
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from palpate.arrays import FloatArray
from palpate.produce.bruise.model import Side
from palpate.produce.bruise.shape import LoadShape, median_shape, shape_of
from palpate.signal.circuit import resistance_ohm
from palpate.signal.relative import (
    CONTACT_PERCENT,
    mean_change,
    relative_change_percent,
)
from palpate.twin.devices import TwinArray
from palpate_studies.fruit_ranges import BRUISES
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
        """Return how the load lies: the last three frames before a time, or (20 s) the end."""
        change = self.settled_percent
        if cutoff_s < HOLD_S:
            change = self.change_percent[self.time_s <= cutoff_s][-3:].mean(axis=0)
        return shape_of(change, width_mm=self.width_mm)

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
    """Lay an apple between the fingers, one side to the first of them, and grasp it.

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
    def bruised(self) -> bool:
        """Whether it is."""
        return self.apple.bruise is not None

    def side(self, cutoff_s: float) -> Side:
        """Return what is judged, and all that it is compared with, at a time of the hold."""
        shapes = {name: one.shape(cutoff_s) for name, one in self.presses.items()}
        return Side(
            shape=shapes["now"],
            against={
                "history": shapes["before"],
                "class": self.sound,
                "item": median_shape([shapes["other"]], with_width=True),
            },
        )


def as_drawn(apple: Apple) -> Apple:
    """Return an apple as it is: the first generator."""
    return apple


def examine(
    purposes: Mapping[str, int],
    *,
    levels: Sequence[str],
    seed: int,
    processes: int | None = None,
    remade: Callable[[Apple], Apple] = as_drawn,
) -> list[Examined]:
    """Draw this many apples for each purpose and level, half of them bruised, and grasp them.

    Parameters
    ----------
    purposes : mapping of str to int
        ``learn`` and ``test``.
    levels : sequence of str
        Levels of the twin.
    seed : int
        Seed of everything.
    processes : int, optional
        As many as there are processors by default. The result does not depend on it.
    remade : callable
        Makes the apples of another generator out of those that are drawn.
    """
    batches = [
        (purpose, level, _FIRST_SENSOR[purpose] + 1000 * seed + index, count, remade)
        for purpose, apples in purposes.items()
        for level in levels
        for index, count in enumerate(_split(apples))
    ]
    processes = min(processes or os.cpu_count() or 1, len(batches))
    if processes == 1:
        return [one for batch in batches for one in _batch(*batch)]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, mp_context=context) as pool:
        return [one for made in pool.map(_batch, *zip(*batches, strict=True)) for one in made]


def _split(apples: int) -> list[int]:
    full, rest = divmod(apples, APPLES_PER_SENSOR)
    return [APPLES_PER_SENSOR] * full + [rest] * (rest > 0)


def _batch(
    purpose: str, level: str, sensor: int, apples: int, remade: Callable[[Apple], Apple]
) -> list[Examined]:
    """Examine apples on one sensor."""
    session = Session(sensor, level=level)
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
    return [
        _examined(session, purpose, level, sensor, index, sound=classes, remade=remade)
        for index in range(apples)
    ]


def _examined(
    session: Session,
    purpose: str,
    level: str,
    sensor: int,
    index: int,
    *,
    sound: LoadShape,
    remade: Callable[[Apple], Apple],
) -> Examined:
    rng = np.random.default_rng([sensor, 2, index])
    near = replace(BRUISES, height_mm=(-PLACED_WITHIN_MM, PLACED_WITHIN_MM))
    apple = remade(draw_apple(rng, bruises=near if index % 2 == 1 else None))
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
    if purpose == "test":
        # Not judged: it keeps the load history of the sheet as in the stored results.
        turned["again"] = (apple, angle_deg)
    made = dict(zip(turned, _presses(session, list(turned.values())), strict=True))
    if purpose == "test":
        made["same_width"] = press(
            session, apple, angle_deg=angle_deg, to_mm=made["before"].width_mm - CLOSURE_MM
        )
    session.world.place(None)
    return Examined(
        purpose=purpose,
        level=level,
        sensor=sensor,
        apple=apple,
        angle_deg=angle_deg,
        presses=made,
        sound=sound,
    )


def _presses(session: Session, turned: Sequence[tuple[Apple, float]]) -> list[ApplePress]:
    """Grasp one apple after the other, or one apple turned; the first with fingers wide open."""
    made: list[ApplePress] = []
    for apple, angle_deg in turned:
        open_mm = min(made[-1].width_mm + GAP_MM, OPEN_MM) if made else OPEN_MM
        made.append(press(session, apple, angle_deg=angle_deg, open_mm=open_mm))
    session.world.place(None)
    return made
