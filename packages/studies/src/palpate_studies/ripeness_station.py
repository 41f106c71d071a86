"""A bench for simulated avocados on several mornings, with a sensor that may age.

A nest centres each fruit. Between mornings the same hand grasps other objects all day. All
measurements use the devices, the controller and a calibration with a user's steps. The records
contain the data of a store and the twin's truth.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from uuid import UUID

import numpy as np

from palpate.arrays import FloatArray
from palpate.calibrate.guided import measure_rest
from palpate.calibration import RestValues
from palpate.force.of_calibration import HORIZON_S
from palpate.grasp.estimator import Observation
from palpate.grasp.planning import plan_grasp
from palpate.grasp.runner import run_grasp
from palpate.gripper.interface import GripperCommand
from palpate.sensor.sample import pixel_resistance_ohm, relative_change_percent
from palpate.signal.relative import mean_change
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import TwinObject
from palpate.twin.ranges import draw_uniform
from palpate.twin.rig import calibrate_twin, twin_bench
from palpate.twin.velostat import Environment
from palpate.twin.world import OPEN_MM, SOFT_MM_PER_KPA, GripperKind, World
from palpate_station.answer_pixels import answer_pixel_percent
from palpate_station.grasp_record import hold_measurements, list_answers
from palpate_station.records import Drive, Grasp
from palpate_station.ripeness.closing import ClosingWatch
from palpate_station.ripeness.firmness import RIPENESS_N
from palpate_station.ripeness.rule import RipenessRule
from palpate_station.ripeness.shared_load import measure_shared_pixels
from palpate_studies.fruit_ranges import AVOCADO_STAGES, STATION
from palpate_studies.station_records import StationRecords, days_of, learn_rule
from palpate_studies.stoppable import require_uninterrupted
from palpate_studies.twin_avocado import Avocado, draw_avocado

#: Mornings; grasps of a labelled fruit on each morning, as in the paper.
DAYS, LABELLED_GRASPS = 4, 10
#: Grasps of a fruit to judge, repeated while its stage is uncertain up to a maximum per day.
GRASPS_AT_ONCE, MOST_GRASPS = 3, 30
#: Days from the labelled fruits to the fruits to judge.
LATER_DAYS = 7
_FIRST = datetime(2026, 5, 4, 8, tzinfo=UTC)
#: Pause in which a fruit is placed and the sheet recovers. The pause is repeated while the sheet
#: reads this many percent below its rest, up to a longest time.
_PAUSE_S, _RESIDUAL_PERCENT, _LONGEST_PAUSE_S = 5.0, -5.0, 30.0
#: Gap of the waiting fingers to the object, by eye.
_GAP_MM = 3.0
#: Force step of the squeeze, newtons: five steps to the grip force.
_FORCE_STEP_N = 1.2
#: Lower than the paper's 15 Hz, because thousands of grasps are simulated frame by frame.
_FRAME_RATE_HZ = 10.0
#: The paper's method: closure beyond the caliper size, or pressure, the same on all days; and the
#: averaging time.
_CLOSED_BY_MM, _PRESSURE_KPA, _MEAN_S = 3.0, 28.0, 0.5


def run_station(
    sensor: int, *, level: str, gripper: GripperKind, aging: bool, labelled: int, others: int
) -> StationRecords:
    """Grasp fruits on four mornings each; `aging` enables wear and changes of climate.

    More than `labelled` fruits are labelled if these do not include every stage.
    """
    rng = np.random.default_rng([sensor, 31])
    bench = _Bench(sensor, level=level, gripper=gripper)
    first = draw_labelled(rng, labelled)
    second = tuple(draw_avocado(rng) for _ in range(others))
    climate = np.random.default_rng([sensor, 32])
    # The calibration of a new sheet takes about sixty contacts.
    cycles = 60.0
    rule = None
    for begins, fruits, name in ((0, first, "labelled"), (LATER_DAYS, second, "fruit")):
        if first and name == "fruit":
            rule = learn_rule(bench.read_all(first))
        for day in range(DAYS if fruits else 0):
            surroundings = Environment()
            if aging:
                surroundings = Environment(
                    temperature_c=draw_uniform(climate, STATION.temperature_c),
                    humidity_percent=draw_uniform(climate, STATION.humidity_percent),
                    cycles=int(cycles),
                )
                cycles += draw_uniform(climate, STATION.cycles_per_day)
            bench.begin_day(begins + day, surroundings=surroundings)
            bench.grasp_fruits(fruits, name=name, day=day, rule=rule)
        cycles += (LATER_DAYS - DAYS) * draw_uniform(climate, STATION.cycles_per_day)
    return bench.read_all(first, second)


def draw_labelled(
    rng: np.random.Generator,
    fewest: int,
    *,
    make: Callable[[Avocado, int], Avocado] = lambda fruit, number: fruit,
) -> tuple[Avocado, ...]:
    """Draw at least `fewest` fruits, and more until every stage appears.

    `make`: from a drawn fruit and its number to the returned fruit.
    """
    drawn = [make(draw_avocado(rng), number) for number in range(fewest)]
    while drawn and {one.stage(day) for one in drawn for day in range(DAYS)} != set(AVOCADO_STAGES):
        drawn.append(make(draw_avocado(rng), len(drawn)))
    return tuple(drawn)


class _Bench:
    """One sensor on one gripper, in a new world every morning."""

    def __init__(self, sensor: int, *, level: str, gripper: GripperKind) -> None:
        self._sensor, self._level, self._gripper = sensor, level, gripper
        self.calibration = calibrate_twin(seed=sensor, level=level, apart_from="", kind=gripper)
        self.grasps: list[Grasp] = []
        self.damaged = 0
        self.as_published: dict[tuple[str, int], float] = {}
        self._ids = np.random.default_rng([sensor, 33])

    def begin_day(self, day: int, *, surroundings: Environment) -> None:
        """Start a day: create a new world for the same sensor in these surroundings.

        Climate and wear change the rest values, so they are measured again with the hand empty
        (`palpate calibrate rest`). Otherwise a sheet that reads a sixth lower appears pressed.
        """
        self._day, self._surroundings = day, surroundings
        self._rng = np.random.default_rng([self._sensor, 35, day])
        self._world = World(
            None,
            seed=self._sensor * 1000 + day + 500_000_000,
            sheet_seed=self._sensor,
            level=self._level,
            gripper=self._gripper,
            environment=surroundings,
            frame_rate_hz=_FRAME_RATE_HZ,
        )
        calibration = replace(self.calibration, rest=_rest_of(self._world))
        self._array, self._hand = TwinArray(self._world), TwinGripper(self._world)
        plan = plan_grasp(calibration, gripper=self._hand, target_force_n=RIPENESS_N, hold_s=0.0)
        self._plan = replace(plan, force_step_n=_FORCE_STEP_N)

    def grasp_fruits(
        self, fruits: Sequence[Avocado], *, name: str, day: int, rule: RipenessRule | None
    ) -> None:
        """Grasp each fruit as a user would, and once more by the paper's method."""
        for number, fruit in enumerate(fruits):
            item_id, times = f"{name}-{number}", 0
            at_once = LABELLED_GRASPS if rule is None else GRASPS_AT_ONCE
            while times == 0 or (times < MOST_GRASPS and self._is_uncertain(item_id, rule=rule)):
                for _ in range(at_once):
                    self._grasp(fruit.spot(day, rng=self._rng), item_id=item_id)
                times += at_once
            spot = fruit.spot(day, rng=self._rng)
            self.as_published[item_id, day] = self._read_settled_percent(spot, fruit=fruit)

    def read_all(
        self, labelled: tuple[Avocado, ...], others: tuple[Avocado, ...] = ()
    ) -> StationRecords:
        """Return the records so far."""
        return StationRecords(
            calibration=self.calibration,
            labelled=labelled,
            others=others,
            grasps=tuple(self.grasps),
            damaged=self.damaged,
            as_published=self.as_published,
        )

    def _is_uncertain(self, item_id: str, *, rule: RipenessRule | None) -> bool:
        """Return whether the fruit's stage is uncertain after the grasps so far."""
        if rule is None:
            return False
        days = days_of(self.read_all(()), item_id)
        return not days or rule.judge(days).is_uncertain

    def _approach_and_settle(self, size_mm: float) -> None:
        """Move the fingers near the object in the nest, and wait until the sheet settles."""
        limits = self._plan.gripper
        gap_mm = math.ceil(size_mm) + _GAP_MM - OPEN_MM
        target = limits.highest + gap_mm if limits.drive == "width" else -gap_mm / SOFT_MM_PER_KPA
        self._hand.command(GripperCommand(target=target, rate=self._plan.rate))
        give_up_s = self._world.clock.now_s() + _LONGEST_PAUSE_S
        self._array.skip_until(self._world.clock.now_s() + _PAUSE_S)
        while (
            self._read_residual_percent() < _RESIDUAL_PERCENT
            and self._world.clock.now_s() < give_up_s
        ):
            self._array.skip_until(self._world.clock.now_s() + _PAUSE_S)

    def _read_residual_percent(self) -> float:
        """Return the mean change of the open hand relative to the morning's rest values."""
        now_ohm = self._mean_ohm(after_s=0.0)
        return float(mean_change(relative_change_percent(now_ohm, rest_ohm=self._plan.rest_ohm)))

    def _read_settled_percent(self, spot: TwinObject, *, fruit: Avocado) -> float:
        """Close on a fruit by the paper's method; return the settled change at 20 s."""
        target = _PRESSURE_KPA
        if self._gripper == "rigid":
            target = round(fruit.size_mm) - _CLOSED_BY_MM
        self._world.place(spot, fixture=True)
        rest_ohm = self._mean_ohm(after_s=_PAUSE_S)
        self._hand.command(GripperCommand(target=target, rate=40.0))
        held_ohm = self._mean_ohm(after_s=HORIZON_S - _MEAN_S)
        self._hand.release()
        self._world.clock.sleep_s(_PAUSE_S)
        return float(mean_change(relative_change_percent(held_ohm, rest_ohm=rest_ohm)))

    def _mean_ohm(self, *, after_s: float) -> FloatArray:
        self._array.skip_until(self._world.clock.now_s() + after_s)
        until_s = self._world.clock.now_s() + _MEAN_S
        counts = []
        while self._world.clock.now_s() < until_s:
            counts.append(self._array.read(timeout_s=1.0).counts)
        layout = self._plan.layout
        return np.asarray(pixel_resistance_ohm(np.stack(counts), layout=layout).mean(axis=0))

    def _grasp(self, obj: TwinObject, *, item_id: str) -> None:
        world, observations = self._world, list[Observation]()
        closing = ClosingWatch(self._plan)
        world.place(obj, fixture=True)
        self._approach_and_settle(obj.size_mm)
        result = require_uninterrupted(
            run_grasp(
                self._plan,
                array=self._array,
                gripper=self._hand,
                clock=world.clock,
                subscribers=[observations.append],
                watchers=[closing.add_state],
            )
        )
        self.damaged += world.truth(horizon_s=0.0).damaged
        drive: Drive = "width" if self._gripper == "rigid" else "pressure"
        measured = (
            list_answers(result)
            | hold_measurements(observations, result=result, drive=drive)
            | closing.list_measurements()
        )
        measured |= measure_shared_pixels(
            observations, result=result, layout=self._plan.layout, measured=measured
        )
        taken_at = _FIRST + timedelta(days=self._day, seconds=world.clock.now_s())
        self.grasps.append(
            Grasp(
                grasp_id=str(UUID(bytes=self._ids.bytes(16), version=4)),
                item_id=item_id,
                taken_at=taken_at,
                rig=f"sim-{self._gripper}",
                drive=drive,
                origin="twin",
                outcome=result.outcome,
                measurements=measured,
                pixel_settled_percent=answer_pixel_percent(
                    observations, result=result, layout=self._plan.layout
                ),
                decision_time_s=result.decision_time_s,
                peak_force_n=result.peak_force_n,
                temperature_c=self._surroundings.temperature_c,
                humidity_percent=self._surroundings.humidity_percent,
            )
        )


def _rest_of(world: World) -> RestValues:
    """Measure the rest values of an empty hand."""
    bench = twin_bench(world, start=TwinGripper(world).limits.target(0.0))
    rest = measure_rest(bench)
    bench.array.close()
    return rest
