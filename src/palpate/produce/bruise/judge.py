"""Is an item bruised, how sure is that, on which pixels, and where on the fruit."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.arrays import FloatArray
from palpate.produce.bruise.model import BruiseModel, Locator, at_share, usable_references
from palpate.produce.bruise.shape import LoadShape, finger_contrast, pixel_contrast, slopes

#: Sides closer than this are one side, placed again; and sides that face other flesh are at least
#: this far apart, degrees.
SAME_SIDE_DEG, OTHER_SIDE_DEG = 15.0, 45.0
#: A pixel that carries at least a fifth less than the one that it faces lies on the bruise.
_LESS = math.log(1.25)
#: No bruise is felt further than this from the middle of a finger's pixels, mm.
_FARTHEST_MM = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Spot:
    """Where a bruise may be."""

    #: That it is this one, if the side is bruised at all.
    probability: float
    #: Which finger touches it, 0 or 1.
    finger: int
    #: Where around the fruit, as the side's angle is counted; None if its size is not known.
    angle_deg: float | None
    #: Above the height at which it was held, along the surface.
    height_mm: float
    #: Pixels that carry at least a fifth less than the ones that they face.
    pixels: tuple[tuple[int, int], ...]
    #: Mean relative change of these pixels: the third column of the paper's Table 6.
    mean_percent: float | None

    @property
    def in_words(self) -> str:
        """Where it is, and how likely."""
        around = "" if self.angle_deg is None else f"{self.angle_deg:.0f}°, "
        place = f"{around}{round(self.height_mm):+d} mm"
        return f"{place} (finger {self.finger + 1}: {100 * self.probability:.0f} %)"


@dataclass(frozen=True, slots=True, kw_only=True)
class FeltSide:
    """One grasp of one side, and the references it may be compared with."""

    #: Which side faced the first finger.
    angle_deg: float
    #: How it loaded the pixels.
    shape: LoadShape
    #: Shape (rows, cols). Relative change of each pixel.
    change_percent: FloatArray
    #: References, by their names in `palpate.produce.bruise.model.REFERENCES`.
    against: Mapping[str, LoadShape]


@dataclass(frozen=True, slots=True, kw_only=True)
class SideVerdict:
    """The verdict on one side."""

    #: Which side.
    angle_deg: float
    #: That it is bruised.
    probability: float
    #: How many grasps it rests on: the mean of their log odds is taken, which promises no more than
    #: one grasp does.
    grasps: int
    #: The references it was compared with.
    against: tuple[str, ...]
    #: Mean relative change over all pixels.
    mean_percent: float
    #: Where, the likelier first; empty where the model knows no places.
    spots: tuple[Spot, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the form that the command prints."""
        return {
            "angle_deg": self.angle_deg,
            "probability": self.probability,
            "grasps": self.grasps,
            "against": list(self.against),
            "mean_percent": self.mean_percent,
            "spots": [
                {
                    "probability": spot.probability,
                    "finger": spot.finger,
                    "angle_deg": spot.angle_deg,
                    "height_mm": spot.height_mm,
                    "pixels": [list(pixel) for pixel in spot.pixels],
                    "mean_percent": spot.mean_percent,
                }
                for spot in self.spots
            ],
        }


def judge_sides(
    felt: Sequence[FeltSide], *, model: BruiseModel, bruised_share: float = 0.5
) -> tuple[SideVerdict, ...]:
    """Judge every side that was felt, the most suspicious first.

    `felt`: grasps; those of one side count together.
    `bruised_share`: share of sides that are expected to be bruised before anything is felt.
    Raises `InputError` if a side has no reference that the model knows.
    """
    sides: list[list[FeltSide]] = []
    for one in felt:
        known = next((side for side in sides if _same_side(side[0], one)), None)
        if known is None:
            sides.append([one])
        else:
            known.append(one)
    verdicts = [_judge_side(side, model=model, bruised_share=bruised_share) for side in sides]
    return tuple(sorted(verdicts, key=lambda verdict: -verdict.probability))


def apart_deg(one_deg: float, other_deg: float) -> float:
    """Return the angle between two sides that a pair of fingers touches, 0 to 90 degrees.

    >>> apart_deg(10.0, 200.0), apart_deg(0.0, 90.0)
    (10.0, 90.0)
    """
    return abs(math.remainder(one_deg - other_deg, 180.0))


def _same_side(one: FeltSide, other: FeltSide) -> bool:
    # Turned by half a turn, the fingers change places: that is another record.
    return abs(math.remainder(one.angle_deg - other.angle_deg, 360.0)) <= SAME_SIDE_DEG


def _judge_side(
    side: Sequence[FeltSide], *, model: BruiseModel, bruised_share: float
) -> SideVerdict:
    log_odds = float(np.mean([model.log_odds(one.shape, one.against) for one in side]))
    last = side[-1]
    name = next((name for name in usable_references(last.against) if name in model.locators), None)
    spots = () if name is None else _spots(side, model.locators[name], name)
    return SideVerdict(
        angle_deg=last.angle_deg,
        probability=at_share(log_odds, bruised_share=bruised_share),
        grasps=len(side),
        against=usable_references(last.against),
        mean_percent=float(np.nanmean([one.change_percent for one in side])),
        spots=spots,
    )


def _spots(side: Sequence[FeltSide], locator: Locator, name: str) -> tuple[Spot, ...]:
    """Return both places that would explain what was felt, the likelier first."""
    pairs = [(one.shape, one.against[name]) for one in side if name in one.against]
    odds = locator.finger.log_odds(np.array([finger_contrast(*pair) for pair in pairs]))
    second = at_share(float(odds.mean()), bruised_share=0.5)
    slope = np.mean([slopes(*pair) for pair in pairs], axis=0)
    change = np.nanmean([one.change_percent for one in side], axis=0)
    rows, cols = change.shape
    less = np.mean([pixel_contrast(*pair, rows=rows, cols=cols) for pair in pairs], axis=0)
    width_mm = side[-1].shape.width_mm
    found = []
    for finger, probability in enumerate((1.0 - second, second)):
        sign = 1 - 2 * finger
        along_mm, across_mm = np.clip(
            sign * slope * np.array(locator.mm_per_slope), -_FARTHEST_MM, _FARTHEST_MM
        )
        mine = np.zeros((rows, cols), dtype=bool)
        mine[finger * rows // 2 : (finger + 1) * rows // 2] = True
        marked = mine & (less <= -_LESS)
        angle_deg = None
        if width_mm is not None:
            # Columns run the other way round the fruit on the second finger.
            beside_deg = math.degrees(sign * across_mm / (width_mm / 2.0))
            angle_deg = (side[-1].angle_deg + 180.0 * finger + beside_deg) % 360.0
        found.append(
            Spot(
                probability=probability,
                finger=finger,
                angle_deg=angle_deg,
                height_mm=float(along_mm),
                pixels=tuple((int(row), int(col)) for row, col in np.argwhere(marked)),
                mean_percent=float(np.nanmean(change[marked])) if marked.any() else None,
            )
        )
    return tuple(sorted(found, key=lambda spot: -spot.probability))
