"""Times, forces, damage and accuracy of a grasp from the open gripper to the answer.

Each object is grasped with palpate, with the paper's steps, and with the servo current alone.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby, product
from typing import Annotated, Any

import numpy as np
import typer

from palpate.force.servo_force import CurrentLaw
from palpate.grasp.paper import Paper
from palpate.grasp.paper_method import use_paper_method
from palpate.grasp.planning import plan_grasp
from palpate.grasp.runner import run_grasp
from palpate.grasp.state import GraspState
from palpate.gripper.interface import GripperCommand
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import TwinObject
from palpate.twin.world import GripperKind, World
from palpate_studies.baselines.feedback_loops import STEP, close_until, make_touch_check, read_ohm
from palpate_studies.force_control_world import (
    GRASPS_PER_SHEET,
    SIZES_MM,
    calibration_of,
    draw_random_object,
)
from palpate_studies.processes import map_batches
from palpate_studies.protocol.paired import compare
from palpate_studies.report import SecondOption, StudyReport, Table, as_command
from palpate_studies.rows import LEVELS, group, mean, median
from palpate_studies.second.objects import other_object
from palpate_studies.stoppable import require_uninterrupted

#: The paper's time from contact to the prediction.
_PAPER_PREDICTS_S = 2.5
#: The paper's method with the threshold on the mean of all pixels, or on the mean of each finger.
MEAN_OF_PIXELS, BOTH_FINGERS = "paper's 1 mm steps", "paper's 1 mm steps, both fingers"
#: Closing until a servo current: speed, interval of the readings, and force at the stop.
_CURRENT_MM_PER_S, _CURRENT_EVERY_S, _CURRENT_N = 10.0, 0.02, 2.0
#: Averaged current readings of the empty hand, and during the closing.
_EMPTY_READINGS, _READINGS = 20, 3
KINDS: tuple[GripperKind, ...] = ("rigid", "soft")
#: Seeds of the first object of each generator; none of the objects was used in development.
FIRST_SEED, SECOND_SEED = 5_900_000, 7_300_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Sample:
    """One object in one world."""

    seed: int
    level: str
    kind: GripperKind
    #: Whether the object comes from the second generator.
    second: bool = False

    @property
    def sheet(self) -> int:
        """Seed of the sensor and gripper."""
        return self.seed // GRASPS_PER_SHEET

    def obj(self) -> TwinObject:
        """Draw the object, of any stiffness, shape and strength."""
        rng = np.random.default_rng([self.seed, 41])
        drawn = draw_random_object(rng, size_mm=SIZES_MM[self.kind])
        return other_object(drawn, number=self.seed) if self.second else drawn

    def world(self) -> World:
        """Return the world of one grasp of the object."""
        return World(
            self.obj(),
            seed=self.seed,
            sheet_seed=self.sheet,
            level=self.level,
            gripper=self.kind,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Cycle:
    """Results of one method on one object; NaN for quantities that it does not measure.

    Attributes
    ----------
    method, outcome : str
        Method and outcome of the grasp.
    touch_s, answer_s : float
        Time from the open hand to contact, and to the answer.
    touch_peak_n, peak_n : float
        True maximum force until contact was confirmed, and of the whole grasp.
    damaged : bool
        Whether the object was pressed beyond its yield.
    size_error_mm, force_error, settled_error : float
        Estimated minus true size; relative errors of the settled force and settled mean change.
    stiffness, stiffness_low, stiffness_high, true_stiffness : float
        Secant stiffness at the settled force, N/mm; infinite or NaN limits are open.
    stiffness_status : str
        Status of the measurement, or ``"none"``.
    """

    sample: Sample
    method: str
    outcome: str
    touch_s: float
    answer_s: float
    touch_peak_n: float
    peak_n: float
    damaged: bool
    size_error_mm: float = np.nan
    force_error: float = np.nan
    settled_error: float = np.nan
    stiffness: float = np.nan
    stiffness_low: float = np.nan
    stiffness_high: float = np.nan
    true_stiffness: float = np.nan
    stiffness_status: str = "none"


def grasp_with_controller(sample: Sample, *, paper: Paper | None = None) -> Cycle:
    """Grasp gently with the shipped controller, with its own method or the paper's."""
    world, at = sample.world(), dict[str, float]()
    gripper, size_mm = TwinGripper(world), sample.obj().size_mm
    calibration = calibration_of(sample.sheet, sample.level, sample.kind)
    plan = plan_grasp(calibration, gripper=gripper, hold_s=0.0)
    if paper is not None:
        plan = use_paper_method(plan, paper, calibration=calibration)

    def watch(grasp_state: GraspState) -> None:
        for moment in grasp_state.result.moments:
            if moment.finger is None and moment.name not in at:
                at[moment.name] = grasp_state.estimate.now_s
                at[f"{moment.name} peak"] = world.truth().peak_force_n

    array = TwinArray(world)
    result = require_uninterrupted(
        run_grasp(plan, array=array, gripper=gripper, clock=world.clock, watchers=[watch])
    )
    force, size, stiffness = result.force_n, result.size_mm, result.stiffness_n_per_mm
    settled, truth = result.settled_percent, world.truth()
    low, high = (None, None) if stiffness is None else stiffness.known_ends
    return Cycle(
        sample=sample,
        method="ours" if paper is None else MEAN_OF_PIXELS,
        outcome=str(result.outcome),
        touch_s=at.get("contact", np.nan),
        answer_s=at.get("answer", np.nan),
        touch_peak_n=at.get("contact peak", np.nan),
        peak_n=truth.peak_force_n,
        damaged=truth.peak_force_n >= sample.obj().yield_n,
        size_error_mm=np.nan if size is None else size.middle - size_mm,
        force_error=force.middle / truth.force_n - 1.0 if force and truth.force_n > 0 else np.nan,
        settled_error=settled.middle / truth.settled_percent - 1.0
        if settled and truth.force_n > 0
        else np.nan,
        stiffness=stiffness.middle if stiffness is not None and stiffness.has_value else np.nan,
        stiffness_low=np.nan if low is None else low,
        stiffness_high=np.nan if high is None else high,
        true_stiffness=truth.stiffness_n_per_mm or np.nan,
        stiffness_status="none" if stiffness is None else str(stiffness.status),
    )


