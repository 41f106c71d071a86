"""Detection of a late, overshooting, idle or impossible gripper."""

from __future__ import annotations

from dataclasses import replace

import pytest

from palpate.grasp.config import GUARDS
from palpate.grasp.safety import SafetyLimits
from palpate.grasp.tracking_monitor import CommandTracking, SpeedMonitor, find_impossible_value
from palpate.gripper.interface import GripperCommand, GripperLimits, GripperState

WIDTH = GripperLimits(drive="width", lowest=5.0, highest=74.0, fastest=60.0)
PRESSURE = GripperLimits(drive="pressure", lowest=0.0, highest=50.0, fastest=40.0)
SAFETY = SafetyLimits()


def at(limits: GripperLimits, value: float, *, time_s: float = 0.0) -> GripperState:
    if limits.drive == "width":
        return GripperState(time_s=time_s, width_mm=value)
    return GripperState(time_s=time_s, pressure_kpa=value)


def sent(limits: GripperLimits, begin: float, target: float, rate: float = 20.0) -> CommandTracking:
    command = GripperCommand(target=target, rate=rate)
    return CommandTracking.start(
        command, state=at(limits, begin), now_s=1.0, limits=limits, safety=SAFETY
    )


@pytest.mark.parametrize(
    ("limits", "begin", "target", "reported", "now_s", "fault"),
    [
        # The way takes until 1.5 s, and 0.4 s more are allowed.
        (WIDTH, 40.0, 30.0, 40.0, 1.89, None),
        (WIDTH, 40.0, 30.0, 40.0, 1.91, "supply, and the limits of travel stored in it"),
        (WIDTH, 30.0, 40.0, 30.0, 1.91, "supply, and the zero position of the gripper"),
        (WIDTH, 40.0, 30.0, 30.75, 1.91, "check for a blockage"),
        (WIDTH, 40.0, 30.0, 30.5, 1.91, None),
        (PRESSURE, 10.0, 20.0, 10.0, 1.89, None),
        (PRESSURE, 10.0, 20.0, 10.0, 1.91, "check for a blockage"),
        (PRESSURE, 10.0, 20.0, 18.0, 1.91, None),
        (PRESSURE, 10.0, 20.0, 17.5, 1.91, "check for a blockage"),
        # An overshoot is a fault at once.
        (WIDTH, 40.0, 30.0, 29.75, 1.1, None),
        (WIDTH, 40.0, 30.0, 29.5, 1.1, "moved on to"),
        (PRESSURE, 10.0, 20.0, 21.5, 1.1, None),
        (PRESSURE, 10.0, 20.0, 21.75, 1.1, "moved on to"),
        # An opening hand may come from beyond its target.
        (WIDTH, 30.0, 40.0, 29.75, 1.1, None),
        (WIDTH, 30.0, 40.0, 29.5, 1.1, "moved on to"),
    ],
)
def test_command_tracking_late_or_overshooting_hand_is_a_fault(
    limits: GripperLimits,
    begin: float,
    target: float,
    reported: float,
    now_s: float,
    fault: str | None,
) -> None:
    """Allowed are 0.25 mm or 1.5 kPa beyond the target, and 0.5 mm or 2 kPa before it."""
    safety = replace(SAFETY, overshoot_mm=0.25)
    way, state = sent(limits, begin, target), at(limits, reported)
    found = way.find_fault(state, now_s=now_s, limits=limits, safety=safety)
    assert found is None if fault is None else fault in str(found)


def test_command_tracking_stopped_hand_may_coast_by_the_latency() -> None:
    stop = GripperCommand(target=35.0, rate=20.0)
    earlier, state = sent(WIDTH, 40.0, 30.0), at(WIDTH, 35.0)
    options = {"limits": WIDTH, "safety": SAFETY, "earlier": earlier}
    for sending_s in (0.0, 0.03):
        way = CommandTracking.start(stop, state=state, now_s=1.2, sending_s=sending_s, **options)
        assert way.reach == pytest.approx(35.0 - 20.0 * (sending_s + SAFETY.latency_s))


def test_command_tracking_polls_only_width_driven_closing() -> None:
    often_s = SAFETY.overshoot_mm / 20.0
    look = sent(WIDTH, 40.0, 30.0).poll_interval_s
    assert look(now_s=1.2, limits=WIDTH, safety=SAFETY) == pytest.approx(often_s)
    assert look(now_s=1.5 + 1.9 * often_s, limits=WIDTH, safety=SAFETY) is not None
    assert look(now_s=1.5 + 2.0 * often_s, limits=WIDTH, safety=SAFETY) is not None
    assert look(now_s=1.5 + 2.1 * often_s, limits=WIDTH, safety=SAFETY) is None
    for way, limits in ((sent(WIDTH, 30.0, 40.0), WIDTH), (sent(PRESSURE, 10.0, 20.0), PRESSURE)):
        assert way.poll_interval_s(now_s=1.2, limits=limits, safety=SAFETY) is None
    assert sent(WIDTH, 30.0, 30.0).poll_interval_s(now_s=1.0, limits=WIDTH, safety=SAFETY) is None


