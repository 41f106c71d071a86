"""Every range that twin produce is drawn from, in one place: one section for each kind of question.

Fixed, with their reasons, before anything was measured on them. Fruit scatters alike at both levels
of the twin; what the levels change is sheet and gripper (`palpate.twin.ranges`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from palpate.twin.ranges import Pair

# -- Apples and their bruises ----------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class AppleRanges:
    """What sound apples differ in; attributes as of `palpate.twin.apple.Apple`.

    The hand opens to 74 mm, so the apples are of the smaller grades (60 to 70 mm). Stiffness goes
    from soft after long storage to fresh and crisp. They are oval by up to 1.2 % (widths differ by
    up to 1.6 mm around one fruit) and lobed as apples are; one side is firmer by up to 10 %, as the
    side that ripened in the sun is. Plausible, not measured.
    """

    diameter_mm: Pair = (60.0, 70.0)
    force_at_1mm_n_log: Pair = (8.0, 25.0)
    oval: Pair = (0.0, 0.012)
    lobes: Pair = (0.0, 0.005)
    firmer: Pair = (0.0, 0.10)
    leaning_mm: Pair = (0.0, 1.5)


@dataclass(frozen=True, slots=True, kw_only=True)
class BruiseRanges:
    """What bruises differ in; attributes as of `palpate.twin.apple.Bruise`.

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
#: Below what grades limit: reported apart.
SMALL_BRUISES = replace(BRUISES, diameter_mm_log=(4.0, 11.3))
#: Beyond the belt that fingers touch: reported apart; the belt is not the fruit.
BRUISES_OFF_THE_BELT = replace(BRUISES, height_mm=(12.0, 25.0))
#: One side dropped on cement (paper, section 4.3): a bruise at the large end of the ranges.
DROPPED = replace(BRUISES, diameter_mm_log=(25.0, 30.0), height_mm=(-2.0, 2.0))

# -- A mixed crate ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class CrateKind:
    """What the items of one kind in a mixed crate are drawn from; pairs are (low, high)."""

    #: Mean diameter about the closing axis; the hand takes each item across its short side.
    size_mm: Pair
    #: Apparent modulus between plates; with the size it gives the Hertz law. None for shells.
    modulus_mpa: Pair | None = None
    #: Stiffness of a shell, which is linear. None for flesh.
    shell_n_per_mm: Pair | None = None
    #: Largest difference, as a share, of the diameter at one side from the mean diameter.
    out_of_round: float
    #: Share of the force that relaxes away under a hold.
    relaxing: Pair = (0.10, 0.30)
    #: Force at which it bursts or breaks; None for what doesn't.
    rupture_n: Pair | None = None
    #: Mass, grams.
    mass_g: Pair


#: Poisson's ratio of flesh; scatter (log sd) of the stiffness from side to side of one item.
CRATE_POISSON, CRATE_SIDE_LOG_SD = 0.35, 0.08

#: Kinds that are taught. Sizes are the trade's usual ones; moduli are orders of magnitude from the
#: literature on whole fruit between plates (ASAE S368; Mohsenin, Physical Properties of Plant and
#: Animal Materials, 1986): some tenths of an MPa for what is ripe to eat, a few MPa for what is
#: crisp. The kiwi's are those that recorded robot grasps need, shells those of hens' eggs pressed
#: across. Fixed before anything was measured on them; several kinds overlap, as they do in a shop.
CRATE_TAUGHT: dict[str, CrateKind] = {
    "cherry-tomato": CrateKind(
        size_mm=(22, 31),
        modulus_mpa=(0.8, 2.2),
        out_of_round=0.04,
        rupture_n=(9, 22),
        mass_g=(8, 18),
    ),
    "strawberry": CrateKind(
        size_mm=(27, 40),
        modulus_mpa=(0.25, 0.8),
        out_of_round=0.08,
        relaxing=(0.15, 0.35),
        rupture_n=(6, 14),
        mass_g=(10, 32),
    ),
    "lime": CrateKind(
        size_mm=(41, 50),
        modulus_mpa=(1.5, 3.5),
        out_of_round=0.03,
        rupture_n=(60, 120),
        mass_g=(45, 75),
    ),
    "egg": CrateKind(
        size_mm=(41, 46),
        shell_n_per_mm=(90, 180),
        out_of_round=0.01,
        relaxing=(0.0, 0.005),
        rupture_n=(28, 45),
        mass_g=(50, 68),
    ),
    "kiwi": CrateKind(
        size_mm=(45, 55),
        modulus_mpa=(0.3, 0.9),
        out_of_round=0.05,
        rupture_n=(4.5, 9),
        mass_g=(70, 110),
    ),
    "tomato": CrateKind(
        size_mm=(50, 62),
        modulus_mpa=(0.7, 1.8),
        out_of_round=0.04,
        rupture_n=(15, 40),
        mass_g=(70, 140),
    ),
    "peach": CrateKind(
        size_mm=(57, 67),
        modulus_mpa=(0.9, 2.5),
        out_of_round=0.04,
        rupture_n=(20, 50),
        mass_g=(110, 180),
    ),
    "avocado": CrateKind(
        size_mm=(58, 68),
        modulus_mpa=(0.2, 0.6),
        out_of_round=0.04,
        rupture_n=(12, 30),
        mass_g=(150, 220),
    ),
    "apple": CrateKind(
        size_mm=(58, 68),
        modulus_mpa=(3.0, 6.5),
        out_of_round=0.03,
        rupture_n=(45, 90),
        mass_g=(110, 180),
    ),
}