def grasp_until_both_fingers(sample: Sample) -> Cycle:
    """Close in the paper's steps until the mean of each finger passes the threshold."""
    world = sample.world()
    array, gripper = TwinArray(world), TwinGripper(world)
    rest_ohm = read_ohm(array, seconds=0.5)
    touched = make_touch_check(array, world, rest_ohm, both_fingers=True)
    step = STEP[sample.kind]
    closed = close_until(world, gripper, touched, step=step, kind=sample.kind)
    size_mm = np.nan
    if sample.kind == "rigid":
        calibration = calibration_of(sample.sheet, sample.level, sample.kind)
        compliance = plan_grasp(calibration, gripper=gripper).compliance
        assert compliance is not None
        size_mm = gripper.limits.target(closed - step) - compliance.zero_mm
    return _finish_grasp(sample, world, method=BOTH_FINGERS, size_mm=size_mm)


def grasp_until_current(sample: Sample) -> Cycle:
    """Close at speed until the servo current corresponds to 2 N; rigid fingers only.

    The calibration contains the friction of the gears, as for palpate.
    """
    world = sample.world()
    gripper = TwinGripper(world)
    plan = plan_grasp(calibration_of(sample.sheet, sample.level, sample.kind), gripper=gripper)
    assert plan.current is not None
    assert plan.compliance is not None
    world.clock.sleep_s(0.5)
    gripper.command(GripperCommand(target=gripper.limits.lowest, rate=_CURRENT_MM_PER_S))
    # After the acceleration, the current of the empty hand is the friction of the gears.
    world.clock.sleep_s(0.3)
    empty_ma = _pull_ma(gripper, world, current=plan.current, count=_EMPTY_READINGS)
    while gripper.state().moving:
        pull_ma = _pull_ma(gripper, world, current=plan.current, count=_READINGS) - empty_ma
        if pull_ma >= plan.current.ma_per_n * _CURRENT_N:
            break
    gripper.stop()
    deflection_mm = float(plan.compliance.deflection_mm(_CURRENT_N))
    size_mm = gripper.state().width_mm - plan.compliance.zero_mm + deflection_mm
    return _finish_grasp(
        sample, world, method="close until current", size_mm=size_mm, predicts_s=0.0
    )


