"""The three questions on cases that no method was written for.

Fixed, with their seeds, before anything was scored on them.

- ``settled``: drawn holds (no sensor) whose relaxation is no shape of the predictor: one that falls
  and climbs back, one that falls in steps, one that waits and then falls. Six sensors of each.
- ``ladders``: weights on simulated sheets with a logarithmic law, play and even creep
  (`other_sheets`), in mixed order.
- ``rupture``: the real fruit, but the kind that is tested is none of those that were learned from,
  and no kind is given. (No other fruit was recorded: this is a split, not a generator.)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from palpate.arrays import FloatArray
from palpate.sensor.array import RIGID_LAYOUT
from palpate.twin.ranges import log_uniform
from palpate.twin.sheet_state import SheetState
from palpate.twin.velostat import draw_sheet
from palpate_studies.other_sheets import other_sheet
from palpate_studies.protocol.challenges import (
    CUTOFF_S,
    HORIZON_S,
    LEAST_LOAD_N,
    TOLD,
    Challenge,
    challenge_of,
    rupture,
)
from palpate_studies.protocol.method import Case, Question
from palpate_studies.protocol.parts import Fold

#: Seed of everything drawn here.
SEED = 96_200
#: Sensors of each shape and holds on each; their rate, noise as a share of the reading, and the
#: readings that they begin at.
_SENSORS, _HOLDS, _RATE_HZ, _NOISE, _FIRST_OHM = 6, 10, 15.0, 1e-3, (200.0, 8000.0)
#: Simulated ladders: sheets, weights on each, their range, N; seconds under each weight and before
#: it; gain from place to place and reading error, both as sd of the logarithm.
_SHEETS, _WEIGHTS, _WEIGHTS_N, _UNDER_S, _OFF_S = 12, 22, (0.2, 11.3), 10.0, 30.0
_PLACE_LOG_SD, _READ_LOG_SD = 0.1, 0.01


def settled(data: Path) -> Challenge:
    """Return drawn holds of three shapes, sensors left out whole."""
    rng, sizes = (np.random.default_rng([SEED, stream]) for stream in (0, 2))
    time_s = np.arange(0.0, HORIZON_S + 0.5, 1.0 / _RATE_HZ)
    seen = time_s <= CUTOFF_S
    at_end = (time_s > HORIZON_S - 0.5) & (time_s <= HORIZON_S)
    cases = []
    for shape, draw in _SHAPES.items():
        for sensor in range(_SENSORS):
            centre, first_ohm = rng.uniform(0.0, 1.0, 3), log_uniform(sizes, _FIRST_OHM)
            for number in range(_HOLDS):
                clean = draw(rng, time_s, np.clip(centre + 0.1 * rng.standard_normal(3), 0.0, 1.0))
                value = first_ohm * clean * (1.0 + _NOISE * rng.standard_normal(time_s.size))
                curve = np.column_stack([time_s, value])
                cases.append(
                    Case(
                        question=Question(
                            curve=curve[seen],
                            asked=HORIZON_S,
                            scale=float(curve[seen][-1, 1]),
                            kind="drawn",
                        ),
                        truth=float(value[at_end].mean()),
                        specimen=f"{shape} {sensor}",
                        name=f"{shape} {sensor}, hold {number}",
                        whole=curve,
                    )
                )
    return challenge_of("settled", "settled value of drawn holds of other shapes from 2.5 s", cases)


def _climbs_back(rng: np.random.Generator, time_s: FloatArray, at: FloatArray) -> FloatArray:
    """Draw a fall of some seconds, of which a part is climbed back."""
    fall_s, back_s, back = 0.5 + 2.5 * at[0], 4.0 + 8.0 * at[1], 0.2 + 0.4 * at[2]
    fall = -np.expm1(-time_s / fall_s)
    return np.asarray(1.0 - 0.15 * (fall + back * np.expm1(-((time_s / back_s) ** 2))))


def _in_steps(rng: np.random.Generator, time_s: FloatArray, at: FloatArray) -> FloatArray:
    """Draw slips: steps down, ever rarer, of sizes that chance gives."""
    count = 5 + int(10 * at[0])
    slips_s = 0.1 * np.exp(rng.uniform(0.0, np.log(200.0), count))
    size = (0.05 + 0.15 * at[1]) * rng.dirichlet(np.full(count, 1.0 + 2.0 * at[2]))
    return np.asarray(1.0 - (time_s[:, None] >= slips_s) @ size)


def _waits(rng: np.random.Generator, time_s: FloatArray, at: FloatArray) -> FloatArray:
    """Draw a fall that begins late and is steepest in its middle."""
    middle_s, steep, size = 1.0 + 5.0 * at[0], 1.5 + 1.5 * at[1], 0.05 + 0.2 * at[2]
    return np.asarray(1.0 - size * time_s**steep / (time_s**steep + middle_s**steep))


_SHAPES: Mapping[str, Callable[[np.random.Generator, FloatArray, FloatArray], FloatArray]] = {
    "climbs back": _climbs_back,
    "in steps": _in_steps,
    "waits": _waits,
}


def ladders(data: Path) -> Challenge:
    """Return weights on simulated sheets of another kind, sheets left out whole."""
    cases = []
    for number in range(_SHEETS):
        whole, name = _ladder(number), f"sheet-{number}"
        for step in range(TOLD, len(whole)):
            if whole[step, 1] > LEAST_LOAD_N:
                question = Question(
                    curve=whole[:TOLD],
                    asked=float(whole[step, 0]),
                    scale=float(whole[TOLD - 1, 1]),
                    kind="velostat",
                )
                cases.append(
                    Case(
                        question=question,
                        truth=float(whole[step, 1]),
                        specimen=name,
                        name=f"{name}, step {step}",
                        whole=whole,
                    )
                )
    return challenge_of("ladders", "weight on simulated sheets of another law, three given", cases)


def _ladder(number: int) -> FloatArray:
    """Return excess conductance and load of each weight in turn, shape (weights, 2)."""
    rng = np.random.default_rng([SEED, 1, number])
    sheet = other_sheet(draw_sheet(rng, layout=RIGID_LAYOUT, level="field"))
    creep = sheet.family.draw(rng)
    state = SheetState.unloaded(sheet.gain.size, creep=creep)
    load_n = np.sort([log_uniform(rng, _WEIGHTS_N) for _ in range(_WEIGHTS)])
    # The first three, which are given, cover the range; the others come in any order.
    order = [2, _WEIGHTS // 2, _WEIGHTS - 3]
    order += rng.permutation([k for k in range(_WEIGHTS) if k not in order]).tolist()
    rows, pixels = [], sheet.gain.size
    for weight_n in load_n[order]:
        gain = sheet.gain * np.exp(_PLACE_LOG_SD * rng.standard_normal())
        for under_n, lasts_s in ((0.0, _OFF_S), (weight_n / 4.0, _UNDER_S)):
            for _ in range(20):
                state = state.after(
                    lasts_s / 20,
                    np.full(pixels, under_n),
                    travel_mm=0.0,
                    sheet=sheet,
                    gain=gain,
                    creep=creep,
                )
        misread = np.exp(_READ_LOG_SD * rng.standard_normal())
        ohm = state.resistance_ohm(sheet, creep=creep) * misread
        rows.append((max(float(np.mean(sheet.rest_ohm / ohm - 1.0)), 1e-3), weight_n))
    return np.array(rows)


def rupture_of_other_kinds(data: Path) -> Challenge:
    """Return the fruit of `rupture`, each kind in turn asked about and not learned from."""
    real = rupture(data)
    cases = tuple(replace(c, question=replace(c.question, kind="fruit")) for c in real.cases)
    kinds = list(dict.fromkeys(case.question.kind for case in real.cases))
    of = {
        kind: tuple(case.specimen for case in real.cases if case.question.kind == kind)
        for kind in kinds
    }
    parts = tuple(
        Fold(train=of[kinds[k - 2]], choose=of[kinds[k - 1]], test=of[kinds[k]])
        for k in range(len(kinds))
    )
    return replace(
        real, asks="rupture force of real fruit of a kind not learned", cases=cases, folds=parts
    )


#: Name -> what makes it; the folder of recordings is needed by the last alone.
OTHER_CHALLENGES: Mapping[str, Callable[[Path], Challenge]] = {
    "settled": settled,
    "ladders": ladders,
    "rupture": rupture_of_other_kinds,
}
