"""Grasps of recorded fruit by a recorded sheet, through the real firmware: little of it is ours."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from palpate.commands.options import JsonOption
from palpate.estimate.damage_learning import FruitClosing, learn_damage, read_closings
from palpate_studies.hybrid_data import read_curves, read_sheets
from palpate_studies.hybrid_grasps import (
    FRICTION,
    MASS_G,
    Hybrid,
    calibrated,
    fixed_closing,
    grasped,
)
from palpate_studies.hybrid_world import Curve, RecordedSheet
from palpate_studies.report import OutOption, StudyReport, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SEED = 41
#: Grasps by one sensor before the next one is drawn and calibrated.
_PER_SENSOR = 8
OURS, TOLD, UNGUARDED = "ours", "ours, kind told", "ours, without the learned limit"


def command(
    curves: Annotated[Path, typer.Option(help="Closings of real fruit.", metavar="CSV")],
    index: Annotated[Path, typer.Option(help="Their labels.", metavar="CSV")],
    ladders: Annotated[
        Path, typer.Option(help="Ladders of weights on real sheets.", metavar="CSV")
    ],
    holds: Annotated[
        list[Path], typer.Option(help="Real holds in ohm; may be repeated.", metavar="FILE")
    ],
    grasps: Annotated[int, typer.Option(help="Grasps through the firmware.", min=1)] = 160,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Grasp recorded fruit by recorded sheets through the firmware on the simulator.

    Example: palpate study hybrid --curves fruit.csv --index index.csv --ladders ladders.csv
    --holds holds.csv
    """
    report(
        read_curves(curves, index),
        read_closings(curves, index),
        read_sheets(ladders, holds),
        grasps=grasps,
    ).emit(as_json=as_json, out=out)


def report(
    curves: Sequence[Curve],
    closings: Sequence[FruitClosing],
    sheets: Sequence[RecordedSheet],
    *,
    grasps: int,
    firmware: bool = True,
) -> StudyReport:
    """Make the grasps and report how they went."""
    found = list(_grasps(curves, closings, sheets, grasps=grasps, firmware=firmware))
    summary = [
        {"way": way, "fruit": fruit, **scores(rows)}
        for way in dict.fromkeys(one.way for one in found)
        for fruit in ("all", *dict.fromkeys(one.fruit for one in found))
        if (rows := [o for o in found if o.way == way and fruit in ("all", o.fruit)])
    ]
    through = "the firmware on the AVR simulator" if firmware else "no firmware"
    return StudyReport(
        name="hybrid",
        title="Recorded fruit, recorded sheets, real firmware (simulated)",
        provenance=[
            "Real: each fruit's force over closing until rupture, each sheet's resistance over "
            "load and its scatter, how a hold relaxes. Every placement relaxes like another hold, "
            "whatever specimen it was of.",
            f"`{OURS}` reads the sheet through {through}; the other ways read the same sheets "
            "directly. The learned limit comes from the other half of the fruit; "
            f"`{TOLD}` alone knows banana from kiwi and mango.",
            "Ours in it: the fingers' width, how a force is shared among pixels, that answers of "
            f"the sheet add up, masses {MASS_G} g and a friction of {FRICTION}. What the "
            "recordings lack, and so is kinder than life: relaxation of the fruit, spikes of the "
            "movement, the first moments of most holds.",
        ],
        tables=[_table(summary)],
        payload={
            "study": "hybrid",
            "origin": "firmware-simulated" if firmware else "recordings",
            "summary": summary,
            "rows": [_row(one) for one in found],
        },
        figures={"hybrid": lambda: _figure(found)},
    )


def _grasps(
    curves: Sequence[Curve],
    closings: Sequence[FruitClosing],
    sheets: Sequence[RecordedSheet],
    *,
    grasps: int,
    firmware: bool,
) -> Iterator[Hybrid]:
    rng = np.random.default_rng(SEED)
    halves = [{c.name for c in curves[k::2]} for k in (0, 1)]
    models = [learn_damage([c for c in closings if c.grasp_id not in half]) for half in halves]
    drawn = [curves[k] for k in rng.permutation(len(curves))]
    for number in range(grasps):
        if number % _PER_SENSOR == 0:
            sheet = sheets[int(rng.integers(len(sheets)))]
            calibration = calibrated(sheet, seed=SEED + number)
        curve = drawn[number % len(drawn)]
        guard = models[0] if curve.name in halves[0] else models[1]
        seed = 1000 * SEED + number
        yield grasped(
            curve, sheet, calibration, damage=guard, way=OURS, firmware=firmware, seed=seed
        )
        yield grasped(
            curve,
            sheet,
            calibration,
            damage=guard,
            way=TOLD,
            firmware=False,
            kind=curve.fruit,
            seed=seed,
        )
        yield grasped(
            curve, sheet, calibration, damage=None, way=UNGUARDED, firmware=False, seed=seed
        )
        yield fixed_closing(curve, contact_n=_contact_n(sheet))


def _contact_n(sheet: RecordedSheet) -> float:
    """Return the grip force, spread over four pixels, at which the mean falls by 10 %."""
    return 4.0 * float(np.interp(-np.log(0.9), sheet.log_fall, sheet.load_n))


def scores(found: Sequence[Hybrid]) -> dict[str, Any]:
    """Return how a set of grasps went."""
    answered = [(one, one.said) for one in found if one.said is not None and one.outcome == "held"]
    inside = [said.low <= one.force_n <= said.high for one, said in answered]
    error = [abs(np.log(max(said.middle, 1e-3) / one.force_n)) for one, said in answered]
    liftable = [one for one in found if one.rupture_n > one.lift_n]
    decided = [one.decision_s for one in found if one.decision_s is not None]
    return {
        "grasps": len(found),
        "held": sum(one.outcome == "held" for one in found),
        "damaged": sum(one.damaged for one in found),
        "dropped": sum(one.dropped for one in liftable),
        "coverage": float(np.mean(inside)) if inside else None,
        "median_abs_log_error": float(np.median(error)) if error else None,
        "median_force_over_rupture": float(np.median([o.peak_n / o.rupture_n for o in found])),
        "median_decision_s": float(np.median(decided)) if decided else None,
    }


def _row(one: Hybrid) -> dict[str, Any]:
    said = None if one.said is None else one.said.to_dict()
    plain = {name: getattr(one, name) for name in Hybrid.__slots__ if name != "said"}
    return {**plain, "said": said, "damaged": one.damaged, "dropped": one.dropped}


def _table(summary: Sequence[dict[str, Any]]) -> Table:
    counts = ("grasps", "held", "damaged", "dropped")
    numbers = {
        "coverage": "force inside (0.9)",
        "median_abs_log_error": "median |ln force error|",
        "median_force_over_rupture": "force / rupture force",
        "median_decision_s": "decision, s",
    }
    return Table(
        title="Grasps of recorded fruit",
        columns=("way", "fruit", *counts, *numbers.values()),
        rows=[
            [row["way"], row["fruit"], *(str(row[name]) for name in counts)]
            + ["" if row[name] is None else f"{row[name]:.2f}" for name in numbers]
            for row in summary
        ],
    )


def _figure(found: Sequence[Hybrid]) -> Figure:
    from palpate_studies.plots.hybrid import hybrid_figure

    return hybrid_figure([one for one in found if one.way == OURS])
