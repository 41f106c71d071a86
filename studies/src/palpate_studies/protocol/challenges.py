"""Three challenges on real recordings, each a list of cases and how they are split.

- ``settled``: the value that a silicone hold settles to at 20 s, from its first 2.5 s. `curve` is
  time (s) and reading (ohm), `asked` 20 s, `scale` the last reading. Specimens are left out whole.
- ``ladders``: the dead weight on a Velostat sensor, given three of its loads. `curve` is the excess
  conductance over that at rest, and load (N), of those three, `asked` the former in question,
  `scale` the last given load. Sensors are left out whole.
- ``rupture``: the force at which a fruit ruptures, when 1.5 N are first reached. `curve` is closure
  (mm) and force (N) so far, `asked` that closure, `scale` that force; `kind` is the fruit. Fruits
  that rupture below, or whose record begins above, are left out. Fruits are split in five.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate.arrays import FloatArray
from palpate.estimate.damage_learning import copies, read_closings
from palpate.holds import read_holds, settled_value
from palpate_studies.force_ladders import read_ladders
from palpate_studies.protocol.method import Case, Question
from palpate_studies.protocol.parts import Fold, folds
from palpate_studies.specimens import specimen_of

CUTOFF_S, HORIZON_S = 2.5, 20.0
#: Steps of a ladder that are given; loads that are asked for lie above the second, newtons.
TOLD, LEAST_LOAD_N = 3, 0.5
#: Force at which a fruit is asked about, newtons.
ASKED_N = 1.5
_PARTS = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Challenge:
    """A name, what is asked, the cases, and the folds."""

    name: str
    asks: str
    cases: tuple[Case, ...]
    folds: tuple[Fold, ...]


def settled(data: Path) -> Challenge:
    """Return the challenge of settled values, from `holds_cbsilicone.csv.gz`."""
    cases = []
    for hold in read_holds(data / "holds_cbsilicone.csv.gz", until_s=HORIZON_S):
        truth = settled_value(hold.time_s, hold.values, horizon_s=HORIZON_S)
        seen = hold.time_s <= CUTOFF_S
        if np.isfinite(truth) and seen.sum() >= 2:
            curve = np.column_stack([hold.time_s[seen], hold.values[seen]])
            question = Question(
                curve=curve, asked=HORIZON_S, scale=float(curve[-1, 1]), kind="silicone"
            )
            whole = np.column_stack([hold.time_s, hold.values])
            cases.append(_case(question, truth, specimen_of(hold.hold_id), hold.hold_id, whole))
    return challenge_of("settled", "settled value of real silicone holds from 2.5 s", cases)


def ladders(data: Path) -> Challenge:
    """Return the challenge of dead weights, from `velostat_force_ladders.csv`."""
    cases = []
    for one in read_ladders(data / "velostat_force_ladders.csv"):
        excess = one.excess_s * one.rest_ohm
        whole = np.column_stack([excess, one.load_n])
        curve = whole[:TOLD]
        for step in range(TOLD, len(one.load_n)):
            if one.load_n[step] > LEAST_LOAD_N:
                question = Question(
                    curve=curve,
                    asked=float(excess[step]),
                    scale=float(curve[-1, 1]),
                    kind="velostat",
                )
                name = f"{one.name}, step {one.step[step]}"
                cases.append(_case(question, float(one.load_n[step]), one.name, name, whole))
    return challenge_of("ladders", "weight on real Velostat, told three loads", cases)


def rupture(data: Path) -> Challenge:
    """Return the challenge of rupture forces, from `fruit_rupture.csv.gz` and its index."""
    closings = read_closings(data / "fruit_rupture.csv.gz", data / "fruit_rupture_index.csv")
    copied, cases = copies(closings), []
    for closing in closings:
        reached = np.flatnonzero(closing.samples[:, 1] >= ASKED_N)
        if closing.grasp_id in copied or not reached.size or reached[0] < 2:
            continue
        curve = closing.samples[: reached[0] + 1]
        question = Question(
            curve=curve, asked=float(curve[-1, 0]), scale=float(curve[-1, 1]), kind=closing.fruit
        )
        name = closing.grasp_id
        cases.append(_case(question, closing.rupture_force_n, name, name, closing.samples))
    return challenge_of("rupture", "rupture force of real fruit at 1.5 N", cases)


def _case(question: Question, truth: float, specimen: str, name: str, whole: FloatArray) -> Case:
    return Case(question=question, truth=truth, specimen=specimen, name=name, whole=whole)


def challenge_of(name: str, asks: str, cases: list[Case]) -> Challenge:
    """Return a challenge whose specimens are split into folds."""
    specimens = [case.specimen for case in cases]
    parts = folds(specimens, count=min(_PARTS, len(set(specimens))))
    return Challenge(name=name, asks=asks, cases=tuple(cases), folds=tuple(parts))


#: Name -> what reads it from the folder of recordings.
CHALLENGES: Mapping[str, Callable[[Path], Challenge]] = {
    "settled": settled,
    "ladders": ladders,
    "rupture": rupture,
}
