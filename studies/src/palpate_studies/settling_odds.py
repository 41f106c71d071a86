"""Learn the prior odds of the settling predictor; the shipped ones come from this file.

    palpate study settling-families --holds A --holds B --odds src/palpate/settling/odds.py

The log odds of a component are the sum of one number for its curve and one for its deviation. They
maximise, by gradient, the mean log score of the settled values plus the mean -ln |relative error|
of the mixture's mean, over drawn families and training specimens, every family counted alike and
the real ones more. A ridge keeps what the data don't care about near even odds.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.arrays import FloatArray
from palpate.holds import Hold
from palpate.settling.relaxation import Relaxation
from palpate.settling.scoring import settled_value
from palpate.settling.shapes import DEVIATIONS, N_CURVES
from palpate_studies.settling_families import FAMILIES, draw
from palpate_studies.specimens import FEWEST_SPECIMENS, HORIZON_S, specimen_of

#: Seed and size of the drawn families to learn from; reports use other seeds.
SEED, DRAWN = 11, 60
CUTOFFS_S = (1.0, 2.5, 5.0)
#: Real recordings count this many times as much as a drawn family; those not named here count once.
REAL = {"holds_cbsilicone": 4.0, "holds_velostat": 4.0, "holds_force_relaxation": 1.0}
#: Gradient ascent (Adam): steps, their size, and the ridge that draws log odds towards even.
STEPS, STEP, RIDGE = 60, 0.15, 0.002
#: Errors below this share of the value are noise: neither score asks for better.
FLOOR = 0.003
#: The score's density has heavy tails, so that one hold that no shape fits can't rule the odds.
_TAIL = 4.0
N_DEVIATIONS = len(DEVIATIONS)
EVEN = Relaxation(log_odds=np.zeros((N_DEVIATIONS, N_CURVES)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Unit:
    """Real holds that are left out together, and what they count for."""

    holds: Sequence[Hold]
    weight: float


def units_of(real: Mapping[str, Sequence[Hold]]) -> dict[str, Unit]:
    """Divide recordings into specimens; one of few specimens stays whole."""
    found = {}
    for name, holds in real.items():
        specimens: dict[str, list[Hold]] = {}
        for hold in holds:
            specimens.setdefault(specimen_of(hold.hold_id), []).append(hold)
        few = len(specimens) < FEWEST_SPECIMENS
        parts = {name: holds} if few else {f"{name} {k}": part for k, part in specimens.items()}
        for part, some in parts.items():
            found[part] = Unit(holds=some, weight=REAL.get(name, 1.0) * len(some) / len(holds))
    return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lesson:
    """Holds at all cut-offs: evidence and forecasts, shape (n_rows, n_components); their weight."""

    log_evidence: FloatArray
    forecast: FloatArray
    deviation: FloatArray
    truth: FloatArray
    weight: float


def lesson(holds: Sequence[Hold], *, weight: float = 1.0) -> Lesson:
    """Work out what every component makes of the holds, in ln R, or shares of the settled value."""
    rows = [row for hold in holds for cutoff_s in CUTOFFS_S if (row := _row(hold, cutoff_s))]
    evidence, forecast, deviation, truth = (np.array(part) for part in zip(*rows, strict=True))
    return Lesson(
        log_evidence=evidence.astype(np.float32),
        forecast=forecast.astype(np.float32),
        deviation=deviation.astype(np.float32),
        truth=truth.reshape(-1, 1),
        weight=weight,
    )


def _row(hold: Hold, cutoff_s: float) -> tuple[FloatArray, FloatArray, FloatArray, float] | None:
    settled = settled_value(hold.time_s, hold.values, horizon_s=HORIZON_S)
    seen = hold.time_s <= cutoff_s
    values = hold.values[seen]
    known = EVEN.components(hold.time_s[seen], values, horizon_s=HORIZON_S, lightest=1e-300)
    if np.isnan(settled) or known is None:
        return None
    found, binned = known
    positive = bool((values > 0).all())
    unit = 1.0 if positive else abs(settled)
    dense = np.full((3, N_DEVIATIONS * N_CURVES), [[-1e3], [0.0], [1.0]])
    dense[:, found.component] = np.log(found.weight), found.forecast / unit, found.deviation / unit
    target = np.log(settled) if positive else settled
    return dense[0], dense[1], dense[2], float(target - binned[-1]) / unit


def learn(lessons: Collection[Lesson]) -> FloatArray:
    """Return log odds, shape (n_deviations + n_curves,): those of deviations first."""
    odds = np.zeros(N_DEVIATIONS + N_CURVES)
    mean, square = np.zeros_like(odds), np.zeros_like(odds)
    total = sum(one.weight for one in lessons)
    for step in range(1, STEPS + 1):
        gradient = -RIDGE * odds
        for one in lessons:
            gradient += one.weight / total * _gradient(one, odds)
        mean, square = 0.9 * mean + 0.1 * gradient, 0.98 * square + 0.02 * gradient**2
        size = STEP if step <= 0.7 * STEPS else 0.3 * STEP
        odds += size * (mean / (1 - 0.9**step)) / (np.sqrt(square / (1 - 0.98**step)) + 1e-6)
    return odds


def log_odds(odds: FloatArray) -> FloatArray:
    """Return the log odds of the components, shape (n_deviations, n_curves)."""
    return np.asarray(odds[:N_DEVIATIONS, None] + odds[N_DEVIATIONS:])


def _gradient(one: Lesson, odds: FloatArray) -> FloatArray:
    log_weight = one.log_evidence + log_odds(odds).ravel().astype(np.float32)
    weight = np.exp(log_weight - log_weight.max(axis=1, keepdims=True))
    weight /= weight.sum(axis=1, keepdims=True)
    deviation = np.hypot(one.deviation, np.float32(FLOOR))
    truth = one.truth.astype(np.float32)
    off = (truth - one.forecast) / deviation
    density = (1 + off**2 / _TAIL) ** (-(_TAIL + 1) / 2) / deviation
    likely = weight * density
    given_truth = likely / (likely.sum(axis=1, keepdims=True) + 1e-12)
    middle = (weight * one.forecast).sum(axis=1, keepdims=True)
    error = middle - truth
    closer = -np.sign(error) / (np.abs(error) + FLOOR) * weight * (one.forecast - middle)
    pull = (given_truth - weight + closer).mean(axis=0).reshape(N_DEVIATIONS, N_CURVES)
    return np.concatenate([pull.sum(axis=1), pull.sum(axis=0)]).astype(np.float64)


def lessons_of(real: Mapping[str, Sequence[Hold]]) -> dict[str, Lesson]:
    """Return the lessons of all drawn families and of real recordings, unit by unit."""
    found = {family: lesson(draw(family, DRAWN, seed=SEED)) for family in FAMILIES}
    for name, unit in units_of(real).items():
        found[name] = lesson(unit.holds, weight=unit.weight)
    return found


def source(odds: FloatArray) -> str:
    """Return the odds as the module that ships them."""

    def rows(numbers: FloatArray) -> str:
        words = [f"{number:.2f}".replace("-0.00", "0.00") for number in numbers]
        lines = [" ".join(words[i : i + 14]) for i in range(0, len(words), 14)]
        return "\n".join(lines)

    return f'''"""Prior log odds of deviations and curves, as ordered in `shapes`.

Learned, not written: `palpate study settling-families --odds` regenerates this file.
"""

from __future__ import annotations

import numpy as np

_DEVIATIONS = """
{rows(odds[:N_DEVIATIONS])}
"""
_CURVES = """
{rows(odds[N_DEVIATIONS:])}
"""
#: Of a component: a deviation around a curve, shape (n_deviations, n_curves).
LOG_ODDS = np.add.outer(*(np.array(t.split(), dtype=float) for t in (_DEVIATIONS, _CURVES)))
LOG_ODDS.setflags(write=False)
'''
