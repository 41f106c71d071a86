"""Bounds of the force from the servo current alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from palpate.estimate.servo_force import WARMTH_SD, CurrentLaw, GearFriction
from palpate.grasp.config import CURRENT, READING
from palpate.grasp.current_monitor import CurrentMonitor
from palpate.grasp.estimator import Touch
from palpate.grasp.plan import Plan
from palpate.grasp.safety import Alarm, Danger
from palpate.grasp.state import ContactEstimate
from palpate.gripper.interface import GripperState

GEARS_MA, MA_PER_N = 40.0, 16.0


@pytest.fixture
def calibrated(plan: Plan) -> Plan:
    gears = GearFriction(mean_ma=GEARS_MA, mean_sd_ma=1.0, movement_ma=4.0)
    return replace(plan, current=CurrentLaw(gears=gears, ma_per_n=MA_PER_N, noise_ma=6.0))


def estimate_of(reading: float, *, closure: float, still: bool) -> ContactEstimate:
    """Return the estimate with a sheet reading, for a resting or moving gripper."""
    percent = -2.0 * reading
    touch = Touch(
        time_s=10.0, finger_percent=(percent, percent), relative_percent=percent, reading=reading
    )
    return ContactEstimate(
        touches=(touch,) if still else (),
        still_since_s=9.0 if still else None,
        now_s=10.0,
        # The sheet of these tests reads twice the force.
        frame_forces=((0.0, 0.5 * reading), (0.1, 0.5 * reading)),
        sent=closure + 1.0,
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
        # Reports of two movements never have one time.
        time_s = at + 1e-3 * closure
        state = GripperState(time_s=time_s, width_mm=74.0 - at, current_ma=current_ma, moving=True)
        estimate = estimate_of(reading, closure=closure, still=False)
        if opening:
            estimate = replace(estimate, sent=0.0)
        found.append(watch.check(state, estimate=estimate))
    stands = GripperState(time_s=0.0, width_mm=73.0 - closure, current_ma=0.0)
    found.append(watch.check(stands, estimate=estimate_of(reading, closure=closure, still=True)))
    return found


def of_force(force_n: float) -> float:
    return GEARS_MA + MA_PER_N * force_n


def test_current_monitor_empty_hand_raises_no_alarm(calibrated: Plan) -> None:
    watch = CurrentMonitor(calibrated)
    rng = np.random.default_rng(1)
    for closure in range(60):
        current_ma = GEARS_MA * float(np.exp(0.1 * rng.standard_normal()))
        assert moved(watch, current_ma, closure=closure) == [None] * 5


def test_current_monitor_moving_above_ceiling_raises_alarm(calibrated: Plan) -> None:
    alarm = moved(CurrentMonitor(calibrated), of_force(22.0), closure=20.0, reading=100.0)[3]
    assert alarm.danger is Danger.FORCE_LIMIT
    assert "the limit is 15 N" in alarm.message


def test_current_monitor_below_ceiling_raises_no_alarm(calibrated: Plan) -> None:
    watch = CurrentMonitor(calibrated)
    assert moved(watch, of_force(14.0), closure=20.0, reading=100.0) == [None] * 5


def test_current_monitor_at_rest_above_ceiling_raises_alarm(calibrated: Plan) -> None:
    state = GripperState(time_s=0.0, width_mm=50.0, current_ma=of_force(22.0))
    alarm = CurrentMonitor(calibrated).check(
        state, estimate=estimate_of(100.0, closure=24.0, still=True)
    )
    assert alarm is None or alarm.danger is Danger.FORCE_LIMIT
    watch = CurrentMonitor(calibrated)
    found = [
        watch.check(state, estimate=estimate_of(100.0, closure=24.0, still=True)) for _ in range(6)
    ]
    assert found[-1].danger is Danger.FORCE_LIMIT


def test_current_monitor_single_high_current_at_rest_raises_no_alarm(
    calibrated: Plan,
) -> None:
    watch, estimate = CurrentMonitor(calibrated), estimate_of(100.0, closure=24.0, still=True)
    currents = [of_force(8.0)] * 3 + [of_force(22.0)]
    states = [GripperState(time_s=0.0, width_mm=50.0, current_ma=ma) for ma in currents]
    assert [watch.check(state, estimate=estimate) for state in states] == [None] * 4


@pytest.mark.parametrize("reading", [0.0, 1.0])
def test_current_monitor_force_not_shown_by_sheet_raises_alarm(
    calibrated: Plan, reading: float
) -> None:
    """An object next to the sheet is detected at once, or after two movements."""
    alarm = moved(CurrentMonitor(calibrated), of_force(6.0), closure=20.0, reading=reading)[-1]
    assert alarm.danger is Danger.UNSEEN_FORCE
    assert "and the sheet at most" in alarm.message


def test_current_monitor_weak_force_raises_alarm_after_two_movements(calibrated: Plan) -> None:
    watch = CurrentMonitor(calibrated)
    assert moved(watch, of_force(2.6), closure=20.0)[-1] is None
    stands = GripperState(time_s=0.0, width_mm=53.0, current_ma=0.0)
    still = estimate_of(0.0, closure=20.0, still=True)
    assert watch.check(stands, estimate=still) is None, "one movement counts once"
    # A movement too short to be reported is not counted.
    assert watch.check(stands, estimate=replace(still, moved_s=9.0)) is None
    assert moved(watch, of_force(2.6), closure=21.0)[-1] is not None


def test_current_monitor_weak_force_in_alternate_movements_raises_no_alarm(
    calibrated: Plan,
) -> None:
    watch = CurrentMonitor(calibrated)
    for closure, force_n in enumerate((0.0, 2.6, 0.0, 2.6)):
        assert moved(watch, of_force(force_n), closure=20.0 + closure)[-1] is None


@pytest.mark.parametrize(("force_n", "reading"), [(6.0, 12.0), (0.0, 0.02)])
def test_current_monitor_force_shown_by_sheet_raises_no_alarm(
    calibrated: Plan, force_n: float, reading: float
) -> None:
    watch = CurrentMonitor(calibrated)
    assert moved(watch, of_force(force_n), closure=20.0, reading=reading) == [None] * 5


def test_current_monitor_opening_movement_is_not_checked(calibrated: Plan) -> None:
    watch = CurrentMonitor(calibrated)
    found = moved(watch, of_force(6.0), closure=20.0, opening=True)
    assert found == [None] * 5


@pytest.mark.parametrize(("step_mm", "is_alarm"), [(0.3, True), (0.0625, False)])
def test_current_monitor_checks_closing_despite_opening_command(
    calibrated: Plan, step_mm: float, is_alarm: bool
) -> None:
    """A change by one step of the reports is not a closing."""
    watch = CurrentMonitor(replace(calibrated, resolution=0.0625))
    found = list[Alarm | None]()
    for part in range(6):
        closure = 20.0 + step_mm * part
        state = GripperState(
            time_s=0.02 * part, width_mm=74.0 - closure, current_ma=of_force(22.0), moving=True
        )
        estimate = replace(estimate_of(100.0, closure=closure, still=False), sent=10.0)
        found.append(watch.check(state, estimate=estimate))
    alarms = [alarm for alarm in found if alarm is not None]
    assert bool(alarms) == is_alarm
    assert not alarms or alarms[0].danger is Danger.FORCE_LIMIT


def test_current_monitor_hand_pushing_at_its_target_raises_alarm(calibrated: Plan) -> None:
    watch, estimate = CurrentMonitor(calibrated), estimate_of(100.0, closure=19.0, still=False)
    pushes = GripperState(time_s=0.0, width_mm=54.0, current_ma=of_force(22.0), moving=True)
    found = [watch.check(pushes, estimate=estimate) for _ in range(4)]
    assert found[-1].danger is Danger.FORCE_LIMIT


def test_current_monitor_reversal_without_stop_discards_closing_current(calibrated: Plan) -> None:
    watch = CurrentMonitor(calibrated)
    for closure, sent, current_ma in ((20.0, 21.0, of_force(6.0)), (19.5, 19.0, -GEARS_MA)):
        state = GripperState(
            time_s=closure, width_mm=74.0 - closure, current_ma=current_ma, moving=True
        )
        estimate = replace(estimate_of(12.0, closure=closure, still=False), sent=sent)
        assert watch.check(state, estimate=estimate) is None
    away = replace(estimate_of(0.0, closure=19.0, still=True), sent=19.0)
    stands = GripperState(time_s=30.0, width_mm=55.0, current_ma=0.0)
    assert watch.check(stands, estimate=away) is None


def test_current_monitor_uncalibrated_compares_with_approach(plan: Plan) -> None:
    watch = CurrentMonitor(plan)
    for closure in range(6):
        assert moved(watch, GEARS_MA + closure, closure=closure) == [None] * 5
    felt = moved(watch, of_force(6.0), closure=6.0, reading=12.0)
    assert felt == [None] * 5
    alarm = moved(watch, of_force(6.0), closure=7.0)[-1]
    assert alarm.danger is Danger.UNSEEN_FORCE
    assert "with an empty hand" in alarm.message


def swept(
    watch: CurrentMonitor,
    current_ma: Callable[[float], float],
    *,
    reading: Callable[[float], float] = lambda closure: 0.0,
    rng: np.random.Generator | None = None,
) -> tuple[float, Alarm | None]:
    """Close by 30 mm at 15 mm/s without pause, at 15 frames/s.

    Returns the closure at which an alarm came, and it.
    """
    rng = np.random.default_rng(5) if rng is None else rng
    estimate = estimate_of(0.0, closure=0.0, still=False)
    for look in range(200):
        time_s, closure = 0.01 * look, 0.15 * look
        if look % 7 == 0:
            estimate = replace(
                estimate_of(reading(closure), closure=closure, still=False),
                now_s=time_s,
                sent=closure + 5.0,
            )
        state = GripperState(
            time_s=time_s,
            width_mm=74.0 - closure,
            current_ma=current_ma(closure) + 3.0 * float(rng.standard_normal()),
            moving=True,
        )
        alarm = watch.check(state, estimate=estimate)
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


def test_current_monitor_uncalibrated_friction_raises_no_alarm(plan: Plan) -> None:
    waves = [
        swept(
            CurrentMonitor(plan),
            lambda at: GEARS_MA * (1.0 + 0.3 * np.sin(at)),
            rng=np.random.default_rng(seed),
        )[1]
        for seed in range(20)
    ]
    assert waves == [None] * 20


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


@pytest.mark.parametrize("known", [True, False])
def test_current_monitor_negative_current_raises_alarm(
    plan: Plan, calibrated: Plan, known: bool
) -> None:
    closure, alarm = swept(CurrentMonitor(calibrated if known else plan), lambda at: -GEARS_MA)
    assert alarm.danger is Danger.GRIPPER_FAULT
    assert "-40 mA while the hand closes; its driver must report closing" in alarm.message
    assert closure < 3.0


@pytest.mark.parametrize(("mean_ma", "is_alarm"), [(0.0, False), (1.0, True)])
def test_current_monitor_negative_current_is_usual_unless_calibrated_friction_is_positive(
    plan: Plan, mean_ma: float, is_alarm: bool
) -> None:
    gears = GearFriction(mean_ma=mean_ma, mean_sd_ma=1.0, movement_ma=4.0)
    law = CurrentLaw(gears=gears, ma_per_n=MA_PER_N, noise_ma=6.0)
    alarm = swept(CurrentMonitor(replace(plan, current=law)), lambda at: -GEARS_MA)[1]
    assert (alarm is not None) == is_alarm


@pytest.mark.parametrize("mean_ma", [-GEARS_MA, 0.0, 0.001])
def test_current_monitor_calibrated_negative_friction_raises_no_alarm(
    plan: Plan, mean_ma: float
) -> None:
    """A spring assists closing, or friction is near zero."""
    gears = GearFriction(mean_ma=mean_ma, mean_sd_ma=1.0, movement_ma=4.0)
    law = CurrentLaw(gears=gears, ma_per_n=MA_PER_N, noise_ma=6.0)
    assert swept(CurrentMonitor(replace(plan, current=law)), lambda at: mean_ma)[1] is None


def test_current_monitor_missing_calibrated_current_raises_alarm(calibrated: Plan) -> None:
    watch = CurrentMonitor(calibrated)
    found = [alarm for closure in range(4) for alarm in moved(watch, np.nan, closure=closure)]
    (alarm,) = set(found) - {None}
    assert alarm.danger is Danger.GRIPPER_FAULT
    assert "reports no current" in alarm.message
    assert found.index(alarm) == 18, "the sixteenth report of a movement"


def test_current_monitor_missing_uncalibrated_current_raises_no_alarm(plan: Plan) -> None:
    watch = CurrentMonitor(plan)
    assert not any(alarm for at in range(9) for alarm in moved(watch, np.nan, closure=at))


def test_current_monitor_missing_current_at_rest_raises_no_alarm(calibrated: Plan) -> None:
    state = GripperState(time_s=0.0, width_mm=50.0)
    watch = CurrentMonitor(calibrated)
    assert watch.check(state, estimate=estimate_of(0.0, closure=24.0, still=True)) is None


def test_current_monitor_constant_current_raises_alarm(calibrated: Plan) -> None:
    watch = CurrentMonitor(calibrated)
    found = [alarm for closure in range(4) for alarm in moved(watch, 0.0, closure=closure)]
    assert found[:18] == [None] * 18
    assert found[18].danger is Danger.GRIPPER_FAULT
    assert "the reading is stuck" in found[18].message


def test_current_monitor_short_opening_discards_old_readings(calibrated: Plan) -> None:
    """The hand has released the object without a report of movement."""
    watch = CurrentMonitor(calibrated)
    touching = [
        GripperState(time_s=0.0, width_mm=54.0 - part, current_ma=of_force(6.0), moving=True)
        for part in (0.0, 0.3, 0.6, 0.9)
    ]
    for state in touching:
        assert watch.check(state, estimate=estimate_of(12.0, closure=20.0, still=False)) is None
    stands = GripperState(time_s=0.0, width_mm=53.0, current_ma=of_force(2.0))
    soon = replace(estimate_of(12.0, closure=21.0, still=True), still_since_s=9.95)
    assert watch.check(stands, estimate=soon) is None
    back = GripperState(time_s=0.0, width_mm=55.0, current_ma=0.0)
    away = replace(estimate_of(0.0, closure=19.0, still=True), sent=19.0, moved_s=9.5)
    assert watch.check(back, estimate=away) is None


def smallest_n(plan: Plan, movements: int) -> float:
    """Return the smallest force with an alarm after these movements, to 0.05 N."""
    for force_n in np.arange(0.0, 8.0, 0.05):
        watch = CurrentMonitor(plan)
        for movement in range(movements):
            alarm = moved(watch, of_force(force_n), closure=20.0 + movement)[-1]
        if alarm is not None:
            return float(force_n)
    raise AssertionError("no force is an alarm")


@pytest.mark.parametrize(("movements", "deviations"), [(1, 4.5), (2, 3.0), (3, 3.0)])
def test_current_monitor_lowest_detected_force_matches_model(
    calibrated: Plan, movements: int, deviations: float
) -> None:
    """Highest gear friction, three readings, cold motor; at most twice the sheet's force."""
    shown_n = float(calibrated.early_law.force_n(0.0, level=calibrated.level).high)
    gears_ma = GEARS_MA * np.exp(deviations * 4.0 / GEARS_MA) + deviations * 6.0 / np.sqrt(3)
    per_n = MA_PER_N * (1.0 + 2.0 * 0.035)
    least_n = (gears_ma + 2.0 * shown_n * per_n - GEARS_MA) / MA_PER_N
    assert smallest_n(calibrated, movements) == pytest.approx(least_n, abs=0.051)


