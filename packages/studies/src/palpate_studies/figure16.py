"""Figure 16 of the paper: an avocado over four days, with rigid and soft fingers."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from palpate.arrays import FloatArray
from palpate.gripper.interface import GripperCommand
from palpate.twin.devices import TwinGripper
from palpate.twin.objects import TwinObject
from palpate.twin.world import OPEN_MM, SOFT_MM_PER_KPA, SOFT_MM_PER_N, GripperKind, World
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import LEVELS
from palpate_studies.twin_avocado import Avocado, draw_avocado
from palpate_studies.twin_session import HOLD_S, PAUSE_S, STILL_S

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Days, and grasps of a fruit on each day, as in the paper.
DAYS, GRASPS = 4, 10
#: Seeds of fruits and sensor, not used before. Fruits that are not hard on the first day or not
#: ripe on the last are skipped.
FIRST_FRUIT, SENSOR = 16_000, 16
#: Rigid fingers, and soft fingers with a mechanical stop, close this far beyond the size measured
#: with a caliper. Other soft fingers use one pressure for all fruits, as in the study `ripeness`.
CLOSURE_MM, PRESSURE_KPA = 3.0, 28.0
#: Compliance of soft fingers at their stop: a tenth of their own.
STOPPED_MM_PER_N = SOFT_MM_PER_N / 10.0
_RATE: dict[GripperKind, float] = {"rigid": 40.0, "soft": 15.0}


@dataclass(frozen=True, slots=True, kw_only=True)
class Hand:
    """Fingers of one kind.

    Attributes
    ----------
    name : str
        Name in tables.
    gripper : {"rigid", "soft"}
        Kind of fingers.
    soft_mm_per_n : float
        Compliance of soft fingers.
    stopped : bool
        Whether the fingers end `CLOSURE_MM` beyond the size of each fruit, not at one pressure.
    """

    name: str
    gripper: GripperKind = "soft"
    soft_mm_per_n: float = SOFT_MM_PER_N
    stopped: bool = False

    def target(self, fruit: Avocado) -> float:
        """Return the width or pressure of the paper's method, the same on all days."""
        if self.gripper == "rigid":
            return fruit.size_mm - CLOSURE_MM
        if not self.stopped:
            return PRESSURE_KPA
        return (OPEN_MM - fruit.size_mm + CLOSURE_MM) / SOFT_MM_PER_KPA


HANDS = (
    Hand(name="rigid, one width", gripper="rigid", stopped=True),
    Hand(name="soft, one pressure"),
    Hand(name="soft, stopped by geometry", soft_mm_per_n=STOPPED_MM_PER_N, stopped=True),
)


def report(
    fruits: Annotated[int, typer.Option(help="Fruits that ripen in four days.", min=1)] = 10,
    *,
    grasps: int = GRASPS,
) -> StudyReport:
    """Grasp avocados on four days with one rigid and two soft grippers.

    Example: palpate study figure16 --out reports
    """
    chosen = draw_ripening_fruits(fruits)
    rows = list[dict[str, Any]]()
    for level in LEVELS:
        for hand in HANDS:
            settled = np.array(
                [measure_days(fruit, hand, level=level, grasps=grasps) for fruit in chosen]
            )
            rows.append({"level": level, "hand": hand.name, **scores(settled)})
    return StudyReport(
        name="figure16",
        title="Figure 16: settled change of avocados over four days",
        provenance=[
            f"Simulated: {fruits} avocados that are hard on the first day and ripe on the fourth, "
            f"{grasps} grasps a day on one sensor per level, held for {HOLD_S:g} s; mean of all "
            "pixels, without noise.",
            f"One width, or stopped by geometry: {CLOSURE_MM:g} mm below the caliper size. One "
            f"pressure: {PRESSURE_KPA:g} kPa. Compliance when stopped by geometry: "
            f"{STOPPED_MM_PER_N:g} instead of {SOFT_MM_PER_N:g} mm/N.",
            "Published: one avocado in Figure 16b (rigid) and 16c (soft), with a falling change in "
            "both; no numbers are printed.",
        ],
        tables=[
            Table.of(
                "Mean settled change, percent, and number of fruits with a falling change",
                [
                    {**row, **{f"day {k + 1}": at for k, at in enumerate(row["mean_percent"])}}
                    for row in rows
                ],
            )
        ],
        payload={"origin": "twin", "fruits": fruits, "summary": rows},
        figures={"figure16": lambda: draw(rows)},
    )


