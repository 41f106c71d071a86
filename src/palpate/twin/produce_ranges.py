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
    as deep as wide. Burst cells leave a fifth to three fifths of the modulus; of the flattening by
    the blow a tenth to four tenths stays as a dent. Falls and knocks hit the cheeks, near the
    widest place, where the fingers go too. Plausible, not measured.
    """

    diameter_mm_log: Pair = (11.3, 30.0)
    depth_over_diameter: Pair = (0.25, 0.45)
    softness: Pair = (0.2, 0.6)
    dent_share: Pair = (0.1, 0.4)
    height_mm: Pair = (-10.0, 10.0)


APPLES = AppleRanges()
BRUISES = BruiseRanges()
#: Below what grades limit: reported apart.
SMALL_BRUISES = replace(BRUISES, diameter_mm_log=(4.0, 11.3))
#: Beyond the belt that fingers touch: reported apart; the belt is not the fruit.
BRUISES_OFF_THE_BELT = replace(BRUISES, height_mm=(12.0, 25.0))
#: One side dropped on cement (paper, section 4.3): a bruise at the large end of the ranges.
DROPPED = replace(BRUISES, diameter_mm_log=(25.0, 30.0), height_mm=(-2.0, 2.0))
