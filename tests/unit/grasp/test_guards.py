"""Faults of sensor and gripper that end a grasp, on a spring."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.errors import DeviceError, DeviceTimeoutError
from palpate.force.servo_force import CurrentLaw, GearFriction
from palpate.grasp.controller import GraspController, finish_release, is_closing_too_far
from palpate.grasp.estimator import ContactEstimate, Observation
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.requests import Requests
from palpate.grasp.rest import explain_implausible_rest
from palpate.grasp.result import Outcome
from palpate.grasp.runner import _Hand
from palpate.grasp.safety import SafetyLimits
from palpate.grasp.state import GraspState
from palpate.gripper.interface import GripperCommand, GripperState
from palpate.sensor.array import Frame

PERIOD_S = 1 / 15


def spoil_frames(bench: Any, change: Callable[[np.ndarray], np.ndarray], *, when: Any) -> None:
    """Change the counts of every frame after a condition is first true."""
    spoilt = list[bool]()

    def other(frame: Frame) -> Frame:
        if spoilt or when():
            spoilt.append(True)
            frame = replace(frame, counts=change(frame.counts.copy()))
        return frame

    bench.change_frames(other)


def later(frame: Frame, by_s: float, *, when: bool) -> Frame:
    return replace(frame, time_s=frame.time_s + by_s * when)


def with_counts(where: Any, value: int) -> Callable[[np.ndarray], np.ndarray]:
    def change(counts: np.ndarray) -> np.ndarray:
        counts[where] = value
        return counts

    return change


# -- the sheet -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (with_counts(np.s_[0, 0], 1023), "reads short"),
        (with_counts(np.s_[:], 1023), "reads short"),
        (with_counts(np.s_[3, 1], 1024), "pixel R3 C1 reads 1024"),
        (with_counts(np.s_[3, 1], -1), "pixel R3 C1 reads -1"),
        (lambda counts: counts[:2], "does not fit layout"),
    ],
)
def test_impossible_counts_during_hold_end_the_grasp(
    plan: Plan, bench: Any, change: Callable[[np.ndarray], np.ndarray], message: str
) -> None:
    spoil_frames(bench, change, when=lambda: bench.force_n > 1.0 and bench.clock.now_s() > 15.0)
    bench.grasp_until(Outcome.SENSOR_LOST, plan, hold_s=20.0, words=message)
    assert bench.force_n > 0, "dropping is damage too"
    assert bench.stops == 1


def test_all_counts_saturated_while_closing_opens_the_hand(plan: Plan, bench: Any) -> None:
    """Without a ground wire, the fingers close on an undetected block."""
    bench.n_per_mm = 50.0
    spoil_frames(bench, lambda counts: counts * 0 + 1023, when=lambda: bench.clock.now_s() > 1.0)
    result = bench.grasp(plan)
    assert result.outcome in (Outcome.SENSOR_LOST, Outcome.FORCE_LIMIT)
    assert result.faults
    assert max(bench.forces_n) < 1.0


def test_pixel_loaded_beyond_its_range_is_reported_once(plan: Plan, bench: Any) -> None:
    """One pixel has 30 ohm at rest, and reaches the end of the range at 4.8 N."""

    def with_weak_pixel(frame: Frame) -> Frame:
        counts, ohm = frame.counts.copy(), 30.0 / (1.0 + bench.force_n / 3.0)
        counts[0, 0] = round(1024 * 4700 / (4700 + ohm))
        return replace(frame, counts=counts)

    rest_ohm = plan.rest_ohm.copy()
    rest_ohm[0, 0] = 30.0
    bench.change_frames(with_weak_pixel)
    result = bench.grasp(plan, rest_ohm=rest_ohm, target_force_n=6.0)
    assert result.outcome is Outcome.HELD
    (fault,) = result.faults
    assert "pixel R0 C0 is loaded beyond its measuring range" in fault


def test_single_frame_at_range_end_does_not_change_grasp(plan: Plan, bench: Any) -> None:
    def flickering(frame: Frame) -> Frame:
        counts = frame.counts.copy()
        if frame.sequence % 20 == 0:
            counts[0, 0] = 1023
        return replace(frame, counts=counts)

    bench.change_frames(flickering)
    frames = list[Observation]()
    result = bench.grasp_until(Outcome.HELD, plan, subscribers=[frames.append])
    assert result.frames == len(frames)
    assert result.frames_lost == 0


def test_repeated_frames_end_the_approach(plan: Plan, bench: Any) -> None:
    frozen = list[np.ndarray]()

    def freeze(counts: np.ndarray) -> np.ndarray:
        frozen.append(counts)
        return frozen[0]

    spoil_frames(bench, freeze, when=lambda: bench.width_mm < 66.0)
    bench.grasp_until(Outcome.SENSOR_LOST, plan, words="the board repeats its frames")
    assert 66.0 - 9 * plan.step <= bench.width_mm < 66.0


@pytest.mark.parametrize("factor", [0.1, 0.39, 2.6, 10.0, np.linspace(0.4, 2.2, 8).reshape(4, 2)])
def test_impossible_rest_values_end_the_grasp(plan: Plan, bench: Any, factor: Any) -> None:
    """The calibration belongs to another sheet, or the sheet has drifted by more than is usual."""
    rest_ohm, words = factor * plan.rest_ohm, "run `palpate doctor`"
    bench.grasp_until(Outcome.SENSOR_LOST, plan, rest_ohm=rest_ohm, words=words)
    assert bench.force_n == 0.0
    for drift in (0.41, 2.4):
        assert explain_implausible_rest(drift * plan.rest_ohm, plan=plan) is None


@pytest.mark.parametrize(("steps", "fine"), [(1, True), (40, False)])
def test_noise_that_reads_as_a_contact_ends_the_grasp(
    plan: Plan, bench: Any, steps: int, fine: bool
) -> None:
    """The noise leaves the pixels' mean unchanged, but a force reads only its positive half.

    The sheet is coarse: a small excess is three times the usual force.
    """
    coarse = np.zeros_like(plan.law.mean)
    coarse[0] = np.log(3.0)
    plan = replace(plan, law=replace(plan.law, mean=plan.law.mean + coarse))
    rng = np.random.default_rng(7)

    def noisy(counts: np.ndarray) -> np.ndarray:
        half = steps * rng.standard_normal(counts.size // 2)
        noise = rng.permutation(np.r_[half, -half]).reshape(counts.shape)
        return np.clip(counts + np.rint(noise), 1, 1022)

    spoil_frames(bench, noisy, when=lambda: True)
    result = bench.grasp(plan)
    assert any("noise of the sheet at rest" in fault for fault in result.faults) != fine
    if not fine:
        assert result.outcome is Outcome.SENSOR_LOST
        assert bench.force_n == 0.0


# -- the clock of the frames -----------------------------------------------------------------------


def delayed(bench: Any, frame: Frame) -> Frame:
    """Let time pass between scan and delivery, as with a reader that lags behind."""
    bench.clock.sleep_s(1.0 if frame.sequence > 30 else 0.0)
    return frame


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda _, frame: replace(frame, time_s=math.nan), ""),
        (lambda _, frame: replace(frame, time_s=1e9), ""),
        # The next frame has the same time, or an earlier one.
        (lambda _, frame: later(frame, PERIOD_S, when=frame.sequence == 30), "do not increase"),
        (lambda _, frame: later(frame, 0.1, when=frame.sequence == 30), "do not increase"),
        # Two clocks may differ by at most the limit of a stale frame.
        (lambda _, frame: later(frame, 0.2, when=frame.sequence > 30), None),
        (lambda _, frame: later(frame, 0.4, when=frame.sequence > 30), "in the future"),
        (delayed, "1.00 s old"),
    ],
)
def test_frame_with_an_impossible_or_old_time_ends_the_grasp(
    plan: Plan, bench: Any, change: Callable[[Any, Frame], Frame], message: str | None
) -> None:
    bench.change_frames(lambda frame: change(bench, frame))
    outcome = Outcome.HELD if message is None else Outcome.SENSOR_LOST
    bench.grasp_until(outcome, plan, words=message)
    assert bench.stops == 1


@pytest.mark.parametrize("first_s", [0.001, 1.0])
def test_single_long_interval_does_not_change_stale_limit(
    plan: Plan, bench: Any, first_s: float
) -> None:
    """The limit is five periods of 1/15 s, independent of the first interval."""
    read = bench.read

    def odd(*, timeout_s: float) -> Frame:
        if bench.sequence == 0:
            bench.clock.sleep_s(first_s - PERIOD_S if first_s > PERIOD_S else 0.0)
        frame = read(timeout_s=timeout_s)
        early = frame.sequence == 0 and first_s < PERIOD_S
        return replace(frame, time_s=frame.time_s + (PERIOD_S - first_s) * early)

    bench.read, bench.lost_after_s = odd, 2.5
    bench.grasp_until(Outcome.SENSOR_LOST, plan, words="no frame in 0.33 s")


def test_stale_limit_is_known_from_the_third_interval_on(plan: Plan, bench: Any) -> None:
    bench.lost_after_s = 3.5 * PERIOD_S
    bench.grasp_until(Outcome.SENSOR_LOST, plan, words="no frame in 0.33 s; check the cable")


def test_single_short_interval_does_not_change_stale_limit(plan: Plan, bench: Any) -> None:
    """A late frame precedes one at once and a gap of three periods."""
    read, gap_s = bench.read, [3 * PERIOD_S]

    def bunched(*, timeout_s: float) -> Frame:
        if bench.sequence == 22 and gap_s[0] > 0:
            waited_s = min(gap_s[0], timeout_s)
            gap_s[0] -= waited_s
            bench.clock.sleep_s(waited_s)
            if gap_s[0] > 0:
                raise DeviceTimeoutError("no frame yet")
        frame = read(timeout_s=timeout_s)
        early_s = PERIOD_S - 0.005 if frame.sequence == 22 else 0.0
        return replace(frame, time_s=frame.time_s - early_s)

    bench.read = bunched
    bench.grasp_until(Outcome.HELD, plan)


# -- the gripper -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"width_mm": math.nan}, "reports nan mm"),
        ({"width_mm": 200.0}, "reports 200 mm"),
        ({"current_ma": math.inf}, "a current of inf mA"),
        ({"current_ma": math.nan}, "a current of nan mA"),
    ],
)
def test_impossible_report_after_contact_ends_the_grasp(
    plan: Plan, bench: Any, values: dict[str, float], message: str
) -> None:
    state = bench.state
    bench.state = lambda: replace(
        state(), **({"current_ma": 40.0} | (values if bench.force_n > 1.0 else {}))
    )
    bench.grasp_until(Outcome.GRIPPER_FAULT, plan, words=message)
    assert bench.stops == 1


def test_gripper_overshoot_ends_grasp_at_once(plan: Plan, bench: Any) -> None:
    command = bench.command

    def runaway(wanted: Any) -> Any:
        sent = command(replace(wanted, target=wanted.target - 0.3 * (bench.force_n > 1.0)))
        return replace(sent, target=wanted.target)

    bench.command = runaway
    bench.grasp_until(Outcome.GRIPPER_FAULT, plan, words="moved on to")
    assert bench.clock.now_s() == pytest.approx(bench.commanded_s + PERIOD_S, abs=1e-6)


def test_gripper_overshoot_ends_grasp_between_two_frames(plan: Plan, bench: Any) -> None:
    command, read, left_s = bench.command, bench.read, [PERIOD_S]

    def runaway(wanted: Any) -> Any:
        sent = command(replace(wanted, target=wanted.target - 0.3 * (bench.force_n > 1.0)))
        return replace(sent, target=wanted.target)

    def read_in_time(*, timeout_s: float) -> Frame:
        if timeout_s < left_s[0]:
            bench.clock.sleep_s(timeout_s)
            left_s[0] -= timeout_s
            raise DeviceTimeoutError("no frame yet")
        bench.clock.sleep_s(left_s[0])
        left_s[0] = PERIOD_S
        frame: Frame = read(timeout_s=timeout_s)
        return frame

    bench.command, bench.read = runaway, read_in_time
    bench.grasp_until(Outcome.GRIPPER_FAULT, plan, words="moved on to")
    assert bench.clock.now_s() < bench.commanded_s + PERIOD_S


def test_gripper_closing_too_fast_is_stopped(plan: Plan, bench: Any) -> None:
    """The driver uses another speed unit, and reports the commanded speed."""
    command = bench.command

    def faster(wanted: Any) -> Any:
        command(wanted)
        return wanted

    bench.command = faster
    bench.grasp_until(Outcome.GRIPPER_FAULT, plan, words="check the driver's unit of speed")
    assert bench.force_n == 0.0
    assert bench.stops == 1


def test_gripper_that_does_not_open_is_a_fault(plan: Plan, bench: Any) -> None:
    command = bench.command
    bench.command = lambda wanted: wanted if wanted.target == 74.0 else command(wanted)
    bench.grasp_until(Outcome.GRIPPER_FAULT, plan, words="and the zero position of the gripper")
    assert bench.stops == 1


def test_gripper_without_movement_fails_after_four_commands(plan: Plan, bench: Any) -> None:
    """Each short step alone is within the position error of a loaded servo."""
    sent = list[Any]()
    bench.command = lambda wanted: sent.append(wanted) or wanted
    bench.grasp_until(
        Outcome.GRIPPER_FAULT,
        replace(plan, step=0.2, fine_step=0.2),
        words="did not move after 4 commands",
    )
    assert len(sent) <= 6


@pytest.mark.parametrize(("first_mm", "is_cancelled"), [(2.0, True), (2.0, False), (0.1, False)])
def test_hand_without_movement_fails_unless_its_commands_were_cancelled(
    plan: Plan, bench: Any, first_mm: float, is_cancelled: bool
) -> None:
    """A hand that the force guard stops before it moves is not blocked.

    A first command too small to be seen in the reports must not hide the later ones.
    """
    hand = _Hand(bench, clock=bench.clock, plan=plan)
    reported = plan.gripper.drive_reading(hand.state())
    bench.command = lambda wanted: wanted
    first = GripperCommand(target=reported - first_mm, rate=10.0)
    close = GripperCommand(target=reported - 2.0, rate=10.0)
    stay = GripperCommand(target=reported, rate=60.0)
    blocked = pytest.raises(DeviceError, match="did not move after 4 commands")
    with nullcontext() if is_cancelled else blocked:
        for number in range(6):
            hand.send(close if number else first, now_s=0.5 * number)
            if is_cancelled:
                hand.send(stay, now_s=0.5 * number + PERIOD_S / 16)


def test_gripper_without_movement_still_receives_open_command(plan: Plan, bench: Any) -> None:
    """A release requested after the number of commands that count as blocked."""
    sent, requests, sent_s = list[Any](), Requests(), list[float]()

    def command(wanted: Any) -> Any:
        sent.append(wanted)
        sent_s.append(bench.clock.now_s())
        return wanted

    def ask(_: Observation) -> None:
        if len(sent) == 4 and bench.clock.now_s() > sent_s[-1] + 0.3:
            requests.release.set()

    bench.command = command
    views = {"subscribers": [ask], "requests": requests}
    bench.grasp_until(Outcome.STOPPED, plan, step=0.2, fine_step=0.2, **views)
    assert len(sent) == 5
    assert sent[-1].target == bench.limits.highest


# -- the ceiling -----------------------------------------------------------------------------------


def test_run_grasp_force_above_ceiling_opens_and_reports_fault(plan: Plan, bench: Any) -> None:
    def shove(_: Observation) -> None:
        if bench.force_n > 0:
            bench.size_mm, bench.n_per_mm = 56.0, 50.0

    low = replace(plan, safety=SafetyLimits(force_ceiling_n=3.0))
    bench.grasp_until(Outcome.FORCE_LIMIT, low, subscribers=[shove], words="the limit is 3 N")
    assert bench.width_mm == 74.0


def test_second_alarm_of_the_same_frame_does_not_prevent_the_opening(
    plan: Plan, bench: Any
) -> None:
    """The sheet and the board exceed their ceilings in one frame."""

    def shove(_: Observation) -> None:
        if bench.force_n > 0:
            bench.size_mm, bench.n_per_mm = 56.0, 50.0

    above = list[Frame]()

    def trip(frame: Frame) -> Frame:
        above.extend([frame] * (bench.force_n > 3.0))
        # The sheet's force is confirmed by a second frame.
        return replace(frame, ceiling_tripped=len(above) == 2)

    bench.change_frames(trip)
    low = replace(plan, safety=SafetyLimits(force_ceiling_n=3.0))
    bench.grasp_until(Outcome.FORCE_LIMIT, low, subscribers=[shove], words="the limit is 3 N")
    assert bench.width_mm == 74.0


def test_servo_current_of_a_force_above_the_ceiling_opens_the_hand(plan: Plan, bench: Any) -> None:
    """The sheet shows a small part of the force."""
    gears = GearFriction(mean_ma=40.0, mean_sd_ma=1.0, movement_ma=4.0)
    law, state = CurrentLaw(gears=gears, ma_per_n=16.0, noise_ma=6.0), bench.state

    def report() -> GripperState:
        current_ma = 40.0 + bench.sequence % 2 + 16.0 * 25.0 * (bench.force_n > 1.0)
        return replace(state(), current_ma=current_ma)

    bench.state = report
    bench.grasp_until(Outcome.FORCE_LIMIT, plan, current=law, words="servo's current shows")
    assert bench.width_mm == 74.0


def test_run_grasp_timeout_opens_and_reports_a_fault(plan: Plan, bench: Any) -> None:
    words = "the grasp did not finish within 2.5 s"
    bench.grasp_until(Outcome.TIMED_OUT, plan, longest_s=2.5, hold_s=60.0, words=words)
    assert bench.width_mm == 74.0


def test_hold_longer_than_time_limit_ends_with_held(plan: Plan, bench: Any) -> None:
    bench.grasp_until(Outcome.HELD, plan, longest_s=20.0, hold_s=30.0)
    assert bench.clock.now_s() > 30.0


@pytest.mark.parametrize(
    ("forces_n", "sent", "target_n", "ends"),
    [
        ((1.0, 2.0, 3.0), 21.0, 2.0, True),
        ((1.0, 1.0, 1.0), 21.0, 2.0, False),
        ((1.0, 2.0, 3.0), 20.0, 2.0, False),
        ((1.0, 2.0, 3.0), 21.0, None, False),
    ],
)
def test_closing_hand_above_target_force_stops_at_its_position(
    plan: Plan, forces_n: tuple[float, ...], sent: float, target_n: float | None, ends: bool
) -> None:
    frame_forces = tuple((0.1 * number, force_n) for number, force_n in enumerate(forces_n))
    estimate = ContactEstimate(
        closure=20.0, sent=sent, frame_forces=frame_forces, frames=3, began_s=0.0, now_s=0.2
    )
    state = GraspState(phase=Phase.SQUEEZE, estimate=estimate)
    assert is_closing_too_far(state, replace(plan, target_force_n=target_n)) is ends


def test_loop_stops_a_hand_that_closes_above_the_target_force(plan: Plan, bench: Any) -> None:
    """The force jumps between two frames of one closing movement."""
    controller = GraspController(replace(plan, target_force_n=2.0))
    seen = list[GraspState]()
    bench.grasp(plan, target_force_n=2.0, watchers=[seen.append])
    squeezed = [state for state in seen if state.phase is Phase.SQUEEZE][-1]
    width_mm = bench.limits.highest - squeezed.estimate.closure
    controller.state = squeezed.snapshot()
    controller.state.estimate.sent = squeezed.estimate.closure + 1.0
    bench.width_mm, bench.n_per_mm = width_mm, 8.0
    found = []
    for _ in range(3):
        frame = bench.read(timeout_s=1.0)
        moving = GripperState(time_s=frame.time_s, width_mm=width_mm, moving=True)
        found.append(controller.step(Observation(frame=frame, gripper=moving)))
    assert GripperCommand(target=width_mm, rate=bench.limits.fastest) in found


@pytest.mark.parametrize(("late_s", "done"), [(-0.1, False), (0.1, True)])
def test_incomplete_opening_times_out_three_seconds_after_its_travel(
    plan: Plan, late_s: float, done: bool
) -> None:
    opened_s = 3.0 + plan.gripper.span / plan.gripper.fastest + late_s
    estimate = ContactEstimate(closure=20.0, sent=0.0, now_s=opened_s)
    state = GraspState(phase=Phase.RELEASE, estimate=estimate)
    finish_release(state, plan)
    assert state.has_ended is done


@pytest.mark.parametrize(("left", "done"), [(0.5, True), (0.51, False)])
def test_opening_is_complete_within_half_a_step_of_the_open_hand(
    plan: Plan, left: float, done: bool
) -> None:
    estimate = ContactEstimate(closure=left * plan.step, sent=0.0, now_s=0.5)
    state = GraspState(phase=Phase.RELEASE, estimate=estimate)
    finish_release(state, plan)
    assert state.has_ended is done