def test_current_monitor_learns_friction_from_two_movements(
    plan: Plan,
) -> None:
    watch = CurrentMonitor(plan)
    for closure in range(1):
        moved(watch, GEARS_MA, closure=closure)
        stands = GripperState(time_s=0.0, width_mm=73.0 - closure, current_ma=0.0)
        for _ in range(5):
            assert (
                watch.check(stands, estimate=estimate_of(0.0, closure=closure, still=True)) is None
            )
    assert moved(watch, of_force(6.0), closure=1.0)[-1] is None, "one movement is not enough"
    fresh = CurrentMonitor(plan)
    for closure in range(2):
        moved(fresh, GEARS_MA, closure=closure)
    assert moved(fresh, of_force(6.0), closure=2.0)[-1] is not None


def test_current_monitor_repeated_report_is_not_stuck(calibrated: Plan) -> None:
    """A recording repeats the same report at every reading of the gripper."""
    watch = CurrentMonitor(calibrated)
    state = GripperState(time_s=1.0, width_mm=50.0, current_ma=GEARS_MA, moving=True)
    estimate = estimate_of(0.0, closure=24.0, still=False)
    assert [watch.check(state, estimate=estimate) for _ in range(40)] == [None] * 40


@pytest.mark.parametrize(("fraction", "is_limit"), [(0.98, False), (1.02, True)])
def test_current_monitor_force_limit_starts_at_proven_ceiling(
    calibrated: Plan, fraction: float, is_limit: bool
) -> None:
    """The limit includes friction, noise, and the larger current of a warm servo."""
    assert calibrated.current is not None
    gears_ma = GEARS_MA * np.exp(CURRENT.repeated_sd * 4.0 / GEARS_MA)
    noise_ma = CURRENT.repeated_sd * 6.0 / np.sqrt(READING.fewest_frames)
    per_n = MA_PER_N * (1.0 + 2.0 * WARMTH_SD)
    proven_n = fraction * calibrated.safety.force_ceiling_n
    found = moved(
        CurrentMonitor(calibrated),
        gears_ma + noise_ma + per_n * proven_n,
        closure=20.0,
        reading=2.0 * proven_n,
    )
    dangers = [alarm.danger for alarm in found if alarm is not None]
    assert (Danger.FORCE_LIMIT in dangers[:4]) == is_limit


