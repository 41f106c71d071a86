"""The loop and its faults, on a spring between two fingers."""

from __future__ import annotations

import os
import signal
from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.conftest import calibrate_once

from palpate.errors import DeviceError, DeviceTimeoutError
from palpate.grasp.estimator import Observation
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.planning import plan_grasp
from palpate.grasp.result import Outcome
from palpate.grasp.runner import run_grasp
from palpate.grasp.state import GraspState
from palpate.sensor.array import Frame
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import draw_object
from palpate.twin.world import World


def test_grasp_holds_measures_and_releases(plan: Plan, bench: Any) -> None:
    result = bench.grasp(plan)
    assert result.outcome is Outcome.HELD
    assert result.force_n is not None
    assert result.size_mm.low <= 50.3 <= result.size_mm.high
    assert abs(result.size_mm.value - 50.3) < 0.3
    assert 0 < result.previous_width_mm - 50.3 <= 0.5, "the width just before contact"
    of_the_grasp = [m.name for m in result.moments if m.finger is None]
    assert of_the_grasp == ["contact", "gave_way", "answer", "held"]
    assert {m.finger for m in result.moments if m.name == "finger_contact"} == {0, 1}
    assert bench.width_mm == 74.0
    assert bench.stops == 1


def test_run_grasp_reaches_target_from_below(plan: Plan, bench: Any) -> None:
    forces: list[float] = []
    result = bench.grasp(
        replace(plan, target_force_n=6.0), subscribers=[lambda _: forces.append(bench.force_n)]
    )
    assert result.outcome is Outcome.HELD
    assert 0.85 * 6.0 < max(forces) < 1.1 * 6.0


def test_run_grasp_without_object_reports_nothing_there(plan: Plan, bench: Any) -> None:
    bench.size_mm = 0.0
    result = bench.grasp(plan)
    assert result.outcome is Outcome.NOTHING_THERE
    assert result.force_n is None
    assert result.peak_force_n is None
    assert bench.width_mm == 74.0


def test_object_taken_away_ends_as_slipped(plan: Plan, bench: Any) -> None:
    def thief(_: Observation) -> None:
        if bench.force_n > 1.5 and bench.clock.now_s() > 12.0:
            bench.size_mm = 0.0

    result = bench.grasp(replace(plan, hold_s=10.0), subscribers=[thief])
    assert result.outcome is Outcome.SLIPPED
    assert bench.width_mm == 74.0


@pytest.mark.parametrize("fault", ["lost_after_s", "gone_after_s"])
def test_sensor_lost_while_holding_holds_still(plan: Plan, bench: Any, fault: str) -> None:
    setattr(bench, fault, 18.0)
    result = bench.grasp(replace(plan, hold_s=30.0))
    assert result.outcome is Outcome.SENSOR_LOST
    assert bench.force_n > 0, "dropping is damage too"
    assert bench.stops == 1
    assert "check the cable" in result.faults[-1] or "vanished" in result.faults[-1]
    # Five periods of 1/15 s, and not one frame more.
    assert bench.clock.now_s() < 18.0 + 5 / 15 + 2 / 15


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


def test_stale_frames_end_the_grasp(plan: Plan, bench: Any) -> None:
    def nap(_: Observation) -> None:
        if bench.clock.now_s() > 3.0:
            # Time passes between scan and delivery: a reader that lags behind.
            read = type(bench).read

            def late(*, timeout_s: float) -> Any:
                frame = read(bench, timeout_s=timeout_s)
                bench.clock.sleep_s(1.0)
                return frame

            bench.read = late

    result = bench.grasp(plan, subscribers=[nap])
    assert result.outcome is Outcome.SENSOR_LOST
    assert "1.00 s old" in result.faults[-1]
    assert bench.stops == 1


@pytest.mark.parametrize("ahead_s", [1 / 15, 0.1])
def test_run_grasp_frame_time_that_does_not_increase_ends_the_grasp(
    plan: Plan, bench: Any, ahead_s: float
) -> None:
    """The next frame has the same time, or an earlier one."""

    def turned(frame: Frame) -> Frame:
        return replace(frame, time_s=frame.time_s + ahead_s * (frame.sequence == 60))

    bench.change_frames(turned)
    result = bench.grasp(plan)
    assert result.outcome is Outcome.SENSOR_LOST
    assert "frame times do not increase" in result.faults[-1]
    assert bench.stops == 1


