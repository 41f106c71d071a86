"""Faults of sensor and gripper that end a grasp, on a spring."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.errors import DeviceError, DeviceTimeoutError
from palpate.estimate.pixel_law import PixelReading
from palpate.grasp.controller import GraspController, finish_release, is_closing_too_far
from palpate.grasp.estimator import ContactEstimate, Observation
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.requests import Requests
from palpate.grasp.rest import explain_implausible_rest
from palpate.grasp.result import Outcome
from palpate.grasp.runner import _Hand
from palpate.grasp.safety import FORCE_CEILING_N, Alarm, Danger, SafetyLimits
from palpate.grasp.state import GraspState
from palpate.gripper.interface import GripperCommand, GripperLimits, GripperState
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


def spoil_state(bench: Any, **values: float) -> None:
    """Change the reports after contact with the object."""
    state = bench.state

    def other() -> GripperState:
        found = state()
        return replace(found, **values) if bench.force_n > 1.0 else found

    bench.state = other


def held(bench: Any) -> bool:
    return bool(bench.force_n > 1.0 and bench.clock.now_s() > 18.0)


# -- the sheet -------------------------------------------------------------------------------------


@pytest.mark.parametrize("where", [np.s_[0, 0], np.s_[1, :], np.s_[:, 1], np.s_[:2], np.s_[:]])
def test_shorted_pixels_during_hold_end_grasp(plan: Plan, bench: Any, where: Any) -> None:
    def short(counts: np.ndarray) -> np.ndarray:
        counts[where] = 1023
        return counts

    spoil_frames(bench, short, when=lambda: held(bench))
    result = bench.grasp(replace(plan, hold_s=30.0))
    assert result.outcome is Outcome.SENSOR_LOST
    assert "reads short" in result.faults[0]
    assert bench.force_n > 0, "dropping is damage too"


def test_all_counts_saturated_while_closing_opens_the_hand(plan: Plan, bench: Any) -> None:
    """Without a ground wire, the fingers close on an undetected block."""
    bench.n_per_mm = 50.0
    peaks = list[float]()
    spoil_frames(bench, lambda counts: counts * 0 + 1023, when=lambda: bench.clock.now_s() > 1.0)
    result = bench.grasp(plan, subscribers=[lambda _: peaks.append(bench.force_n)])
    assert result.outcome in (Outcome.SENSOR_LOST, Outcome.FORCE_LIMIT)
    assert result.faults
    assert max(peaks) < 1.0


def test_single_frame_at_range_end_does_not_change_grasp(plan: Plan, bench: Any) -> None:

    def flickering(frame: Frame) -> Frame:
        counts = frame.counts.copy()
        if frame.sequence % 20 == 0:
            counts[0, 0] = 1023
        return replace(frame, counts=counts)

    bench.change_frames(flickering)
    frames = list[Observation]()
    result = bench.grasp(plan, subscribers=[frames.append])
    assert result.outcome is Outcome.HELD
    assert result.faults == ()
    assert result.frames == len(frames)
    assert result.frames_lost == 0


@pytest.mark.parametrize("counts", [1024, -1])
def test_impossible_counts_end_the_grasp(plan: Plan, bench: Any, counts: int) -> None:
    def other(frame: np.ndarray) -> np.ndarray:
        frame[3, 1] = counts
        return frame

    spoil_frames(bench, other, when=lambda: held(bench))
    result = bench.grasp(replace(plan, hold_s=30.0))
    assert result.outcome is Outcome.SENSOR_LOST
    assert f"pixel R3 C1 reads {counts}" in result.faults[0]
    assert bench.stops == 1


def test_frames_of_another_shape_end_the_grasp(plan: Plan, bench: Any) -> None:
    spoil_frames(bench, lambda counts: counts[:2], when=lambda: bench.clock.now_s() > 3.0)
    result = bench.grasp(plan)
    assert result.outcome is Outcome.SENSOR_LOST
    assert "does not fit layout" in result.faults[0]


@pytest.mark.parametrize("time_s", [math.nan, math.inf, 1e9])
def test_frames_without_a_finite_time_are_refused(plan: Plan, bench: Any, time_s: float) -> None:
    bench.change_frames(lambda frame: replace(frame, time_s=time_s))
    result = bench.grasp(plan)
    assert result.outcome is Outcome.SENSOR_LOST
    assert bench.stops == 1


def test_repeated_frames_end_the_approach(plan: Plan, bench: Any) -> None:
    frozen = list[np.ndarray]()

    def freeze(counts: np.ndarray) -> np.ndarray:
        frozen.append(counts)
        return frozen[0]

    spoil_frames(bench, freeze, when=lambda: bench.width_mm < 66.0)
    result = bench.grasp(plan)
    assert result.outcome is Outcome.SENSOR_LOST
    assert "the board repeats its frames" in result.faults[0]
    assert 66.0 - 9 * plan.step <= bench.width_mm < 66.0


ABSURD = {
    "a tenth": lambda rest: 0.1 * rest,
    "ten times": lambda rest: 10.0 * rest,
    "inverted": lambda rest: rest * np.linspace(0.4, 2.2, rest.size).reshape(rest.shape),
}


@pytest.mark.parametrize("name", ABSURD)
def test_impossible_rest_values_end_the_grasp(plan: Plan, bench: Any, name: str) -> None:
    """The calibration belongs to another sheet."""
    result = bench.grasp(replace(plan, rest_ohm=ABSURD[name](plan.rest_ohm)))
    assert result.outcome is Outcome.SENSOR_LOST
    assert "run `palpate doctor`" in result.faults[-1]
    assert bench.force_n == 0.0


@pytest.mark.parametrize(
    ("factor", "fine"), [(0.41, True), (2.4, True), (0.39, False), (2.6, False)]
)
def test_rest_values_beyond_plausible_drift_are_rejected(
    plan: Plan, factor: float, fine: bool
) -> None:
    assert (explain_implausible_rest(factor * np.asarray(plan.rest_ohm), plan=plan) is None) == fine


@pytest.mark.parametrize(("steps", "fine"), [(1, True), (40, False)])
def test_noise_that_reads_as_a_contact_ends_the_grasp(
    plan: Plan, bench: Any, steps: int, fine: bool
) -> None:
    """The noise leaves the pixels' mean unchanged, but a root reads only its positive half."""
    plan = replace(plan, reading=PixelReading(exponents=(0.5,), weights=(1.0,), gains=(1.0,) * 8))
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

    bench.read, bench.lost_after_s = odd, 4.0
    result = bench.grasp(plan)
    assert result.outcome is Outcome.SENSOR_LOST
    assert "no frame in 0.33 s" in result.faults[0]


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
    result = bench.grasp(plan)
    assert result.outcome is Outcome.HELD
    assert result.faults == ()


