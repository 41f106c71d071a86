"""Bounds of the force from the servo current alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from palpate.force.servo_force import WARMTH_SD, CurrentLaw, GearFriction
from palpate.grasp.config import CURRENT, READING
from palpate.grasp.current_monitor import CurrentMonitor
from palpate.grasp.estimator import Touch
from palpate.grasp.plan import Plan
from palpate.grasp.safety import Alarm, Danger
from palpate.grasp.state import ContactEstimate
from palpate.gripper.interface import GripperState

GEARS_MA, MA_PER_N = 40.0, 16.0
#: Current of one newton with a warm servo: the force that a current proves.
PROVEN_MA_PER_N = MA_PER_N * (1.0 + 2.0 * WARMTH_SD)


def with_friction(plan: Plan, mean_ma: float, *, scatter: float = 1.0) -> Plan:
    """Return the plan with a current law; without `scatter` a current proves its force exactly."""
    gears = GearFriction(mean_ma=mean_ma, mean_sd_ma=scatter, movement_ma=4.0 * scatter)
    law = CurrentLaw(gears=gears, ma_per_n=MA_PER_N, noise_ma=6.0 * scatter)
    return replace(plan, current=law)


@pytest.fixture
def calibrated(plan: Plan) -> Plan:
    return with_friction(plan, GEARS_MA)


@pytest.fixture
def ideal(plan: Plan) -> Plan:
    return with_friction(plan, 0.0, scatter=0.0)


def estimate_of(reading: float, *, closure: float, still: bool) -> ContactEstimate:
    """Return the estimate with a sheet reading, for a resting or moving gripper."""
    percent = -2.0 * reading
    touch = Touch(
        time_s=10.0,
        finger_percent=(percent, percent),
        relative_percent=percent,
        sheet_n=0.5 * reading,
    )
    return ContactEstimate(
        touches=(touch,) if still else (),
        still_since_s=9.0 if still else None,
        now_s=10.0,
        # The sheet of these tests reads twice the force.
        frame_forces=((0.0, 0.5 * reading), (0.1, 0.5 * reading)),
        sent=closure + 1.0,
    )


def report(closure: float, current_ma: float, *, moving: bool, time_s: float = 0.0) -> GripperState:
    return GripperState(
        time_s=time_s, width_mm=74.0 - closure, current_ma=current_ma, moving=moving
    )


def moved(
    watch: CurrentMonitor,
    current_ma: float,
    *,
    closure: float,
    reading: float = 0.0,
    opening: bool = False,
) -> list[Alarm | None]:
    """Move by 1 mm with a current, then rest without friction current."""
    found = list[Alarm | None]()
    for part in np.linspace(0.0, 1.0, 4):
        at = closure - part if opening else closure + part
        estimate = estimate_of(reading, closure=closure, still=False)
        if opening:
            estimate = replace(estimate, sent=0.0)
        # Reports of two movements never have one time.
        state = report(at, current_ma, moving=True, time_s=at + 1e-3 * closure)
        found.append(watch.check(state, estimate=estimate))
    still = estimate_of(reading, closure=closure, still=True)
    found.append(watch.check(report(closure + 1.0, 0.0, moving=False), estimate=still))
    return found


def of_force(force_n: float) -> float:
    return GEARS_MA + MA_PER_N * force_n


def dangers(found: list[Alarm | None]) -> list[Danger | None]:
    return [alarm and alarm.danger for alarm in found]


def test_current_monitor_empty_hand_raises_no_alarm(calibrated: Plan) -> None:
    watch, rng = CurrentMonitor(calibrated), np.random.default_rng(1)
    for closure in range(60):
        current_ma = GEARS_MA * float(np.exp(0.1 * rng.standard_normal()))
        assert moved(watch, current_ma, closure=closure) == [None] * 5


@pytest.mark.parametrize(
    ("force_n", "reading", "opening", "danger"),
    [
        (22.0, 100.0, False, Danger.FORCE_LIMIT),
        (14.0, 100.0, False, None),
        # An object next to the sheet is detected at once.
        (6.0, 0.0, False, Danger.UNSEEN_FORCE),
        (6.0, 1.0, False, Danger.UNSEEN_FORCE),
        (6.0, 12.0, False, None),
        (0.0, 0.02, False, None),
        (6.0, 0.0, True, None),
    ],
)
def test_current_monitor_movement_above_ceiling_or_force_of_the_sheet_raises_an_alarm(
    calibrated: Plan, force_n: float, reading: float, opening: bool, danger: Danger | None
) -> None:
    watch = CurrentMonitor(calibrated)
    found = moved(watch, of_force(force_n), closure=20.0, reading=reading, opening=opening)
    # The ceiling is exceeded while moving; the sheet is compared after it.
    at = 3 if danger is Danger.FORCE_LIMIT else 4
    assert dangers(found)[at] is danger
    if danger is None:
        assert found == [None] * 5
    elif danger is Danger.FORCE_LIMIT:
        assert "the limit is 15 N" in found[at].message
    else:
        assert "and the sheet at most" in found[at].message


@pytest.mark.parametrize(
    ("forces_n", "moving", "is_alarm"),
    [
        ((22.0,) * 6, False, True),
        ((8.0, 8.0, 8.0, 22.0), False, False),
        # The hand is at its target and pushes.
        ((22.0,) * 4, True, True),
    ],
)
def test_current_monitor_at_rest_raises_an_alarm_above_the_ceiling_but_not_for_one_reading(
    calibrated: Plan, forces_n: tuple[float, ...], moving: bool, is_alarm: bool
) -> None:
    watch = CurrentMonitor(calibrated)
    estimate = estimate_of(100.0, closure=19.0 if moving else 24.0, still=not moving)
    closure = 20.0 if moving else 24.0
    states = [report(closure, of_force(force_n), moving=moving) for force_n in forces_n]
    found = dangers([watch.check(state, estimate=estimate) for state in states])
    assert set(found) <= {None, Danger.FORCE_LIMIT}
    assert (found[-1] is not None) == any(found) == is_alarm


def test_current_monitor_weak_force_raises_an_alarm_after_two_successive_movements(
    calibrated: Plan,
) -> None:
    watch = CurrentMonitor(calibrated)
    for closure, force_n in enumerate((0.0, 2.6, 0.0, 2.6)):
        assert moved(watch, of_force(force_n), closure=17.0 + closure)[-1] is None
    stands, still = report(21.0, 0.0, moving=False), estimate_of(0.0, closure=20.0, still=True)
    assert watch.check(stands, estimate=still) is None, "one movement counts once"
    # A movement too short to be reported is not counted.
    assert watch.check(stands, estimate=replace(still, moved_s=9.0)) is None
    assert moved(watch, of_force(2.6), closure=21.0)[-1] is not None


@pytest.mark.parametrize(
    ("lag_s", "fails_at_s", "is_alarm"),
    [(0.25, 9.0, False), (0.05, 0.5, True), (9.0, 9.0, True)],
    ids=["behind by the lag", "lost in the movement", "never shows"],
)
def test_current_monitor_compares_a_closing_hand_with_the_sheet_after_its_response(
    calibrated: Plan, lag_s: float, fails_at_s: float, is_alarm: bool
) -> None:
    """The force rises by 8 N/s in one movement; the sheet reads twice the force of the past."""
    watch, alarm_s = CurrentMonitor(calibrated), np.inf
    for time_s in np.arange(0.004, 1.2, 0.004).tolist():
        shown_n = 8.0 * max(time_s - lag_s, 0.0) * (time_s < fails_at_s)
        closure = 20.0 + 2.0 * time_s
        estimate = estimate_of(0.0, closure=closure, still=False)
        estimate.last = Touch(
            time_s=time_s, finger_percent=(0.0, 0.0), relative_percent=0.0, sheet_n=shown_n
        )
        current_ma = of_force(8.0 * time_s) + (-1.0) ** round(time_s / 0.004)
        alarm = watch.check(
            report(closure, current_ma, moving=True, time_s=time_s), estimate=estimate
        )
        if alarm is not None:
            assert alarm.danger is Danger.UNSEEN_FORCE
            alarm_s = min(alarm_s, time_s)
    assert (alarm_s < 1.2) == is_alarm
    # The least force that a current certainly shows is about 4 N.
    assert not is_alarm or alarm_s < fails_at_s % 9.0 + 0.95


@pytest.mark.parametrize(("step_mm", "is_alarm"), [(0.3, True), (0.0625, False)])
def test_current_monitor_checks_closing_despite_opening_command(
    calibrated: Plan, step_mm: float, is_alarm: bool
) -> None:
    """A change by one step of the reports is not a closing."""
    watch, found = CurrentMonitor(replace(calibrated, resolution=0.0625)), list[Danger | None]()
    for part in range(6):
        closure = 20.0 + step_mm * part
        estimate = replace(estimate_of(100.0, closure=closure, still=False), sent=10.0)
        state = report(closure, of_force(22.0), moving=True, time_s=0.02 * part)
        found += dangers([watch.check(state, estimate=estimate)])
    assert set(found) - {None} == ({Danger.FORCE_LIMIT} if is_alarm else set())


def test_current_monitor_reversal_without_stop_discards_closing_current(calibrated: Plan) -> None:
    watch = CurrentMonitor(calibrated)
    for closure, sent, current_ma in ((20.0, 21.0, of_force(6.0)), (19.5, 19.0, -GEARS_MA)):
        estimate = replace(estimate_of(12.0, closure=closure, still=False), sent=sent)
        state = report(closure, current_ma, moving=True, time_s=closure)
        assert watch.check(state, estimate=estimate) is None
    away = replace(estimate_of(0.0, closure=19.0, still=True), sent=19.0)
    assert watch.check(report(19.0, 0.0, moving=False, time_s=30.0), estimate=away) is None


def test_current_monitor_short_opening_discards_old_readings(calibrated: Plan) -> None:
    """The hand has released the object without a report of movement."""
    watch, touching = CurrentMonitor(calibrated), estimate_of(12.0, closure=20.0, still=False)
    for part in (0.0, 0.3, 0.6, 0.9):
        state = report(20.0 + part, of_force(6.0), moving=True)
        assert watch.check(state, estimate=touching) is None
    soon = replace(estimate_of(12.0, closure=21.0, still=True), still_since_s=9.95)
    assert watch.check(report(21.0, of_force(2.0), moving=False), estimate=soon) is None
    away = replace(estimate_of(0.0, closure=19.0, still=True), sent=19.0, moved_s=9.5)
    assert watch.check(report(19.0, 0.0, moving=False), estimate=away) is None


def test_current_monitor_uncalibrated_compares_with_two_movements_of_the_approach(
    plan: Plan,
) -> None:
    watch = CurrentMonitor(plan)
    assert moved(watch, GEARS_MA, closure=0.0) == [None] * 5
    still = estimate_of(0.0, closure=0.0, still=True)
    for _ in range(5):
        assert watch.check(report(1.0, 0.0, moving=False), estimate=still) is None
    assert moved(watch, of_force(6.0), closure=1.0) == [None] * 5, "one movement is not enough"
    watch = CurrentMonitor(plan)
    for closure in range(2):
        assert moved(watch, GEARS_MA + closure, closure=closure) == [None] * 5
    assert moved(watch, of_force(6.0), closure=2.0, reading=12.0) == [None] * 5
    alarm = moved(watch, of_force(6.0), closure=3.0)[-1]
    assert alarm.danger is Danger.UNSEEN_FORCE
    assert "with an empty hand" in alarm.message


# -- long movements --------------------------------------------------------------------------------


def swept(
    watch: CurrentMonitor,
    current_ma: Callable[[float], float],
    *,
    reading: Callable[[float], float] = lambda closure: 0.0,
    seed: int = 5,
) -> tuple[float, Alarm | None]:
    """Close by 30 mm at 15 mm/s without pause, at 15 frames/s.

    Returns the closure at which an alarm came, and it.
    """
    rng, estimate = np.random.default_rng(seed), estimate_of(0.0, closure=0.0, still=False)
    for look in range(200):
        time_s, closure = 0.01 * look, 0.15 * look
        if look % 7 == 0:
            estimate = replace(
                estimate_of(reading(closure), closure=closure, still=False),
                now_s=time_s,
                sent=closure + 5.0,
            )
        noisy_ma = current_ma(closure) + 3.0 * float(rng.standard_normal())
        alarm = watch.check(
            report(closure, noisy_ma, moving=True, time_s=time_s), estimate=estimate
        )
        if alarm is not None:
            return closure, alarm
    return closure, None


def test_current_monitor_uncalibrated_rise_in_long_movement_raises_alarm(plan: Plan) -> None:
    """The hand closes without a stop on an object next to the sheet."""
    touch_mm = 12.0
    closure, alarm = swept(
        CurrentMonitor(plan), lambda at: GEARS_MA + MA_PER_N * 4.0 * max(at - touch_mm, 0.0)
    )
    assert alarm.danger is Danger.UNSEEN_FORCE
    assert "with an empty hand, and the sheet shows no force" in alarm.message
    # 60 mA more than the gears take are 3.75 N; four readings and the lag of the sheet on top.
    assert closure - touch_mm < 3.75 / 4.0 + 15.0 * (0.04 + 0.06 + 0.07)


def test_current_monitor_calibrated_ignores_a_rise_within_its_friction(
    plan: Plan, calibrated: Plan
) -> None:
    def rising_ma(at: float) -> float:
        return 5.0 if at < 12.0 else 90.0

    assert swept(CurrentMonitor(plan), rising_ma)[1] is not None
    assert swept(CurrentMonitor(calibrated), rising_ma)[1] is None


def test_current_monitor_uncalibrated_friction_raises_no_alarm(plan: Plan) -> None:
    for seed in range(20):
        waves = swept(
            CurrentMonitor(plan), lambda at: GEARS_MA * (1.0 + 0.3 * np.sin(at)), seed=seed
        )
        assert waves[1] is None


def test_current_monitor_contact_shown_one_frame_later_raises_no_alarm(plan: Plan) -> None:
    def force_n(at: float) -> float:
        return 4.0 * max(at - 12.0, 0.0)

    def stiff_tooth_ma(at: float) -> float:
        return 100.0 if 6.0 < at < 6.6 else 0.0

    alarm = swept(
        CurrentMonitor(plan),
        lambda at: GEARS_MA + MA_PER_N * force_n(at) + stiff_tooth_ma(at),
        reading=lambda at: 2.0 * force_n(at - 0.9),
    )[1]
    assert alarm is None


@pytest.mark.parametrize(
    ("friction_ma", "current_ma", "is_alarm"),
    [
        (None, -GEARS_MA, True),
        (GEARS_MA, -GEARS_MA, True),
        (1.0, -GEARS_MA, True),
        (0.0, -GEARS_MA, False),
        # A spring assists closing, or friction is near zero.
        (-GEARS_MA, -GEARS_MA, False),
        (0.0, 0.0, False),
        (0.001, 0.001, False),
    ],
)
def test_current_monitor_negative_current_raises_an_alarm_unless_the_friction_was_so(
    plan: Plan, friction_ma: float | None, current_ma: float, is_alarm: bool
) -> None:
    known = plan if friction_ma is None else with_friction(plan, friction_ma)
    closure, alarm = swept(CurrentMonitor(known), lambda at: current_ma)
    assert (alarm is not None) == is_alarm
    if alarm is not None:
        assert alarm.danger is Danger.GRIPPER_FAULT
        assert "-40 mA while the hand closes; its driver must report closing" in alarm.message
        assert closure < 3.0


# -- missing and constant currents -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("is_calibrated", "current_ma", "message"),
    [
        (True, np.nan, "reports no current"),
        (False, np.nan, None),
        (True, 0.0, "the reading is stuck"),
    ],
)
def test_current_monitor_missing_or_constant_current_raises_an_alarm_if_calibrated(
    plan: Plan, calibrated: Plan, is_calibrated: bool, current_ma: float, message: str | None
) -> None:
    watch = CurrentMonitor(calibrated if is_calibrated else plan)
    found = [alarm for closure in range(4) for alarm in moved(watch, current_ma, closure=closure)]
    assert found[:18] == [None] * 18
    if message is None:
        assert not any(found)
    else:
        # The sixteenth report of a movement.
        assert found[18].danger is Danger.GRIPPER_FAULT
        assert message in found[18].message


@pytest.mark.parametrize(("current_ma", "moving"), [(np.nan, False), (GEARS_MA, True)])
def test_current_monitor_repeated_or_missing_report_at_rest_is_no_fault(
    calibrated: Plan, current_ma: float, moving: bool
) -> None:
    """A recording repeats the same report at every reading of the gripper."""
    watch, state = CurrentMonitor(calibrated), report(24.0, current_ma, moving=moving, time_s=1.0)
    estimate = estimate_of(0.0, closure=24.0, still=not moving)
    assert [watch.check(state, estimate=estimate) for _ in range(40)] == [None] * 40


# -- limits ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("movements", "deviations"), [(1, 4.5), (2, 3.0), (3, 3.0)])
def test_current_monitor_lowest_detected_force_matches_model(
    calibrated: Plan, movements: int, deviations: float
) -> None:
    """Highest gear friction, three readings, cold motor; at most twice the sheet's force."""
    shown_n = float(calibrated.law.interval_n(0.0, log_sd=0.0)[1])
    gears_ma = GEARS_MA * np.exp(deviations * 4.0 / GEARS_MA) + deviations * 6.0 / np.sqrt(3)
    least_n = (gears_ma + 2.0 * shown_n * MA_PER_N * (1.0 + 2.0 * 0.035) - GEARS_MA) / MA_PER_N
    for excess_n in (-0.02, 0.02):
        watch = CurrentMonitor(calibrated)
        for movement in range(movements):
            alarm = moved(watch, of_force(least_n + excess_n), closure=20.0 + movement)[-1]
        assert (alarm is not None) == (excess_n > 0)


