"""A hand that tightens when the object slips: drops, damage, reaction time, false tightenings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
import typer

from palpate.grasp.config import READING, TIGHTEN
from palpate.grasp.estimator import Touch
from palpate.grasp.phases import Phase
from palpate.grasp.planning import plan_grasp
from palpate.grasp.runner import run_grasp
from palpate.grasp.state import GraspState
from palpate.grasp.tighten import measure_shift
from palpate.sensor.array import ArrayLayout, Frame
from palpate.sensor.pressure_centre import pressure_centres
from palpate.sensor.sample import SampleReader
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.friction import N_PER_G
from palpate.twin.objects import draw_object
from palpate.twin.world import World
from palpate_studies.force_control_world import GRASPS_PER_SHEET, calibration_of
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import LEVELS, median
from palpate_studies.twin_session import Session

FRUIT = ("strawberry", "tomato", "apple", "kiwi")
#: Seeds of the first object and of the first quiet hold. The numbers of the method were chosen on
#: the seeds from 7 700 000 and 40 000; quiet holds from 41 000 showed that the steps of the
#: converter must count as noise.
FIRST_SEED, FIRST_QUIET = 7_800_000, 42_000
#: Target forces; time from the hold to the load, rise of the load, and time after it.
TARGETS_N, DELAYS_S, RISES_S, AFTER_S = (2.0, 4.0), (1.0, 1.5), (0.5, 2.0), 0.5
#: Final load relative to the friction limit; stiffness of an elastic load, in limits per mm.
LOAD_RATIO, ELASTIC_PER_MM = 2.0, 0.1
LOADS = ("dead", "elastic")
#: Frames/s during the approach, which this study does not examine.
APPROACH_HZ = 15.0
QUIET_S, QUIET_CLOSURES_MM = 60.0, (1.0, 3.0)


def report(
    *,
    objects: Annotated[int, typer.Option(help="Objects of both levels.", min=4)] = 100,
    times: Annotated[int, typer.Option(help="Most tightenings of a grip.", min=1)] = 3,
    rates_hz: Annotated[list[float], typer.Option("--rate-hz", help="Frames/s.")] = [15.0, 250.0],  # noqa: B006
    quiet: Annotated[int, typer.Option(help="Quiet holds of a minute, both levels.")] = 200,
    quiet_rate_hz: Annotated[float, typer.Option(help="Frames/s of the quiet holds.")] = 15.0,
    partial_slip: Annotated[bool, typer.Option(help="Contacts shift before sliding.")] = True,
) -> StudyReport:
    """Load held objects up to twice the friction limit, with and without tightening.

    Example: palpate study tighten --objects 40 --quiet 50 --out reports
    """
    rows = [
        load_object(
            FIRST_SEED + number,
            rate_hz=rate_hz,
            tighten=tighten,
            has_partial_slip=partial_slip,
        )
        for rate_hz, tighten in [(APPROACH_HZ, 0), *((rate_hz, times) for rate_hz in rates_hz)]
        for number in range(objects)
    ]
    alarms = [count_quiet_slips(FIRST_QUIET + n, rate_hz=quiet_rate_hz) for n in range(quiet)]
    return judge(rows, alarms, quiet_rate_hz=quiet_rate_hz)


command = as_command(report)


class _ChangingArray:
    """A simulated array whose frame rate changes once."""

    def __init__(self, world: World) -> None:
        self._world, self._array = world, TwinArray(world)

    @property
    def layout(self) -> ArrayLayout:
        return self._world.layout

    def change_rate(self, rate_hz: float) -> None:
        """Scan at another rate from now on."""
        self._array.close()
        self._world.frame_rate_hz = rate_hz
        self._array = TwinArray(self._world)

    def read(self, *, timeout_s: float) -> Frame:
        """Return the next frame."""
        return self._array.read(timeout_s=timeout_s)

    def close(self) -> None:
        """Stop scanning."""
        self._array.close()


def load_object(
    seed: int, *, rate_hz: float, tighten: int, has_partial_slip: bool = True
) -> dict[str, Any]:
    """Hold one fruit and pull at it until the load is twice the friction limit.

    The level alternates from object to object, and the kind of load from pair to pair.
    """
    rng = np.random.default_rng([seed, 61])
    level, load = LEVELS[seed % 2], LOADS[seed // 2 % 2]
    obj = draw_object(rng, FRUIT[seed // 4 % len(FRUIT)])
    sheet = seed // (2 * GRASPS_PER_SHEET)
    world = World(
        obj,
        seed=seed,
        sheet_seed=sheet,
        level=level,
        frame_rate_hz=APPROACH_HZ,
        has_partial_slip=has_partial_slip,
    )
    target_n, delay_s, rise_s = (float(rng.uniform(*b)) for b in (TARGETS_N, DELAYS_S, RISES_S))
    array, gripper = _ChangingArray(world), TwinGripper(world)
    plan = plan_grasp(
        calibration_of(sheet, level, "rigid"),
        gripper=gripper,
        target_force_n=target_n,
        hold_s=delay_s + rise_s + AFTER_S,
    )
    limits_n, ended_s, dropped_s = list[float](), list[float](), list[float]()

    def watch(grasp_state: GraspState) -> None:
        if grasp_state.phase is not Phase.HOLD:
            return
        if world.frame_rate_hz != rate_hz:
            array.change_rate(rate_hz)
        if world.has_dropped and not dropped_s:
            dropped_s.append(world.now_s())
        if not limits_n and grasp_state.phase_time_s >= delay_s:
            limits_n.append(2.0 * obj.friction * world.force_n(world.now_s()))
            world.lift(
                more_n=LOAD_RATIO * limits_n[0] - N_PER_G * obj.mass_g,
                rise_s=rise_s,
                n_per_mm=ELASTIC_PER_MM * limits_n[0] * (load == "elastic"),
            )
        if grasp_state.tightening.count and not ended_s:
            ended_s.extend([s for s in [grasp_state.estimate.still_since_s] if s is not None])

    result = run_grasp(
        replace(plan, tighten=tighten),
        array=array,
        gripper=gripper,
        clock=world.clock,
        watchers=[watch],
    )
    commands_s = [one.time_s for one in result.moments if one.name == "tightened"]
    slid_s, truth = world.slid_at_s, world.truth()
    # A tightening after the drop is none.
    reacted = bool(commands_s) and slid_s is not None and not (dropped_s and dropped_s < commands_s)
    return {
        "seed": seed,
        "level": level,
        "load": load,
        "rate_hz": rate_hz,
        "tighten": tighten,
        "loaded": bool(limits_n),
        "dropped": world.has_dropped,
        "damaged": truth.damaged,
        "outcome": str(result.outcome),
        "tightened": len(commands_s),
        "command_s": commands_s[0] - slid_s if reacted and slid_s is not None else None,
        "reaction_s": ended_s[0] - slid_s if reacted and ended_s and slid_s is not None else None,
        "peak_force_n": truth.peak_force_n,
    }


def count_quiet_slips(sensor: int, *, rate_hz: float) -> dict[str, Any]:
    """Hold an object for a minute without a load; count the frames that would tighten the grip."""
    level = LEVELS[sensor % 2]
    rng = np.random.default_rng([sensor, 62])
    session = Session(sensor, level=level)
    world = session.world
    obj = draw_object(rng, FRUIT[sensor // 2 % len(FRUIT)])
    session.place(obj)
    session.close_to(obj.size_mm + 6.0)
    world.clock.sleep_s(1.0)
    rest_ohm = session.mean_ohm()
    session.close_to(obj.size_mm - float(rng.uniform(*QUIET_CLOSURES_MM)))
    since_s = world.clock.now_s() + READING.quiet_s
    world.frame_rate_hz = rate_hz
    array, reader = TwinArray(world), SampleReader(world.layout, rest_ohm)
    touches, ratios = list[Touch](), list[float]()
    while world.clock.now_s() < since_s + QUIET_S:
        sample = reader.read(array.read(timeout_s=1.0))
        touches.append(
            Touch(
                time_s=sample.time_s,
                finger_percent=(),
                relative_percent=0.0,
                sheet_n=0.0,
                centres=pressure_centres(sample, world.layout),
            )
        )
        # Readings beyond the baseline do not matter.
        del touches[: -int(2.0 * TIGHTEN.baseline_s * rate_hz)]
        shift = measure_shift(touches, since_s=since_s)
        ratios.append(0.0 if shift is None else shift.ratio)
    array.close()
    over = np.array(ratios) > 1.0
    slips = int(np.count_nonzero(over[1:] & ~over[:-1]))
    return {"level": level, "slips": slips, "largest_ratio": max(ratios)}


def judge(
    rows: Sequence[dict[str, Any]], alarms: Sequence[dict[str, Any]], *, quiet_rate_hz: float
) -> StudyReport:
    """Return the report of any number of loads and quiet holds."""
    groups = dict.fromkeys((row["rate_hz"], row["tighten"], row["load"]) for row in rows)
    summary = [
        {
            "rate_hz": group[0],
            "tighten": group[1],
            "load": group[2],
            "objects": len(part),
            "dropped": sum(row["dropped"] for row in part),
            "damaged": sum(row["damaged"] for row in part),
            "reacted": len(reacted),
            "command_s": median([row["command_s"] for row in reacted]),
            "reaction_s": median([row["reaction_s"] for row in reacted]),
            "p95_reaction_s": median([row["reaction_s"] for row in reacted], 0.95),
        }
        for group in groups
        for part in [
            [
                row
                for row in rows
                if row["loaded"] and (row["rate_hz"], row["tighten"], row["load"]) == group
            ]
        ]
        for reacted in [[row for row in part if row["reaction_s"] is not None]]
    ]
    quiet = [
        {
            "level": level,
            "rate_hz": quiet_rate_hz,
            "holds": len(part),
            "false": sum(row["slips"] > 0 for row in part),
            "largest_ratio": max(row["largest_ratio"] for row in part),
        }
        for level in LEVELS
        for part in [[row for row in alarms if row["level"] == level]]
        if part
    ]
    return StudyReport(
        name="tighten",
        title="A hand that tightens when the object slips (simulated)",
        provenance=[
            f"Simulated: {', '.join(FRUIT)} in turn, half of them at each level, gripped with "
            f"rigid fingers to {TARGETS_N[0]:g} to {TARGETS_N[1]:g} N. A load along the pads rises "
            f"in {RISES_S[0]:g} to {RISES_S[1]:g} s to {LOAD_RATIO:g} times the friction limit of "
            "the grip. A dead load does not yield; an elastic one falls by "
            f"{ELASTIC_PER_MM:g} limits per mm of sliding. The friction, and the shift of the "
            "contact before it slides, are assumptions: no recording of a slip was available.",
            "The reaction is the time from the first sliding to the end of the closing movement. "
            f"The approach always runs at {APPROACH_HZ:g} frames/s.",
        ],
        tables=[
            Table.of("Loads up to twice the friction limit", summary),
            Table.of("Quiet holds of a minute with a false slip", quiet),
        ],
        payload={
            "simulated": True,
            "summary": summary,
            "quiet": quiet,
            "rows": list(rows),
        },
    )
