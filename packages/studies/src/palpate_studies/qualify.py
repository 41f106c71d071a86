"""Ceiling of a real penetrometer, and coverage of `palpate qualify` with simulated ones."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from palpate.arrays import FloatArray
from palpate.grasp.planning import plan_grasp
from palpate.grasp.runner import run_grasp
from palpate.holds.strict import read_table
from palpate.measurement import Measurement
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import draw_object
from palpate.twin.rig import calibrate_twin
from palpate.twin.world import World
from palpate_station.qualify.agreement import (
    FIGURES,
    Demand,
    Estimate,
    calculate_agreement,
    measure_agreement,
)
from palpate_station.qualify.readings import PairedReadings
from palpate_station.qualify.scatter import Scatter
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import LEVELS

#: Twin fruit in the pool, grasps of each fruit, and seed of the sensor.
ITEMS, GRASPS, SENSOR = 160, 2, 46
KINDS = ("avocado-day-1", "avocado-day-2", "avocado-day-3", "avocado-day-4")
#: Scatter of the simulated penetrometer between sides, ln N/mm: small, as on the real apples
#: relative to their spread between items, and large.
SIDE_SCATTERS = (0.1, 0.3, 1.0)
#: Campaigns per condition, and items per campaign.
CAMPAIGNS, CAMPAIGN_ITEMS = 60, 60
#: Tolerance in ln N/mm, and in pound-force on the apples.
TOLERANCE, APPLE_TOLERANCE_LBF = 0.3, 1.0
#: Figures with a known true value.
CHECKED = ("r_squared", "r_squared_ceiling", "share_within", "share_within_ceiling")


@dataclass(frozen=True, slots=True, kw_only=True)
class Pool:
    """Grasped fruit of the twin: ln of the true stiffness and of each measurement."""

    truth: FloatArray
    grasps: FloatArray


def report(
    *,
    apples: Annotated[
        Path | None,
        typer.Option(help="Real apples: columns side1_lbf and side2_lbf.", metavar="CSV"),
    ] = None,
    items: int = ITEMS,
    campaigns: int = CAMPAIGNS,
) -> StudyReport:
    """Qualify a real penetrometer against itself, and twin grasps against simulated ones.

    Example: palpate study qualify --apples apples_firmness.csv.gz
    """
    tables: list[Table] = []
    payload: dict[str, Any] = {"summary": []}
    if apples is not None:
        found = measure_agreement(read_side_pairs(apples), Demand(tolerance=APPLE_TOLERANCE_LBF))
        payload["apples"] = {
            name: {
                end: value if math.isfinite(value := getattr(figure, end)) else None
                for end in ("value", "low", "high")
            }
            for name, figure in found.figures.items()
        }
        tables.append(
            Table.of(
                "One penetrometer against itself on the other side, 720 apples, 1 lbf (real)",
                [{"figure": FIGURES[name], **ends} for name, ends in payload["apples"].items()],
            )
        )
    for level in LEVELS:
        pool = grasp_pool(items, level=level)
        for side_sd in SIDE_SCATTERS:
            payload["summary"] += check_coverage(pool, side_sd, level=level, campaigns=campaigns)
    tables.append(
        Table.of("Grasps against simulated penetrometers (simulated)", payload["summary"])
    )
    return StudyReport(
        name="qualify",
        title="Agreement with a reference, and the ceiling that the reference sets",
        provenance=[
            "Apples: real, one penetrometer against itself on the other side of 720 apples.",
            f"Twin: simulated; {items} avocados of four days, {GRASPS} grasps each, one sensor per "
            f"level; {campaigns} campaigns of {CAMPAIGN_ITEMS} items drawn from this pool, each "
            "with new scatter of a simulated penetrometer. The true figures are computed from "
            "20 000 readings of the pool.",
        ],
        tables=tables,
        payload=payload,
    )


command = as_command(report)


def read_side_pairs(path: Path) -> PairedReadings:
    """Read apples: the first side as the grasp, both sides as the reference."""
    columns = read_table(
        path, columns={"side1_lbf": "number or empty", "side2_lbf": "number or empty"}
    )
    first, second = columns["side1_lbf"], columns["side2_lbf"]
    number = np.arange(first.size)
    return PairedReadings(
        item=np.concatenate((number, number)),
        reference=np.concatenate((second, first)),
        grasp=np.concatenate((first, np.full(first.size, np.nan))),
    )


def grasp_pool(items: int, *, level: str) -> Pool:
    """Grasp each twin fruit twice; skip fruit without a stiffness in every grasp."""
    calibration = calibrate_twin(seed=SENSOR, level=level, apart_from="")
    truth, measured = [], []
    for number in range(items):
        random = np.random.default_rng([SENSOR, number])
        fruit = draw_object(random, KINDS[number % len(KINDS)])
        found = []
        for grasp in range(GRASPS):
            world = World(fruit, seed=1000 * number + grasp, sheet_seed=SENSOR, level=level)
            gripper = TwinGripper(world)
            result = run_grasp(
                plan_grasp(calibration, gripper=gripper),
                array=TwinArray(world),
                gripper=gripper,
                clock=world.clock,
            )
            found.append(_log_of(result.stiffness_n_per_mm))
        if all(math.isfinite(value) for value in found):
            truth.append(math.log(fruit.force_at_1mm_n))
            measured.append(found)
    return Pool(truth=np.array(truth), grasps=np.array(measured))


def _log_of(measured: Measurement | None) -> float:
    if measured is None or not measured.low > 0:
        return math.nan
    return 0.5 * (math.log(measured.low) + math.log(measured.high))


def check_coverage(
    pool: Pool, side_sd: float, *, level: str, campaigns: int
) -> list[dict[str, Any]]:
    """Return the coverage of each figure's intervals over many campaigns."""
    demand = Demand(tolerance=TOLERANCE)
    random = np.random.default_rng([SENSOR, round(1000 * side_sd)])
    every = np.tile(np.arange(pool.truth.size), math.ceil(20_000 / pool.truth.size))
    large = _draw_campaign(pool, every, side_sd, random)
    true = _true_figures(large, pool, side_sd, demand)
    rows: dict[str, list[Estimate]] = {name: [] for name in CHECKED}
    for _ in range(campaigns):
        chosen = random.integers(pool.truth.size, size=CAMPAIGN_ITEMS)
        found = measure_agreement(_draw_campaign(pool, chosen, side_sd, random), demand)
        for name in CHECKED:
            rows[name].append(found.figures[name])
    return [
        {
            "level": level,
            "side_sd": side_sd,
            "figure": name,
            "true": true[name],
            "median": float(np.median([figure.value for figure in found_figures])),
            "coverage": float(
                np.mean([figure.low <= true[name] <= figure.high for figure in found_figures])
            ),
            "median_half_width": float(
                np.median([(figure.high - figure.low) / 2.0 for figure in found_figures])
            ),
            "campaigns": campaigns,
        }
        for name, found_figures in rows.items()
    ]


def _draw_campaign(
    pool: Pool,
    chosen: np.ndarray[Any, np.dtype[np.intp]],
    side_sd: float,
    random: np.random.Generator,
) -> PairedReadings:
    """Draw readings of two sides of each chosen item with both instruments."""
    sides = random.normal(0.0, side_sd, (chosen.size, GRASPS))
    return PairedReadings(
        item=np.repeat(np.arange(chosen.size), GRASPS),
        reference=(pool.truth[chosen, None] + sides).ravel(),
        grasp=pool.grasps[chosen].ravel(),
    )


def _true_figures(
    large: PairedReadings, pool: Pool, side_sd: float, demand: Demand
) -> dict[str, float]:
    """Return the figures of a very large sample; the ceiling from the known scatter."""
    exact = Scatter(between=float(pool.truth.std()), within=side_sd)
    figures = calculate_agreement(large, demand).figures
    return {name: figure.value for name, figure in figures.items()} | {
        "r_squared_ceiling": exact.repeatability,
        "share_within_ceiling": exact.fraction_within(demand.tolerance),
    }