@pytest.mark.parametrize(
    ("limits", "begin", "target"), [(WIDTH, 40.0, 30.0), (WIDTH, 30.0, 40.0), (PRESSURE, 10, 20)]
)
def test_command_tracking_idle_is_below_a_third_of_expected_travel(
    limits: GripperLimits, begin: float, target: float
) -> None:
    way, direction = sent(limits, begin, target), 1.0 if target > begin else -1.0

    def idle(made: float, now_s: float) -> bool | None:
        return way.is_idle(
            at(limits, begin + direction * made), now_s=now_s, limits=limits, least=0.4
        )

    # By 1.25 s the rate has made 5 mm or kPa.
    assert (idle(1.4, 1.25), idle(1.6, 1.25)) == (True, False)
    assert idle(0.0, 1.005) is None
    # A third of the way is the first distance that counts as moved.
    assert idle(3.0, 9.0) is False
    # Later than the way takes, no more than all of it is expected.
    assert (idle(2.9, 9.0), idle(3.1, 9.0)) == (True, False)


def speeds(
    limits: GripperLimits, moves: list[tuple[float, float, float]], *, every_s: float
) -> list[str]:
    """Return the messages for movements of given rate, true speed and distance.

    Between two of them the hand stands for half a second.
    """
    watch, now_s, closure = SpeedMonitor(limits, safety=SAFETY), 1000.0, 2.0
    found = list[str]()
    for rate, real, length in moves:
        begin, began_s = closure, now_s
        command = GripperCommand(target=limits.target(begin + length), rate=rate)
        state = at(limits, limits.target(begin))
        way = CommandTracking.start(command, state=state, now_s=now_s, limits=limits, safety=SAFETY)
        watch.find_fault(replace(state, time_s=now_s), tracking=None)
        while now_s < began_s + length / rate + 0.5:
            now_s += every_s
            closure = begin + min(real * (now_s - began_s), length)
            fault = watch.find_fault(at(limits, limits.target(closure), time_s=now_s), tracking=way)
            found += [] if fault is None else [fault]
    return found


@pytest.mark.parametrize("limits", [WIDTH, PRESSURE])
@pytest.mark.parametrize("every_s", [0.004, 0.01, 0.067])
@pytest.mark.parametrize("factor", [1.0, 1.4, 3.0, 10.0, 100.0])
def test_speed_monitor_speed_of_more_than_twice_the_commanded_one_is_a_fault(
    limits: GripperLimits, every_s: float, factor: float
) -> None:
    moves = [(20.0, factor * 20.0, 12.0)]
    if factor < 2.0:
        moves += [(4.0, factor * 4.0, 1.0), (35.0, factor * 35.0, 10.0)]
    found = speeds(limits, moves, every_s=every_s)
    assert bool(found) == (factor > 2.0)
    if found:
        assert "was commanded to 20.0" in found[0]
        assert "check the driver's unit of speed" in found[0]


def start(width_mm: float, *, to: float, rate: float, now_s: float = 0.0) -> CommandTracking:
    command = GripperCommand(target=to, rate=rate)
    return CommandTracking.start(
        command, state=at(WIDTH, width_mm), now_s=now_s, limits=WIDTH, safety=SAFETY
    )


def test_speed_monitor_accumulates_overspeed_of_short_commands() -> None:
    """Each command is two frames ahead; the hand arrives before the next command."""
    watch, width_mm, found = SpeedMonitor(WIDTH, safety=SAFETY), 74.0, list[str | None]()
    for frame in range(12):
        now_s = frame / 15
        way = start(width_mm, to=width_mm - 1.3, rate=10.0, now_s=now_s)
        watch.find_fault(at(WIDTH, width_mm, time_s=now_s + 1e-3), tracking=way)
        width_mm -= 1.3
        found.append(watch.find_fault(at(WIDTH, width_mm, time_s=now_s + 1 / 15), tracking=way))
    assert any(found)


def test_speed_monitor_detects_overspeed_of_short_step() -> None:
    assert speeds(WIDTH, [(4.0, 400.0, 1.0)], every_s=0.05)


def test_speed_monitor_allows_latency_after_slower_command() -> None:
    watch, width_mm = SpeedMonitor(WIDTH, safety=SAFETY), 60.0
    fast, slow = (start(60.0, to=20.0, rate=rate) for rate in (60.0, 6.0))
    for step in range(1, 60):
        now_s = 0.005 * step
        way = fast if now_s <= 0.1 else slow
        width_mm -= 0.005 * (60.0 if now_s <= 0.1 + SAFETY.latency_s else 6.0)
        assert watch.find_fault(at(WIDTH, width_mm, time_s=now_s), tracking=way) is None