# -- the gripper -----------------------------------------------------------------------------------

IMPOSSIBLE = {
    "no width": ({"width_mm": math.nan}, "reports nan mm"),
    "endless width": ({"width_mm": math.inf}, "reports inf mm"),
    "a width beyond its range": ({"width_mm": 200.0}, "reports 200 mm"),
    "endless current": ({"current_ma": math.inf}, "a current of inf mA"),
}


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_impossible_reports_are_described(plan: Plan, bench: Any, name: str) -> None:
    values, message = IMPOSSIBLE[name]
    spoil_state(bench, **values)
    result = bench.grasp(plan)
    assert result.outcome is Outcome.GRIPPER_FAULT
    assert message in result.faults[0]
    assert bench.stops == 1


def test_current_no_longer_reported_ends_grasp(plan: Plan, bench: Any) -> None:
    state = bench.state
    bench.state = lambda: replace(state(), current_ma=40.0 if bench.force_n < 1.0 else math.nan)
    result = bench.grasp(plan)
    assert result.outcome is Outcome.GRIPPER_FAULT
    assert "a current of nan mA" in result.faults[0]


def test_gripper_overshoot_ends_grasp_at_once(plan: Plan, bench: Any) -> None:
    command = bench.command

    def runaway(wanted: Any) -> Any:
        sent = command(replace(wanted, target=wanted.target - 0.3 * (bench.force_n > 1.0)))
        return replace(sent, target=wanted.target)

    bench.command, sent_s = runaway, list[float]()
    forces = list[float]()

    def watch(_: Observation) -> None:
        forces.append(bench.force_n)
        if bench.force_n > 1.0 and not sent_s:
            sent_s.append(bench.clock.now_s())

    result = bench.grasp(plan, subscribers=[watch])
    assert result.outcome is Outcome.GRIPPER_FAULT
    assert "moved on to" in result.faults[0]
    assert bench.clock.now_s() == pytest.approx(bench.commanded_s + PERIOD_S, abs=1e-6)


def test_gripper_closing_too_fast_is_stopped(plan: Plan, bench: Any) -> None:
    """The driver uses another speed unit, and reports the commanded speed."""
    command = bench.command

    def faster(wanted: Any) -> Any:
        command(wanted)
        return wanted

    bench.command = faster
    result = bench.grasp(plan)
    assert result.outcome is Outcome.GRIPPER_FAULT
    assert "check the driver's unit of speed" in result.faults[0]
    assert bench.force_n == 0.0
    assert bench.stops == 1


def test_gripper_without_movement_fails_after_four_commands(plan: Plan, bench: Any) -> None:
    """Each short step alone is within the position error of a loaded servo."""
    sent = list[Any]()
    bench.command = lambda wanted: sent.append(wanted) or wanted
    result = bench.grasp(replace(plan, step=0.2, fine_step=0.2))
    assert result.outcome is Outcome.GRIPPER_FAULT
    assert "did not move after 4 commands" in result.faults[0]
    assert len(sent) <= 6


