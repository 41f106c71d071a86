"""How well a bruise could be detected from loads that are read without any error, or nearly so.

The apples are those of the study `bruise`, laid as there; but the loads of their pixels come
straight from the mechanics of the twin, without a sheet: no force law, creep, noise or frames. To
them comes a scatter of each pixel's gain from grasp to grasp, or none. What is then judged is
judged as ever, by our judge and by boosted trees, learned from as many apples as in the study or
from many more: a bound for any judge of these numbers, and the share that the sheet has in it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import typer

from palpate.arrays import FloatArray
from palpate.commands.options import JsonOption
from palpate.produce.bruise.learning import learn_bruises
from palpate.produce.bruise.model import Example, usable_references
from palpate.produce.bruise.shape import LoadShape, contrast, middle_of, shape_of
from palpate.twin.mechanics import HandCompliance, series_force_n
from palpate.twin.objects import TwinObject
from palpate.twin.placement import PixelGrid
from palpate.twin.ranges import LAB, uniform
from palpate.twin.world import World
from palpate_studies.baselines.bruise_trees import tree_scores
from palpate_studies.bruise_data import PLACED_WITHIN_MM
from palpate_studies.bruise_grasps import CLOSURE_MM
from palpate_studies.bruise_scores import EARLIER, FIRST_MET, area
from palpate_studies.fruit_ranges import BRUISES
from palpate_studies.report import OutOption, StudyReport, Table
from palpate_studies.twin_apple import Apple, draw_apple

#: Force at which both fingers feel the paper's 10 % and close on, newtons.
_CONTACT_N = 0.6
#: Scatter (log sd) of the gain of a pixel, and of the width at contact, mm: none, and the sheet's
#: own at the level `lab` with what a search in frames leaves of the width.
_READINGS = {"without error": (0.0, 0.0), "gains as the sheet's": (LAB.place_pixel_log_sd, 0.05)}
#: Apples that the study learns from, seed, and apples on one gripper.
_AS_STUDY, SEED, PER_SENSOR = 984, 7, 24


@dataclass(frozen=True, slots=True, kw_only=True)
class Side:
    """One side as its pixels carry it, shape (rows, cols), newtons, and its width at contact."""

    load_n: FloatArray
    width_mm: float

    def read(self, *, pixel_sd: float, width_sd_mm: float, rng: np.random.Generator) -> LoadShape:
        """Return what is judged of it, read with some scatter."""
        excess = self.load_n * np.exp(pixel_sd * rng.standard_normal(self.load_n.shape))
        return shape_of(
            -100.0 * excess / (1.0 + excess),
            width_mm=self.width_mm + width_sd_mm * float(rng.standard_normal()),
        )


def command(
    apples: Annotated[
        int, typer.Option(help="Apples tested; as many others are learned from.", min=240)
    ] = 4800,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Show what limits distinguishing bruised apples from sound ones. A minute.

    Example: palpate study bruise-limits
    """
    report(apples).emit(as_json=as_json, out=out)


def report(apples: int) -> StudyReport:
    """Judge drawn sides in every way and put the areas into a table."""
    learned, tested = (drawn(apples, seed=SEED + purpose) for purpose in (0, 1))
    rows, payload = [], []
    for name, (pixel_sd, width_sd_mm) in _READINGS.items():
        rng = np.random.default_rng(SEED)
        both = [_examples(s, pixel_sd, width_sd_mm, rng) for s in (learned, tested)]
        for count in sorted({min(_AS_STUDY, apples), apples}):
            for judge, areas in areas_of(both[0][:count], both[1]).items():
                rows.append([name, str(count), judge, *(f"{one:.3f}" for one in areas.values())])
                payload.append({"reading": name, "learned": count, "judge": judge, **areas})
    return StudyReport(
        name="bruise-limits",
        title="What limits detecting a bruise from one grasp (simulated)",
        provenance=[
            f"Simulated, level lab: {apples} apples tested and as many others to learn from, "
            "drawn and laid as in the study `bruise`, seeds of their own. Loads come straight from "
            "the twin's mechanics, without sheet or frames; the class is known without error.",
            f"Scatter of the sheet's gains: {100 * LAB.place_pixel_log_sd:.0f} % of a pixel from "
            "grasp to grasp. Sheets also creep, saturate and differ in law: this is a bound.",
        ],
        tables=[
            Table(
                title="Area under the ROC curve, one grasp of each side",
                columns=("reading", "learned", "judge", "first met", "with its earlier record"),
                rows=rows,
            )
        ],
        payload={"study": "bruise-limits", "origin": "twin", "rows": payload},
        figures={},
    )