@pytest.mark.parametrize("phase", [Phase.SQUEEZE, Phase.RELEASE])
def test_run_grasp_unexpected_array_error_stops_hand_and_is_raised(
    plan: Plan, bench: Any, phase: Phase
) -> None:
    beliefs, read = list[GraspState](), bench.read

    def broken(*, timeout_s: float) -> Any:
        if beliefs and beliefs[-1].phase is phase:
            raise ValueError("cannot reshape array")
        return read(timeout_s=timeout_s)

    bench.read = broken
    with pytest.raises(ValueError, match="cannot reshape"):
        bench.grasp(plan, watchers=[beliefs.append])
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


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_run_grasp_stop_signal_stops_the_hand_and_keeps_the_grip(
    plan: Plan, bench: Any, number: int
) -> None:
    before = signal.getsignal(number)

    def user(_: Observation) -> None:
        if bench.force_n > 1.0:
            os.kill(os.getpid(), number)
            user_stops.append(bench.clock.now_s())

    user_stops: list[float] = []
    result = bench.grasp(plan, subscribers=[user])
    assert result.outcome is Outcome.STOPPED
    assert bench.clock.now_s() - user_stops[0] <= 0.1
    assert bench.force_n > 0
    assert bench.stops == 1
    assert signal.getsignal(number) == before


@pytest.mark.parametrize("seed", range(4, 9))
def test_grasp_holds_with_a_gripper_whose_moving_flag_flickers(
    plan: Plan, bench: Any, seed: int
) -> None:
    rng, state = np.random.default_rng(seed), bench.state
    bench.state = lambda: replace(state(), moving=bool(rng.random() < 0.3))
    assert bench.grasp(plan).outcome is Outcome.HELD


def test_lost_gripper_is_stopped_and_reported(plan: Plan, bench: Any) -> None:
    def state() -> Any:
        raise DeviceError("servo 1 doesn't answer; check its power")

    bench.state = state
    result = bench.grasp(plan)
    assert result.outcome is Outcome.GRIPPER_FAULT
    assert result.faults == ("servo 1 doesn't answer; check its power",)
    assert bench.stops == 1


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
    result = bench.grasp(plan)
    assert result.outcome is Outcome.GRIPPER_FAULT
    assert "check for a blockage" in result.faults[0]
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
def test_grasp_holds_although_frames_have_queued_since_the_rig_was_opened(
    rate_hz: int, waited_s: float
) -> None:
    """Opening a servo and planning a grasp take time, in which the sensor sends frames."""
    world = World(draw_object(np.random.default_rng(3), "tomato"), seed=5, frame_rate_hz=rate_hz)
    array, gripper = TwinArray(world), TwinGripper(world)
    plan = plan_grasp(
        calibrate_once(seed=5, level="lab", apart_from="tomato"),
        gripper=gripper,
        target_force_n=None,
        expect_size_mm=None,
    )
    world.clock.sleep_s(waited_s)
    world.drive_value(world.clock.now_s())
    seen = list[Observation]()
    result = run_grasp(
        plan, array=array, gripper=gripper, clock=world.clock, subscribers=[seen.append]
    )
    assert result.outcome is Outcome.HELD
    assert seen[0].frame.time_s >= waited_s - max(1 / rate_hz, 0.02)
    assert result.frames_lost == 0


def test_grasp_with_slow_reports_skips_frames_and_names_the_reason(plan: Plan, bench: Any) -> None:
    """Each report takes as long as three frames; a queue holds them meanwhile."""
    bench.change_frames(lambda one: replace(one, counts=one.counts + one.sequence % 2))
    read, report = bench.read, bench.state
    queue = deque[Frame]()

    def read_queue(*, timeout_s: float) -> Frame:
        if not queue and timeout_s == 0.0:
            raise DeviceTimeoutError("no frame is waiting")
        return queue.popleft() if queue else read(timeout_s=timeout_s)

    def report_slowly() -> Any:
        queue.extend(read(timeout_s=1.0) for _ in range(3))
        return report()

    bench.read, bench.state = read_queue, report_slowly
    result = bench.grasp(plan)
    assert result.outcome is Outcome.HELD
    assert result.frames_lost == 0
    assert result.frames_skipped > 1.5 * result.frames
    assert "each report of the gripper took 0.200 s" in result.faults[0]


def test_grasp_survives_a_computer_that_stalls_as_long_as_frames_arrive(
    plan: Plan, bench: Any
) -> None:
    """The program is stopped for half a second; the frames of that time wait in a queue."""
    read, queue = bench.read, deque[Frame]()

    def read_queue(*, timeout_s: float) -> Frame:
        if bench.sequence == 60:
            queue.extend(read(timeout_s=1.0) for _ in range(8))
        if not queue and timeout_s == 0.0:
            raise DeviceTimeoutError("no frame is waiting")
        return queue.popleft() if queue else read(timeout_s=timeout_s)

    bench.read = read_queue
    result = bench.grasp(plan)
    assert result.outcome is Outcome.HELD
    assert result.frames_skipped == 7