def _pull_ma(gripper: TwinGripper, world: World, *, current: CurrentLaw, count: int) -> float:
    """Return the mean of the next current readings, less the gears' friction."""
    readings = list[float]()
    for _ in range(count):
        world.clock.sleep_s(_CURRENT_EVERY_S)
        state = gripper.state()
        readings.append(
            state.current_ma - float(current.gears.mean_current_ma(np.array(state.width_mm)))
        )
    return float(np.mean(readings))


def _finish_grasp(
    sample: Sample,
    world: World,
    *,
    method: str,
    size_mm: float,
    predicts_s: float = _PAPER_PREDICTS_S,
) -> Cycle:
    """Finish a grasp without a controller, with the gripper at contact, and return its results."""
    touch_s, touch_peak_n = world.clock.now_s(), world.truth().peak_force_n
    world.clock.sleep_s(predicts_s)
    truth = world.truth()
    held = world.force_n(world.clock.now_s()) > 0.0
    return Cycle(
        sample=sample,
        method=method,
        outcome="held" if held else "nothing_there",
        touch_s=touch_s,
        answer_s=touch_s + predicts_s,
        touch_peak_n=touch_peak_n,
        peak_n=truth.peak_force_n,
        damaged=truth.peak_force_n >= sample.obj().yield_n,
        size_error_mm=size_mm - sample.obj().size_mm,
    )


def grasp_batch(samples: Sequence[Sample]) -> list[Cycle]:
    """Grasp objects of one sensor with every method that is possible with their hand."""
    return [cycle for sample in samples for cycle in cycles(sample)]


def cycles(sample: Sample) -> list[Cycle]:
    """Grasp one object with every method that is possible with its hand."""
    found = [
        grasp_with_controller(sample),
        grasp_with_controller(sample, paper=Paper()),
        grasp_until_both_fingers(sample),
    ]
    return [*found, grasp_until_current(sample)] if sample.kind == "rigid" else found


def report(
    *,
    grasps: Annotated[int, typer.Option(help="Objects for each hand and level.", min=4)] = 100,
    second: SecondOption = False,
) -> StudyReport:
    """Grasp simulated objects with palpate, with the paper's method and with current alone.

    Example: palpate study grasp-cycle --grasps 40 --out reports
    """
    first_seed = SECOND_SEED if second else FIRST_SEED
    samples = [
        Sample(seed=first_seed + number, level=level, kind=kind, second=second)
        for level, kind in product(LEVELS, KINDS)
        for number in range(grasps)
    ]
    # Each sensor is calibrated once for all of its objects, in one process.
    batches = [list(sheet) for _, sheet in groupby(samples, key=lambda one: one.sheet)]
    return judge(map_batches(grasp_batch, batches))


command = as_command(report)


