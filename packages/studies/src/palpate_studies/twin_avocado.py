"""A simulated ripening avocado: mean firmness and firmness of single spots.

The elastic force at 1 mm falls as

    c(t) = softest + (hard - softest) (1 + exp((t - half_day) / pace_days)) ** -skew,

with a time t whose rate varies from day to day with the room temperature.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.twin.objects import TwinObject
from palpate.twin.ranges import draw_log_uniform, draw_uniform
from palpate_studies.fruit_ranges import AVOCADO_BOUNDS_N, AVOCADO_STAGES, AVOCADOS, AvocadoRanges

#: Yield force as a fraction of the rupture force, as for other fruit of the twin.
_YIELD_FRACTION = (0.75, 0.95)
#: Time constants of relaxation, as for other fruit of the twin.
_RELAXING_S = ((0.2, 1.0), (1.0, 8.0), (8.0, 80.0))
#: Days with a drawn room temperature; on other days the pace is 1.
_DAYS = 14


@dataclass(frozen=True, slots=True, kw_only=True)
class Avocado:
    """One fruit.

    Examples
    --------
    >>> fruit = draw_avocado(np.random.default_rng(2))
    >>> fruit.force_at_1mm_n(0.0) > fruit.force_at_1mm_n(2.0) > fruit.force_at_1mm_n(5.0)
    True
    """

    #: Mean width of the waist.
    size_mm: float
    #: Elastic force at 1 mm before and after softening.
    hard_n: float
    softest_n: float
    #: Parameters of the softening curve in the module docstring.
    half_day: float
    pace_days: float
    skew: float
    #: Progress of ripening from each day to the next, days.
    days_of_room: tuple[float, ...]
    #: As in `TwinObject`.
    relaxing_fractions: tuple[float, ...]
    relaxing_time_s: tuple[float, ...]
    #: Rupture force / sqrt(force at 1 mm): soft fruit bursts at lower forces.
    rupture_per_root: float
    #: Scatter of firmness and width from spot to spot.
    spot_log_sd: float
    waist_sd_mm: float
    #: Mass, grams.
    mass_g: float

    def force_at_1mm_n(self, day: float) -> float:
        """Return the mean elastic force at 1 mm of deformation, `day` days after the first."""
        ripened = float(np.interp(day, np.arange(_DAYS + 1), np.cumsum((0, *self.days_of_room))))
        # Outside the drawn days the pace is 1.
        ripened += min(day, 0.0) + max(day - _DAYS, 0.0)
        left = (1.0 + np.exp((ripened - self.half_day) / self.pace_days)) ** -self.skew
        return float(self.softest_n + (self.hard_n - self.softest_n) * left)

    def stage(self, day: float) -> str:
        """Return the true stage on a day."""
        passed = sum(self.force_at_1mm_n(day) < bound for bound in AVOCADO_BOUNDS_N)
        return AVOCADO_STAGES[passed]

    def day_of(self, stage: str) -> float:
        """Return the day on which a stage begins; minus infinity for the first stage."""
        index = AVOCADO_STAGES.index(stage)
        if index == 0:
            return -np.inf
        low, high = -30.0, 60.0
        while high - low > 1e-6:
            day = 0.5 * (low + high)
            softer = self.force_at_1mm_n(day) < AVOCADO_BOUNDS_N[index - 1]
            low, high = (low, day) if softer else (day, high)
        return high

    def spot(self, day: float, *, rng: np.random.Generator) -> TwinObject:
        """Return one random spot of the fruit on a day, for a grasp."""
        firmness_n = self.force_at_1mm_n(day) * float(np.exp(self.spot_log_sd * rng.normal()))
        rupture_n = self.rupture_per_root * float(np.sqrt(firmness_n))
        return TwinObject(
            name="avocado",
            size_mm=self.size_mm + self.waist_sd_mm * float(rng.normal()),
            contact="hertz",
            force_at_1mm_n=firmness_n,
            relaxing_fractions=self.relaxing_fractions,
            relaxing_time_s=self.relaxing_time_s,
            flat=False,
            yield_n=rupture_n * draw_uniform(rng, _YIELD_FRACTION),
            rupture_n=rupture_n,
            mass_g=self.mass_g,
        )


def draw_avocado(rng: np.random.Generator, *, ranges: AvocadoRanges = AVOCADOS) -> Avocado:
    """Draw one fruit."""
    fractions = rng.dirichlet((2.0, 2.0, 2.0)) * draw_uniform(rng, ranges.relaxing)
    return Avocado(
        size_mm=draw_uniform(rng, ranges.size_mm),
        hard_n=draw_log_uniform(rng, ranges.hard_n_log),
        softest_n=draw_log_uniform(rng, ranges.softest_n_log),
        half_day=draw_uniform(rng, ranges.half_day),
        pace_days=draw_uniform(rng, ranges.pace_days),
        skew=draw_uniform(rng, ranges.skew),
        days_of_room=tuple(np.exp(ranges.room_log_sd * rng.standard_normal(_DAYS)).tolist()),
        relaxing_fractions=tuple(fractions.tolist()),
        relaxing_time_s=tuple(draw_log_uniform(rng, pair) for pair in _RELAXING_S),
        rupture_per_root=draw_uniform(rng, ranges.rupture_per_root),
        spot_log_sd=ranges.spot_log_sd,
        waist_sd_mm=ranges.waist_sd_mm,
        mass_g=draw_uniform(rng, ranges.mass_g),
    )
