"""Parameter ranges of the studies' fruit: apples, bruises, avocados, and a station.

The ranges and their reasons were fixed before any measurement. The scatter of the fruit is the same
at both levels of the twin; the levels change sheet and gripper (`palpate.twin.ranges`).
"""

from __future__ import annotations

from dataclasses import dataclass

from palpate.twin.ranges import Pair

# -- Apples and their bruises ----------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class AppleRanges:
    """Ranges of sound apples; attributes as in `palpate_studies.twin_apple.Apple`.

    The hand opens to 74 mm, so the apples have smaller grades (60 to 70 mm). Stiffness ranges from
    soft after long storage to fresh and crisp. Ovality is up to 1.2 % (widths of one fruit differ
    by up to 1.6 mm), with the five lobes of an apple. One side, the sunny one, is firmer by up to
    13 %. Opposite sides then differ as much as the two penetrometer readings of 720 real apples.
    Their whole scatter (log sd 0.073, including the instrument's) is attributed to the fruit. The
    other ranges are plausible, not measured.
    """

    diameter_mm: Pair = (60.0, 70.0)
    force_at_1mm_n_log: Pair = (8.0, 25.0)
    oval: Pair = (0.0, 0.012)
    lobes: Pair = (0.0, 0.005)
    firmer: Pair = (0.0, 0.13)
    leaning_mm: Pair = (0.0, 1.5)


@dataclass(frozen=True, slots=True, kw_only=True)
class BruiseRanges:
    """Ranges of bruises; attributes as in `palpate_studies.twin_apple.Bruise`.

    Diameters range from 11.3 mm (1 cm2, the largest total area that the European marketing standard
    allows in Class I) to 30 mm (a fall of about one metre onto a hard floor). The depth is a
    quarter to nearly half of the diameter. Flesh with burst cells has a fifth to three fifths of
    the modulus. Apples rebound with about half of their speed, so most of the energy of an impact
    crushes flesh: three tenths (immediately) to eight tenths (after days of drying) of the
    flattening remain as a dent. Falls and impacts hit the cheeks near the widest place, where the
    fingers touch too. All ranges are plausible, not measured.
    """

    diameter_mm_log: Pair = (11.3, 30.0)
    depth_over_diameter: Pair = (0.25, 0.45)
    softness: Pair = (0.2, 0.6)
    dent_fraction: Pair = (0.3, 0.8)
    height_mm: Pair = (-10.0, 10.0)


APPLES = AppleRanges()
BRUISES = BruiseRanges()

# -- Avocados over days ----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class AvocadoRanges:
    """Ranges of avocados that ripen at 20 C; attributes as in `twin_avocado.Avocado`.

    Penetrometers (8 mm tip) read about 200 N in hard fruit, 80 N in conditioned, 19 N in nearly
    ripe and less than 7 N in fully ripe fruit: a fall by a factor of about 30. Most of the fall
    takes place within four days. The pause before the climacteric differs most from fruit to fruit
    (Burdon and Billing 2024), and ethylene at the packhouse has partly shortened it. The elastic
    force between fingers is assumed proportional to the 0.7th power of the penetration force: from
    12-24 N at 1 mm (a modulus of about 4 MPa) down to 0.5-1 N. Firmness differs by a tenth from
    spot to spot, the waist is not quite round, and the room temperature changes from day to day.
    A ripe fruit relaxes more, but here relaxation is the same at all stages, because its course is
    not known well enough to help distinguish them. All ranges are plausible, not measured.
    """

    size_mm: Pair = (58.0, 68.0)
    hard_n_log: Pair = (12.0, 24.0)
    softest_n_log: Pair = (0.5, 1.0)
    half_day: Pair = (-1.0, 3.0)
    pace_days: Pair = (0.7, 1.3)
    skew: Pair = (0.7, 1.4)
    room_log_sd: float = 0.12
    spot_log_sd: float = 0.08
    waist_sd_mm: float = 0.4
    relaxing: Pair = (0.10, 0.30)
    rupture_per_root: Pair = (11.0, 18.0)
    mass_g: Pair = (150.0, 220.0)


AVOCADOS = AvocadoRanges()
#: Stages, and the force at 1 mm at which each stage after the first begins: 80, 19 and 5 N of
#: penetration, converted with the power above.
AVOCADO_STAGES = ("hard", "conditioned", "ripe", "overripe")
AVOCADO_BOUNDS_N = (8.5, 3.2, 1.3)


@dataclass(frozen=True, slots=True, kw_only=True)
class StationRanges:
    """Use and climate of a sensor that grasps avocados on some mornings.

    `cycles_per_day` are grasps of other objects between two mornings. Temperatures are those of the
    paper's Figure 3; the humidities are assumed.
    """

    cycles_per_day: Pair = (100.0, 400.0)
    temperature_c: Pair = (14.8, 26.8)
    humidity_percent: Pair = (40.0, 70.0)


STATION = StationRanges()
