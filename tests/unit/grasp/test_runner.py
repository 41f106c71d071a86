"""The loop and its faults, on a spring between two fingers."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.factories import draw, grasp_on_twin
from tests.fixtures import calibrate_once

from palpate.errors import DeviceError, DeviceTimeoutError
from palpate.grasp.estimator import Observation
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.planning import plan_grasp
from palpate.grasp.requests import Requests
from palpate.grasp.result import Outcome
from palpate.grasp.runner import run_grasp
from palpate.grasp.state import GraspState
from palpate.sensor.array import Frame
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.world import World


def test_grasp_holds_measures_and_releases(plan: Plan, bench: Any) -> None:
    result = bench.grasp(plan)
    assert result.outcome is Outcome.HELD
    assert result.force_n is not None
    assert result.size_mm.low <= 50.3 <= result.size_mm.high
    assert abs(result.size_mm.value - 50.3) < 0.3
    assert result.previous_width_mm is None, "no step precedes a contact at speed"
    of_the_grasp = [m.name for m in result.moments if m.finger is None]
    assert of_the_grasp == ["contact", "gave_way", "answer", "held"]
    assert {m.finger for m in result.moments if m.name == "finger_contact"} == {0, 1}
    assert bench.width_mm == 74.0
    assert bench.stops == 1
    assert result.largest_frame_age_s == 0.0, "every frame is as new as the clock"


def test_sensor_that_is_silent_while_the_hand_closes_is_named_with_the_whole_wait() -> None:
    """The loop looks at the moving hand in between; each look is much shorter."""
    world = World(draw("tomato", 5), seed=5, level="lab", frame_rate_hz=250.0)
    gripper = TwinGripper(world)

    class Silent(TwinArray):
        def read(self, *, timeout_s: float) -> Frame:
            if gripper.state().moving and world.clock.now_s() > 1.0:
                world.clock.sleep_s(timeout_s)
                raise DeviceTimeoutError(f"nothing within {timeout_s:g} s")
            return super().read(timeout_s=timeout_s)

    plan = plan_grasp(calibrate_once(seed=5, level="lab", apart_from="tomato"), gripper=gripper)
    result = run_grasp(plan, array=Silent(world), gripper=gripper, clock=world.clock)
    assert result.outcome is Outcome.SENSOR_LOST
    assert "no frame in" in " ".join(result.faults)


def test_sensor_lost_while_releasing_opens(plan: Plan, bench: Any) -> None:
    command, openings = bench.command, list[Any]()

    def slow_to_open(wanted: Any) -> Any:
        if wanted.target == 74.0:
            openings.append(wanted)
            bench.gone_after_s = 0.0
            if len(openings) == 1:
                return wanted
        return command(wanted)

    bench.command = slow_to_open
    result = bench.grasp(plan)
    assert result.outcome is Outcome.SENSOR_LOST
    assert len(openings) == 2
    assert bench.width_mm == 74.0


@pytest.mark.parametrize("moves_s", [0.5, 1e9])
def test_hand_without_a_sensor_is_stopped_only_after_its_opening(
    plan: Plan, bench: Any, moves_s: float
) -> None:
    command, state, stop, opened_s, stopped_s = bench.command, bench.state, bench.stop, [], []

    def lose_sensor(wanted: Any) -> Any:
        if wanted.target == 74.0 and not opened_s:
            opened_s.append(bench.clock.now_s())
            bench.gone_after_s = 0.0
        return command(wanted)

    def report() -> Any:
        is_moving = bool(opened_s) and bench.clock.now_s() < opened_s[0] + moves_s
        return replace(state(), moving=is_moving)

    def stop_hand() -> None:
        stopped_s.append(bench.clock.now_s())
        stop()

    bench.command, bench.state, bench.stop = lose_sensor, report, stop_hand
    assert bench.grasp(plan).outcome is Outcome.SENSOR_LOST
    waited_s = min(moves_s, plan.longest_opening_s)
    assert stopped_s[0] - opened_s[0] == pytest.approx(waited_s, abs=0.05)


def test_gripper_that_fails_with_the_sensor_while_releasing_is_reported(
    plan: Plan, bench: Any
) -> None:
    command, state = bench.command, bench.state

    def lose_board(wanted: Any) -> Any:
        bench.gone_after_s = 0.0 if wanted.target == 74.0 else bench.gone_after_s
        return command(wanted)

    def fail() -> Any:
        if bench.gone_after_s == 0.0:
            raise DeviceError("the gripper's board is gone")
        return state()

    bench.command, bench.state = lose_board, fail
    bench.grasp_until(Outcome.SENSOR_LOST, plan, words="the gripper's board is gone")


@pytest.mark.parametrize("phase", [Phase.SQUEEZE, Phase.RELEASE])
def test_run_grasp_unexpected_array_error_stops_hand_and_is_reported(
    plan: Plan, bench: Any, phase: Phase
) -> None:
    beliefs, read = list[GraspState](), bench.read

    def broken(*, timeout_s: float) -> Any:
        if beliefs and beliefs[-1].phase is phase:
            raise ValueError("cannot reshape array")
        return read(timeout_s=timeout_s)

    bench.read = broken
    result = bench.grasp(plan, watchers=[beliefs.append])
    assert result.outcome is Outcome.GRIPPER_FAULT
    assert "ValueError: cannot reshape array (test_runner.py, line " in result.faults[-1]
    assert bench.stops == 1


@pytest.mark.parametrize("views", ["subscribers", "watchers"])
def test_failing_watcher_is_removed_and_reported(plan: Plan, bench: Any, views: str) -> None:
    seen: list[object] = []

    def broken(_: object) -> None:
        raise OSError("disk full")

    result = bench.grasp(plan, **{views: [broken, seen.append]})
    assert result.outcome is Outcome.HELD
    assert result.faults == ("broken failed and was removed: disk full",)
    assert len(seen) == result.frames


@pytest.mark.parametrize("seed", [4, 5, 6])
def test_grasp_holds_with_a_gripper_whose_moving_flag_flickers(
    plan: Plan, bench: Any, seed: int
) -> None:
    rng, state = np.random.default_rng(seed), bench.state
    bench.state = lambda: replace(state(), moving=bool(rng.random() < 0.3))
    assert bench.grasp(plan).outcome is Outcome.HELD


def test_gripper_that_cannot_be_stopped_is_reported(plan: Plan, bench: Any) -> None:
    def stop() -> None:
        raise DeviceError("port gone")

    bench.stop = stop
    result = bench.grasp(plan)
    assert result.outcome is Outcome.GRIPPER_FAULT
    assert result.faults == ("the stop command failed: port gone",)


def test_gripper_that_does_not_follow_is_stopped(plan: Plan, bench: Any) -> None:
    command, jammed_s = bench.command, list[float]()

    def jam(wanted: Any) -> Any:
        if bench.width_mm > 60.0:
            return command(wanted)
        jammed_s.append(bench.clock.now_s())
        return wanted

    bench.command = jam
    bench.grasp_until(Outcome.GRIPPER_FAULT, plan, words="check for a blockage")
    assert bench.stops == 1
    # The ways of 2 mm at 14 mm/s, done and not done, 0.4 s of grace, and a frame that shows it.
    assert bench.clock.now_s() - jammed_s[0] < 2 * 0.15 + 0.4 + 0.1


def test_missing_frame_numbers_count_as_lost(plan: Plan, bench: Any) -> None:
    def drop(observation: Observation) -> None:
        if observation.frame.sequence == 20:
            bench.sequence += 3

    assert bench.grasp(plan, subscribers=[drop]).frames_lost == 3


@pytest.mark.slow
@pytest.mark.parametrize(("rate_hz", "waited_s"), [(15, 3.0), (250, 0.4)])
def test_grasp_begins_with_new_frames_although_others_have_queued_since_the_rig_was_opened(
    rate_hz: int, waited_s: float
) -> None:
    """Opening a servo and planning a grasp take time, in which the sensor sends frames."""
    world = World(draw("tomato", 3), seed=5, frame_rate_hz=rate_hz)
    seen, requests = list[Observation](), Requests()

    def watch(observation: Observation) -> None:
        seen.append(observation)
        if observation.frame.time_s > waited_s + 1.0:
            requests.stop.set()

    world.clock.sleep_s(waited_s)
    world.drive_value(world.clock.now_s())
    views = {"subscribers": [watch], "requests": requests}
    calibration = calibrate_once(seed=5, level="lab", apart_from="tomato")
    result = grasp_on_twin(world, calibration, views=views)
    assert (result.outcome, result.faults) == (Outcome.STOPPED, ())
    assert seen[0].frame.time_s >= waited_s - max(1 / rate_hz, 0.02)
    assert result.frames_lost == 0


def queue_frames(bench: Any, *, stalls_at: int | None) -> None:
    """Queue the frames of each report, which takes as long as three, or of half a second once."""
    read, report, queue = bench.read, bench.state, deque[Frame]()

    def read_queue(*, timeout_s: float) -> Frame:
        if bench.sequence == stalls_at:
            queue.extend(read(timeout_s=1.0) for _ in range(8))
        if not queue and timeout_s == 0.0:
            raise DeviceTimeoutError("no frame is waiting")
        return queue.popleft() if queue else read(timeout_s=timeout_s)

    def report_slowly() -> Any:
        if stalls_at is None:
            queue.extend(read(timeout_s=1.0) for _ in range(3))
        return report()

    bench.read, bench.state = read_queue, report_slowly


def test_grasp_with_slow_reports_skips_frames_and_names_the_reason(plan: Plan, bench: Any) -> None:
    bench.change_frames(lambda one: replace(one, counts=one.counts + one.sequence % 2))
    queue_frames(bench, stalls_at=None)
    result = bench.grasp(plan)
    assert result.outcome is Outcome.HELD
    assert result.frames_lost == 0
    assert result.frames_skipped > 1.5 * result.frames
    assert "each report of the gripper took 0.200 s" in result.faults[0]


def test_grasp_survives_a_computer_that_stalls_as_long_as_frames_arrive(
    plan: Plan, bench: Any
) -> None:
    queue_frames(bench, stalls_at=30)
    result = bench.grasp(plan)
    assert result.outcome is Outcome.HELD
    assert result.frames_skipped == 7


def test_frame_that_is_delivered_too_late_is_skipped_and_counted(plan: Plan, bench: Any) -> None:
    read = bench.read

    def read_late(*, timeout_s: float) -> Frame:
        if timeout_s == 0.0:
            raise DeviceTimeoutError("no frame is waiting")
        frame: Frame = read(timeout_s=timeout_s)
        bench.clock.sleep_s(1.0 if frame.sequence == 30 else 0.0)
        return frame

    bench.read = read_late
    result = bench.grasp_until(Outcome.HELD, plan)
    assert result.frames_skipped == 1
