"""All ranges of the studies' fruit: apples and bruises, avocados, a station.

Fixed, with their reasons, before anything was measured on them. Fruit scatters alike at both levels
of the twin; what the levels change is sheet and gripper (`palpate.twin.ranges`).
"""

from __future__ import annotations

from dataclasses import dataclass

from palpate.twin.ranges import Pair

# -- Apples and their bruises ----------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class AppleRanges:
    """Ranges of sound apples; attributes as of `palpate_studies.twin_apple.Apple`.

    The hand opens to 74 mm, so the apples are of the smaller grades (60 to 70 mm). Stiffness goes
    from soft after long storage to fresh and crisp. They are oval by up to 1.2 % (widths differ by
    up to 1.6 mm around one fruit) and lobed as apples are; one side is firmer by up to 13 %, as
    the side that ripened in the sun is: opposite sides then differ as the two penetrometer readings
    of 720 real apples do, all of whose scatter (log sd 0.073, the instrument's included) is taken
    as the fruit's. The rest is plausible, not measured.
    """

    diameter_mm: Pair = (60.0, 70.0)
    force_at_1mm_n_log: Pair = (8.0, 25.0)
    oval: Pair = (0.0, 0.012)
    lobes: Pair = (0.0, 0.005)
    firmer: Pair = (0.0, 0.13)
    leaning_mm: Pair = (0.0, 1.5)


@dataclass(frozen=True, slots=True, kw_only=True)
class BruiseRanges:
    """Ranges of bruises; attributes as of `palpate_studies.twin_apple.Bruise`.

    From 1 cm2 (11.3 mm across: the largest total area that the European marketing standard lets
    pass in Class I) to 30 mm (a fall of a metre or so onto a hard floor). A quarter to nearly half
    as deep as wide. Burst cells leave a fifth to three fifths of the modulus. Apples rebound with
    about half of their speed, so most of the energy of a blow goes into crushed flesh: three tenths
    (at once) to eight tenths (dried for days) of the flattening stay. Falls and knocks hit the
    cheeks, near the widest place, where the fingers go too. Plausible, not measured.
    """

    diameter_mm_log: Pair = (11.3, 30.0)
    depth_over_diameter: Pair = (0.25, 0.45)
    softness: Pair = (0.2, 0.6)
    dent_share: Pair = (0.3, 0.8)
    height_mm: Pair = (-10.0, 10.0)


APPLES = AppleRanges()
BRUISES = BruiseRanges()

# -- Avocados over days ----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class AvocadoRanges:
    """Ranges of avocados that ripen at 20 C; attributes as of `twin_avocado.Avocado`.

    Penetrometers find some 200 N in hard fruit, 80 N in conditioned, 19 N in nearly ripe and less
    than 7 N in fully ripe fruit (8 mm tip): a fall by a factor of about 30, most of it within four
    days, after a pause before the climacteric that differs most from fruit to fruit (Burdon and
    Billing 2024) and that ethylene at the packhouse has partly used up. Elastic force between
    fingers is taken to go with the 0.7th power of penetration: from 12-24 N at 1 mm (a modulus of
    about 4 MPa) down to 0.5-1. Flesh differs by a tenth from spot to spot and the waist is not
    quite round, so each grasp meets a slightly different fruit; rooms are not equally warm on all
    days. Relaxation is the same at all stages here, though a ripe fruit relaxes more: what would
    help to distinguish stages and is not known well enough is left out. Plausible, not measured.
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
#: Stages, and the force at 1 mm below which each but the first begins: 80, 19 and 5 N of
#: penetration by the power above.
AVOCADO_STAGES = ("hard", "conditioned", "ripe", "overripe")
AVOCADO_BOUNDS_N = (8.5, 3.2, 1.3)


@dataclass(frozen=True, slots=True, kw_only=True)
class StationRanges:
    """Surroundings of a sensor that feels avocados on some mornings and other objects all day.

    Grasps of other objects between two mornings, and the bench's temperature and humidity (the
    temperatures of the paper's Figure 3; its humidities are ours).
    """

    cycles_per_day: Pair = (100.0, 400.0)
    temperature_c: Pair = (14.8, 26.8)
    humidity_percent: Pair = (40.0, 70.0)


STATION = StationRanges()