@pytest.mark.parametrize(("fraction", "is_limit"), [(0.98, False), (1.02, True)])
def test_current_monitor_force_limit_starts_at_proven_ceiling(
    calibrated: Plan, fraction: float, is_limit: bool
) -> None:
    """The limit includes friction, noise, and the larger current of a warm servo."""
    gears_ma = GEARS_MA * np.exp(CURRENT.repeated_sd * 4.0 / GEARS_MA)
    noise_ma = CURRENT.repeated_sd * 6.0 / np.sqrt(READING.fewest_frames)
    proven_n = fraction * calibrated.safety.force_ceiling_n
    current_ma = gears_ma + noise_ma + PROVEN_MA_PER_N * proven_n
    found = moved(CurrentMonitor(calibrated), current_ma, closure=20.0, reading=2.0 * proven_n)
    assert (Danger.FORCE_LIMIT in dangers(found)[:4]) == is_limit


@pytest.mark.parametrize(("excess_n", "is_limit"), [(0.0, False), (0.01, True)])
def test_current_monitor_proven_force_at_ceiling_is_allowed(
    ideal: Plan, excess_n: float, is_limit: bool
) -> None:
    current_ma = PROVEN_MA_PER_N * (ideal.safety.force_ceiling_n + excess_n)
    found = moved(CurrentMonitor(ideal), current_ma, closure=20.0, reading=100.0)
    assert (found[3] is not None) == is_limit