@pytest.mark.parametrize(("is_cancelled", "is_refused"), [(True, False), (False, True)])
def test_hand_without_movement_fails_unless_its_commands_were_cancelled(
    plan: Plan, bench: Any, is_cancelled: bool, is_refused: bool
) -> None:
    """A hand that the force guard stops before it moves is not blocked."""
    hand, limits = _Hand(bench, clock=bench.clock, plan=plan), plan.gripper
    state = hand.state()
    reported = limits.drive_reading(state)
    bench.command = lambda wanted: wanted
    close = GripperCommand(target=reported - 2.0, rate=10.0)

    def send_often() -> None:
        for number in range(6):
            hand.send(close, now_s=0.5 * number)
            if is_cancelled:
                hand.send(
                    GripperCommand(target=reported, rate=60.0), now_s=0.5 * number + PERIOD_S / 16
                )

    if is_refused:
        with pytest.raises(DeviceError, match="did not move after 4 commands"):
            send_often()
    else:
        send_often()


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
    result = bench.grasp(
        replace(plan, step=0.2, fine_step=0.2),
        subscribers=[ask],
        requests=requests,
    )
    assert len(sent) == 5
    assert sent[-1].target == bench.limits.highest
    assert result.outcome is Outcome.STOPPED


@pytest.mark.parametrize(("ahead_s", "outcome"), [(0.2, "held"), (0.4, "sensor_lost")])
def test_frames_from_the_future_are_accepted_up_to_stale_limit(
    plan: Plan, bench: Any, ahead_s: float, outcome: str
) -> None:
    """Two clocks may differ by at most the limit of a stale frame."""

    def ahead(frame: Frame) -> Frame:
        late = frame.sequence > 30
        return replace(frame, time_s=frame.time_s + late * ahead_s)

    bench.change_frames(ahead)
    result = bench.grasp(plan)
    assert result.outcome == outcome
    assert outcome == "held" or "in the future" in result.faults[0]


# -- the ceiling -----------------------------------------------------------------------------------


def test_force_ceiling_is_15_newtons() -> None:
    assert FORCE_CEILING_N == 15.0
    assert SafetyLimits().force_ceiling_n == 15.0


@pytest.mark.parametrize(("fraction", "opens"), [(0.99, False), (1.01, True)])
def test_controller_opens_hand_only_above_force_ceiling(
    plan: Plan, bench: Any, fraction: float, opens: bool
) -> None:
    estimate = ContactEstimate(
        rest_ohm=plan.rest_ohm,
        force_n=fraction * plan.safety.force_ceiling_n,
        force_high_n=2 * plan.safety.force_ceiling_n,
    )
    controller = GraspController(plan, GraspState(phase=Phase.HOLD, estimate=estimate))
    observation = Observation(frame=bench.read(timeout_s=1.0), gripper=bench.state())
    command = controller.step(observation)
    assert (controller.state.result.outcome is Outcome.FORCE_LIMIT) == opens
    assert (command is not None) == opens


def test_run_grasp_force_above_ceiling_opens_and_reports_fault(plan: Plan, bench: Any) -> None:
    def shove(_: Observation) -> None:
        if bench.force_n > 0:
            bench.size_mm, bench.n_per_mm = 56.0, 50.0

    low = replace(plan, safety=SafetyLimits(force_ceiling_n=3.0))
    result = bench.grasp(low, subscribers=[shove])
    assert result.outcome is Outcome.FORCE_LIMIT
    assert "the limit is 3 N" in result.faults[-1]
    assert bench.width_mm == 74.0


def test_run_grasp_timeout_opens_and_reports_a_fault(plan: Plan, bench: Any) -> None:
    bench.n_per_mm = 0.01
    result = bench.grasp(replace(plan, longest_s=6.0, hold_s=60.0))
    assert result.outcome is Outcome.TIMED_OUT
    assert result.faults[-1] == "the grasp did not finish within 6 s"
    assert result.moments[-1].name == "timed_out"
    assert bench.width_mm == 74.0


def test_hold_longer_than_time_limit_ends_with_held(plan: Plan, bench: Any) -> None:
    result = bench.grasp(replace(plan, longest_s=20.0, hold_s=30.0))
    assert result.outcome is Outcome.HELD
    assert bench.clock.now_s() > 30.0


@pytest.mark.parametrize(
    ("forces_n", "sent", "target_n", "ends"),
    [
        ((1.0, 2.0, 3.0), 21.0, 2.0, True),
        ((1.0, 1.0, 1.0), 21.0, 2.0, False),
        ((1.0, 2.0, 3.0), 19.0, 2.0, False),
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


def test_stop_during_hold_vents_pressure_driven_fingers(plan: Plan) -> None:
    soft = GripperLimits(drive="pressure", lowest=0.0, highest=50.0, fastest=40.0)
    state = GraspState(phase=Phase.HOLD, estimate=ContactEstimate(closure=20.0, sent=20.0))
    command = GraspController(replace(plan, gripper=soft), state).stop(Alarm(danger=Danger.STOPPED))
    assert command.target == 0.0


@pytest.mark.parametrize(("late_s", "done"), [(-0.1, False), (0.1, True)])
def test_incomplete_opening_times_out_three_seconds_after_its_travel(
    plan: Plan, late_s: float, done: bool
) -> None:
    opened_s = 3.0 + plan.gripper.span / plan.gripper.fastest + late_s
    estimate = ContactEstimate(closure=20.0, sent=0.0, now_s=opened_s)
    state = GraspState(phase=Phase.RELEASE, estimate=estimate)
    finish_release(state, plan)
    assert state.has_ended is done