def judge(found: Sequence[Cycle]) -> StudyReport:
    """Return the report, with a row for each method, hand and level."""
    summary = [
        {"level": key["level"], "hand": key["kind"], "way": key["method"], **scores(each)}
        for key, each in group(found, "sample.level", "sample.kind", "method")
    ]
    lead = ("level", "hand", "way")
    compared = compare_methods(found)
    return StudyReport(
        name="grasp-cycle",
        title="A gentle grasp from the open hand to the answer (simulated)",
        provenance=[
            "Simulated at 15 frames/s: random objects with a stiffness over two decades and their "
            "own strength, flat or round, half of them relaxing like fruit. Four objects share a "
            "sensor and gripper, calibrated on the twin.",
            "palpate: default settings, a gentle squeeze without a damage limit. Baselines: the "
            "paper's steps of 1 mm (0.8 kPa) until the mean of all pixels has fallen by 10 %, with "
            "the prediction at 2.5 s; the same steps until the mean of each finger has fallen by "
            "10 %; closing at 10 mm/s until the servo current corresponds to 2 N.",
        ],
        tables=[
            Table.of(
                "Seconds and newtons: median and 95 %",
                summary,
                (
                    *lead,
                    "grasps",
                    "touch_s_median",
                    "touch_s_p95",
                    "answer_s_median",
                    "answer_s_p95",
                    "peak_n_median",
                    "peak_n_p95",
                    "damaged",
                ),
            ),
            Table.of(
                "Answers",
                summary,
                (
                    *lead,
                    "size_rms_mm",
                    "settled_median_error",
                    "force_median_error",
                    "stiffness_numbers",
                    "stiffness_median_error",
                    "stiffness_coverage",
                    "stiffness_bounds",
                    "stiffness_bounds_right",
                ),
            ),
            Table.of(
                "Fraction damaged: palpate minus each baseline (90 % interval, by sensor)",
                compared,
                ("level", "hand", "rival", "difference", "low", "high"),
            ),
        ],
        payload={
            "origin": "twin",
            "summary": summary,
            "compared": compared,
        },
    )


def scores(found: Sequence[Cycle]) -> dict[str, Any]:
    """Return times, forces and errors of one method; None for an unmeasured quantity."""

    def middle(name: str, quantile: float = 0.5) -> float | None:
        return median([abs(getattr(one, name)) for one in found], quantile)

    numbers = [one for one in found if np.isfinite(one.stiffness)]
    bounds = [one for one in found if one.stiffness_status in ("at_least", "at_most")]
    size_mm = mean([one.size_error_mm**2 for one in found])
    return {
        "grasps": len(found),
        "outcomes": dict(Counter(one.outcome for one in found)),
        "damaged": sum(one.damaged for one in found),
        **{
            f"{name}_{end}": middle(name, quantile)
            for name in ("touch_s", "answer_s", "touch_peak_n", "peak_n")
            for end, quantile in (("median", 0.5), ("p95", 0.95))
        },
        "size_rms_mm": None if size_mm is None else float(np.sqrt(size_mm)),
        "force_median_error": middle("force_error"),
        "settled_median_error": middle("settled_error"),
        "stiffness_numbers": len(numbers),
        "stiffness_median_error": median(
            [abs(one.stiffness / one.true_stiffness - 1.0) for one in numbers]
        ),
        "stiffness_median_ratio": median(
            [one.stiffness_high / one.stiffness_low for one in numbers]
        ),
        "stiffness_coverage": mean([_covers_truth(one) for one in numbers]),
        "stiffness_bounds": len(bounds),
        "stiffness_bounds_right": mean([_covers_truth(one) for one in bounds]),
    }


def compare_methods(found: Sequence[Cycle]) -> list[dict[str, Any]]:
    """Compare palpate's fraction of damaged objects with each baseline's, on the same objects."""
    rows = list[dict[str, Any]]()
    for key, every in group(found, "sample.level", "sample.kind"):
        by_method = {name["method"]: each for name, each in group(every, "method")}
        ours = {one.sample.seed: float(one.damaged) for one in by_method.get("ours", [])}
        sheets = [str(one.sample.sheet) for one in by_method.get("ours", [])]
        for method, each in by_method.items():
            theirs = {one.sample.seed: float(one.damaged) for one in each}
            if method != "ours" and ours.keys() == theirs.keys():
                pair = {"ours": list(ours.values()), method: [theirs[seed] for seed in ours]}
                named = {"level": key["level"], "hand": key["kind"]}
                rows += compare(pair, sheets, statistic=np.mean, **named)
    return rows


def _covers_truth(one: Cycle) -> bool:
    """Return whether the true stiffness is within the known limits."""
    above = not one.true_stiffness < one.stiffness_low
    return above and not one.true_stiffness > one.stiffness_high