command = as_command(report)


def draw_ripening_fruits(count: int) -> list[Avocado]:
    """Draw fruits that are hard on the first day and ripe on the last."""
    fruits = (draw_avocado(np.random.default_rng(seed)) for seed in itertools.count(FIRST_FRUIT))
    ripening = (
        fruit
        for fruit in fruits
        if fruit.stage(0.0) == "hard" and fruit.stage(DAYS - 1.0) in ("ripe", "overripe")
    )
    return list(itertools.islice(ripening, count))


def measure_days(fruit: Avocado, hand: Hand, *, level: str, grasps: int) -> FloatArray:
    """Grasp a fruit on each day; return the settled changes, percent, shape (days, grasps)."""
    world = World(
        None,
        seed=SENSOR + 1_000_003,
        sheet_seed=SENSOR,
        level=level,
        gripper=hand.gripper,
        soft_mm_per_n=hand.soft_mm_per_n,
    )
    rng, gripper = np.random.default_rng([SENSOR, 7]), TwinGripper(world)
    return np.array(
        [
            [
                _measure_settled_percent(
                    world, gripper, spot=fruit.spot(day, rng=rng), fruit=fruit, hand=hand
                )
                for _ in range(grasps)
            ]
            for day in range(DAYS)
        ]
    )


def _measure_settled_percent(
    world: World, gripper: TwinGripper, *, spot: TwinObject, fruit: Avocado, hand: Hand
) -> float:
    """Grasp one spot; return the mean change at the end of the hold."""
    gripper.release()
    world.clock.sleep_s(STILL_S)
    world.place(spot, fixture=True)
    gripper.command(GripperCommand(target=hand.target(fruit), rate=_RATE[hand.gripper]))
    world.clock.sleep_s(HOLD_S)
    world.force_n(world.clock.now_s())
    percent = world.truth(HOLD_S).settled_percent
    gripper.release()
    world.clock.sleep_s(PAUSE_S)
    return percent


def scores(settled: FloatArray) -> dict[str, Any]:
    """Summarise changes of shape (fruits, days, grasps).

    `falls_every_day` counts fruits whose mean change falls from day to day; `falls_clearly` counts
    fruits that differ between first and last day by more than two standard deviations of a grasp.
    """
    mean, sd = settled.mean(axis=2), settled.std(axis=2, ddof=1)
    steps = np.diff(mean, axis=1)
    clear = mean[:, -1] - mean[:, 0] > 2.0 * np.hypot(sd[:, 0], sd[:, -1])
    return {
        "mean_percent": mean.mean(axis=0).tolist(),
        "sd_of_grasps": np.median(sd, axis=0).tolist(),
        "fruits": len(mean),
        "falls_every_day": int(np.sum(np.all(steps > 0, axis=1))),
        "falls_clearly": int(np.sum(clear)),
    }


def draw(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw mean and sd of the settled change over days at `lab`, for each hand."""
    from palpate.plots.style import BLUE, GREEN, ORANGE, new_figure

    shown = [row for row in rows if row["level"] == "lab"]
    with new_figure(columns=3, width_in=9.6, height_in=2.8, shared=True) as (figure, axes):
        for axis, row, colour in zip(axes[0], shown, (BLUE, ORANGE, GREEN), strict=True):
            at = np.arange(1, DAYS + 1)
            axis.errorbar(
                at, row["mean_percent"], yerr=row["sd_of_grasps"], fmt="o-", color=colour, capsize=3
            )
            axis.set(xlabel="day", xticks=at, title=row["hand"])
        axes[0][0].set_ylabel("settled change, simulated (%)")
    return figure