@pytest.mark.parametrize(
    ("excess_n", "still_s", "is_alarm"), [(0.0, 0.3, False), (0.01, 0.3, True), (0.01, 0.29, False)]
)
def test_current_monitor_twice_the_force_of_the_sheet_is_allowed(
    ideal: Plan, excess_n: float, still_s: float, is_alarm: bool
) -> None:
    """The sheet's response is complete 0.3 s after a movement."""
    shown_n = float(ideal.law.interval_n(1.0, log_sd=0.0)[1])
    current_ma = PROVEN_MA_PER_N * (CURRENT.sheet_ratio * shown_n + excess_n)
    estimate = replace(estimate_of(2.0, closure=20.0, still=True), now_s=still_s, still_since_s=0.0)
    state = report(20.0, current_ma, moving=False)
    assert (CurrentMonitor(ideal).check(state, estimate=estimate) is not None) == is_alarm


def closing(
    watch: CurrentMonitor, currents_ma: list[float], *, reading: float = 0.0, lag_s: float = 1.0
) -> list[Alarm | None]:
    """Close without a stop with these currents; frames are this much later than reports."""
    found = list[Alarm | None]()
    for number, current_ma in enumerate(currents_ma):
        state = report(14.0 + number, current_ma, moving=True, time_s=1.0 + number)
        estimate = estimate_of(reading, closure=14.0 + number, still=False)
        found.append(watch.check(state, estimate=replace(estimate, now_s=state.time_s + lag_s)))
    return found