#: Kinds that nobody teaches: what else lies in a crate. Some feel much like a taught kind.
CRATE_STRANGERS: dict[str, CrateKind] = {
    "grape": CrateKind(
        size_mm=(16, 22),
        modulus_mpa=(0.4, 1.2),
        out_of_round=0.08,
        rupture_n=(6, 14),
        mass_g=(4, 9),
    ),
    "walnut": CrateKind(
        size_mm=(29, 37),
        shell_n_per_mm=(120, 300),
        out_of_round=0.05,
        relaxing=(0.0, 0.01),
        rupture_n=(150, 400),
        mass_g=(9, 15),
    ),
    "mushroom": CrateKind(
        size_mm=(36, 50),
        modulus_mpa=(0.08, 0.25),
        out_of_round=0.08,
        relaxing=(0.2, 0.4),
        rupture_n=(8, 20),
        mass_g=(12, 35),
    ),
    "potato": CrateKind(
        size_mm=(42, 60),
        modulus_mpa=(3.0, 6.0),
        out_of_round=0.12,
        rupture_n=(150, 400),
        mass_g=(60, 150),
    ),
    "foam-ball": CrateKind(
        size_mm=(50, 66),
        modulus_mpa=(0.02, 0.08),
        out_of_round=0.01,
        relaxing=(0.05, 0.15),
        mass_g=(4, 12),
    ),
    "stone": CrateKind(
        size_mm=(30, 60),
        shell_n_per_mm=(400, 600),
        out_of_round=0.15,
        relaxing=(0.0, 0.001),
        mass_g=(60, 300),
    ),
}

# -- Avocados over days ----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class AvocadoRanges:
    """What avocados that ripen at 20 C differ in; attributes as of `palpate.twin.avocado.Avocado`.

    Penetrometers find some 200 N in hard fruit, 80 N in conditioned, 19 N in nearly ripe and less
    than 7 N in fully ripe fruit (8 mm tip): a fall by a factor of about 30, most of it within four
    days, after a pause before the climacteric that differs most from fruit to fruit (Burdon and
    Billing 2024) and that ethylene at the packhouse has partly used up. Elastic force between
    fingers is taken to go with the 0.7th power of penetration: from 12-24 N at 1 mm (a modulus of
    about 4 MPa) down to 0.5-1. Flesh differs by a tenth from spot to spot and the waist is not
    quite round, so each grasp meets a slightly different fruit; rooms are not equally warm on all
    days. Relaxation is the same at all stages here, though a ripe fruit relaxes more: what would
    help to tell stages apart and is not known well enough is left out. Plausible, not measured.
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
    """What surrounds a sensor that feels avocados on some mornings and other things all day.

    Grasps of other things between two mornings, and the bench's temperature and humidity (the
    temperatures of the paper's Figure 3; its humidities are ours).
    """

    cycles_per_day: Pair = (100.0, 400.0)
    temperature_c: Pair = (14.8, 26.8)
    humidity_percent: Pair = (40.0, 70.0)


STATION = StationRanges()
