"""The kinds of produce in a simulated crate, and what each differs in.

Fixed, with their reasons, before anything was measured on them.
"""

from __future__ import annotations

from dataclasses import dataclass

from palpate.twin.ranges import Pair


@dataclass(frozen=True, slots=True, kw_only=True)
class CrateKind:
    """Ranges of the items of one kind in a mixed crate; pairs are (low, high)."""

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