@pytest.mark.parametrize(("offset_ma", "is_alarm"), [(0.0, False), (-1.0, True)])
def test_current_monitor_negative_current_at_margin_raises_no_alarm(
    plan: Plan, offset_ma: float, is_alarm: bool
) -> None:
    """Two alternating currents are also not stuck."""
    currents_ma = [-CURRENT.margin_ma + offset_ma + (-1.0) ** number for number in range(16)]
    assert (closing(CurrentMonitor(plan), currents_ma)[-1] is not None) == is_alarm


@pytest.mark.parametrize(
    ("risen_ma", "lag_s", "reading", "is_alarm"),
    [
        (100.0, 1.0, 2.0, False),
        (101.0, 1.0, 2.0, True),
        (101.0, 0.06, 2.0, False),
        (101.0, 1.0, 2.1, False),
    ],
)
def test_current_monitor_uncalibrated_rise_limits_are_inclusive(
    plan: Plan, risen_ma: float, lag_s: float, reading: float, is_alarm: bool
) -> None:
    """Limits: 100 mA, the lag of the sheet, and 1 N on the sheet."""
    currents_ma = [GEARS_MA + (-1.0) ** number for number in range(20)] + [risen_ma] * 3
    found = closing(CurrentMonitor(plan), currents_ma, reading=reading, lag_s=lag_s)
    assert found[:-1] == [None] * 22
    assert (found[-1] is not None) == is_alarm


@pytest.mark.parametrize(("friction_ma", "limit_ma"), [(40.0, 100.0), (-5.0, 20.0)])
@pytest.mark.parametrize(
    ("excess_ma", "reading", "is_alarm"), [(0.0, 0.0, False), (1.0, 0.0, True), (1.0, 1.5, False)]
)
def test_current_monitor_uncalibrated_limit_of_short_movements_is_inclusive(
    plan: Plan,
    friction_ma: float,
    limit_ma: float,
    excess_ma: float,
    reading: float,
    is_alarm: bool,
) -> None:
    """A hint of contact of -3 % explains any rise."""
    watch = CurrentMonitor(plan)
    for closure in range(4):
        moved(watch, friction_ma - closure, closure=closure)
    alarm = moved(watch, limit_ma + excess_ma, closure=4.0, reading=reading)[-1]
    assert (alarm is not None) == is_alarm


def test_current_monitor_uncalibrated_current_proves_no_force(plan: Plan) -> None:
    low = replace(plan, safety=replace(plan.safety, force_ceiling_n=0.5))
    assert moved(CurrentMonitor(low), GEARS_MA, closure=20.0) == [None] * 5