@pytest.mark.parametrize(
    ("begin", "reports"),
    [
        # A recovered lag, and an opening.
        (40.0, [(0.0, 40.0), (0.001, 39.5), (0.1, 70.0)]),
        # Reports of one time.
        (40.0, [(0.0, 40.0), (0.0, 35.0), (0.0, 30.0)]),
        # A slow movement cancels an earlier lead.
        (60.0, [(0.0, 60.0), (1.0, 53.6), (2.0, 53.6), (3.0, 47.2)]),
    ],
)
def test_speed_monitor_opening_equal_times_and_cancelled_lead_are_no_fault(
    begin: float, reports: list[tuple[float, float]]
) -> None:
    watch, way = SpeedMonitor(WIDTH, safety=SAFETY), sent(WIDTH, begin, 20.0, rate=4.0)
    for time_s, width_mm in reports:
        assert watch.find_fault(at(WIDTH, width_mm, time_s=time_s), tracking=way) is None


def test_speed_monitor_ignores_a_report_of_the_same_time() -> None:
    watch, way = SpeedMonitor(WIDTH, safety=SAFETY), sent(WIDTH, 60.0, 20.0, rate=4.0)
    for width_mm in (60.0, 50.0):
        state = at(WIDTH, width_mm, time_s=1.0)
        assert watch.find_fault(state, tracking=way, asked_s=0.5) is None


def drawing(current_ma: float) -> GripperState:
    return GripperState(time_s=0.0, width_mm=30.0, current_ma=current_ma)


_FAR_MM, _FAR_KPA = (GUARDS.range_fraction * limits.span for limits in (WIDTH, PRESSURE))


@pytest.mark.parametrize(
    ("limits", "state", "message"),
    [
        # The edges of the tolerated range.
        (WIDTH, at(WIDTH, WIDTH.lowest - _FAR_MM), None),
        (WIDTH, at(WIDTH, WIDTH.highest + _FAR_MM), None),
        (PRESSURE, at(PRESSURE, PRESSURE.lowest - _FAR_KPA), None),
        (PRESSURE, at(PRESSURE, PRESSURE.highest + _FAR_KPA), None),
        (WIDTH, at(WIDTH, 74.0 + 7.0), "81 mm"),
        (PRESSURE, at(PRESSURE, 55.1), "55.1 kPa"),
        (WIDTH, drawing(-19_999.0), None),
        (WIDTH, drawing(-20_000.0), "a current of -20000 mA"),
        (WIDTH, drawing(float("nan")), None),
    ],
)
def test_impossible_reports_are_described(
    limits: GripperLimits, state: GripperState, message: str | None
) -> None:
    found = find_impossible_value(state, limits=limits)
    assert found is None if message is None else message in str(found)


@pytest.mark.parametrize(
    ("begin", "target", "later", "is_continued"),
    [
        (40.0, 30.0, 28.0, True),
        (40.0, 30.0, 30.0, True),
        (40.0, 30.0, 30.1, False),
        (30.0, 40.0, 40.0, True),
        (30.0, 40.0, 39.9, False),
    ],
)
def test_command_tracking_later_command_continues_up_to_the_same_target(
    begin: float, target: float, later: float, is_continued: bool
) -> None:
    command = GripperCommand(target=later, rate=20.0)
    assert sent(WIDTH, begin, target).is_continued_by(command) is is_continued


@pytest.mark.parametrize(("travel_mm", "is_idle"), [(0.5, True), (0.49, None)])
def test_command_tracking_smallest_evaluated_travel_is_inclusive(
    travel_mm: float, is_idle: bool | None
) -> None:
    way = sent(WIDTH, 40.0, 40.0 - travel_mm)
    assert way.is_idle(at(WIDTH, 40.0), now_s=9.0, limits=WIDTH, least=0.5) is is_idle


@pytest.mark.parametrize(("limits", "lag"), [(WIDTH, 0.5), (PRESSURE, 2.0)])
@pytest.mark.parametrize(("excess", "is_fault"), [(0.0, False), (0.0625, True)])
def test_speed_monitor_lag_itself_is_no_fault(
    limits: GripperLimits, lag: float, excess: float, is_fault: bool
) -> None:
    """At 4 units/s, 6 and the travel during the latency are allowed in one second."""
    watch = SpeedMonitor(limits, safety=replace(SAFETY, latency_s=0.125))
    way = sent(limits, limits.target(10.0), limits.target(30.0), rate=4.0)
    closed = 10.0 + 6.0 + 0.5 + lag + excess
    assert watch.find_fault(at(limits, limits.target(10.0)), tracking=way) is None
    fault = watch.find_fault(at(limits, limits.target(closed), time_s=1.0), tracking=way)
    assert (fault is not None) == is_fault