def drawn(apples: int, *, seed: int) -> list[dict[str, Side | bool]]:
    """Draw apples, every second one bruised: the side now, before, and a quarter turn on."""
    rng, found = np.random.default_rng([seed, 41]), []
    grid = PixelGrid.of(World(None, seed=1).layout)
    for number in range(apples):
        if number % PER_SENSOR == 0:
            hand = HandCompliance(
                finger_mm_per_n=uniform(rng, LAB.finger_mm_per_n),
                pad_travel_mm=uniform(rng, LAB.pad_travel_mm),
                pad_force_n=uniform(rng, LAB.pad_force_n),
            )
        bruised = number % 2 == 1
        placed = replace(BRUISES, height_mm=(-PLACED_WITHIN_MM, PLACED_WITHIN_MM))
        apple = draw_apple(rng, bruises=placed if bruised else None)
        angle_deg = _presented(apple, rng)
        before = replace(apple, bruise=None)
        turned = {"now": (apple, 0.0), "history": (before, 0.0), "item": (apple, 90.0)}
        sides: dict[str, Side | bool] = {
            name: _side(one.facing(angle_deg + turn), hand, grid, rng)
            for name, (one, turn) in turned.items()
        }
        found.append({"bruised": bruised, **sides})
    return found


def _presented(apple: Apple, rng: np.random.Generator) -> float:
    """Return the angle at which a side is presented, its bruise near the middle of a finger."""
    angle_deg = rng.uniform(0.0, 360.0)
    if apple.bruise is None:
        return float(angle_deg)
    beside_mm = rng.uniform(-PLACED_WITHIN_MM, PLACED_WITHIN_MM)
    turned = math.degrees(beside_mm / apple.radius_mm) + 180.0 * rng.integers(2)
    return float(apple.bruise.angle_deg + turned)


def _side(obj: TwinObject, hand: HandCompliance, grid: PixelGrid, rng: np.random.Generator) -> Side:
    """Close on a side by the study's way from where it is felt."""
    assert obj.faces is not None
    felt_mm = (_CONTACT_N / obj.force_at_1mm_n) ** (2.0 / 3.0) + hand.deflection_mm(_CONTACT_N)
    force_n = series_force_n(obj, felt_mm + CLOSURE_MM, compliance=hand)
    off_mm = LAB.off_centre * grid.pitch_mm * rng.uniform(-1.0, 1.0, 2)
    shares = obj.faces.pixel_shares(
        (force_n / obj.force_at_1mm_n) ** (2.0 / 3.0),
        grid=grid,
        off_centre_mm=(float(off_mm[0]), float(off_mm[1])),
    )
    rows = np.unique(np.column_stack([grid.finger, grid.along_mm]), axis=0).shape[0]
    return Side(load_n=force_n * shares.reshape(rows, -1), width_mm=obj.size_mm - felt_mm)


def _examples(
    sides: Sequence[Mapping[str, Side | bool]],
    pixel_sd: float,
    width_sd_mm: float,
    rng: np.random.Generator,
) -> list[Example]:
    """Read all sides with some scatter."""
    read = [
        {
            name: side.read(pixel_sd=pixel_sd, width_sd_mm=width_sd_mm, rng=rng)
            for name, side in one.items()
            if isinstance(side, Side)
        }
        for one in sides
    ]
    sound = [r["now"] for r, one in zip(read, sides, strict=True) if not one["bruised"]]
    kind = middle_of(sound, with_width=False)
    return [
        Example(
            shape=r["now"],
            against={"history": r["history"], "class": kind, "item": r["item"]},
            bruised=bool(one["bruised"]),
        )
        for r, one in zip(read, sides, strict=True)
    ]


def areas_of(learned: Sequence[Example], tested: Sequence[Example]) -> dict[str, dict[str, float]]:
    """Return the area under the ROC curve of each judge, first met and with an earlier record."""
    ours = learn_bruises(learned, learned_on="loads straight from the mechanics")
    truth = np.array([one.bruised for one in tested])
    found: dict[str, dict[str, float]] = {"ours": {}, "boosted trees": {}}
    for label, names in (("first_met", FIRST_MET), ("with_earlier_record", EARLIER)):
        values = [_values(each, names) for each in (learned, tested)]
        trees = tree_scores(values[0], [one.bruised for one in learned], tested=values[1])
        found["ours"][label] = area(truth, ours.judges[names].log_odds(values[1]))
        found["boosted trees"][label] = area(truth, trees)
    return found


def _values(examples: Sequence[Example], names: str) -> FloatArray:
    """Return the numbers that are judged against some references, shape (sides, numbers)."""
    chosen = [name for name in usable_references(examples[0].against) if name in names.split("+")]
    return np.array(
        [
            np.concatenate([contrast(one.shape, one.against[name]) for name in chosen])
            for one in examples
        ]
    )