@pytest.fixture
def ideal(plan: Plan) -> Plan:
    """A gripper without friction or noise: the current proves the force exactly."""
    gears = GearFriction(mean_ma=0.0, mean_sd_ma=0.0, movement_ma=0.0)
    return replace(plan, current=CurrentLaw(gears=gears, ma_per_n=MA_PER_N, noise_ma=0.0))


@pytest.mark.parametrize(("excess_n", "is_limit"), [(0.0, False), (0.01, True)])
def test_current_monitor_proven_force_at_ceiling_is_allowed(
    ideal: Plan, excess_n: float, is_limit: bool
) -> None:
    per_n = MA_PER_N * (1.0 + 2.0 * WARMTH_SD)
    current_ma = per_n * (ideal.safety.force_ceiling_n + excess_n)
    found = moved(CurrentMonitor(ideal), current_ma, closure=20.0, reading=100.0)
    assert (found[3] is not None) == is_limit


@pytest.mark.parametrize(
    ("excess_n", "still_s", "is_alarm"), [(0.0, 0.3, False), (0.01, 0.3, True), (0.01, 0.29, False)]
)
def test_current_monitor_twice_the_force_of_the_sheet_is_allowed(
    ideal: Plan, excess_n: float, still_s: float, is_alarm: bool
) -> None:
    """The sheet's response is complete 0.3 s after a movement."""
    shown_n = float(ideal.early_law.force_n(2.0, level=ideal.level).high)
    per_n = MA_PER_N * (1.0 + 2.0 * WARMTH_SD)
    current_ma = per_n * (CURRENT.sheet_ratio * shown_n + excess_n)
    stands = GripperState(time_s=0.0, width_mm=54.0, current_ma=current_ma)
    estimate = replace(estimate_of(2.0, closure=20.0, still=True), now_s=still_s, still_since_s=0.0)
    assert (CurrentMonitor(ideal).check(stands, estimate=estimate) is not None) == is_alarm


def closing(
    watch: CurrentMonitor, currents_ma: list[float], *, reading: float = 0.0, lag_s: float = 1.0
) -> list[Alarm | None]:
    """Close without a stop with these currents; frames are this much later than reports."""
    found = list[Alarm | None]()
    for number, current_ma in enumerate(currents_ma):
        time_s = 1.0 + number
        state = GripperState(
            time_s=time_s, width_mm=60.0 - number, current_ma=current_ma, moving=True
        )
        estimate = estimate_of(reading, closure=14.0 + number, still=False)
        found.append(watch.check(state, estimate=replace(estimate, now_s=time_s + lag_s)))
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
