"""Controller with a spring in the gripper: attempts, lift, damage limit, single fingers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.grasp.phases import Activity, Phase
from palpate.grasp.plan import Plan
from palpate.grasp.result import GraspResult, Outcome
from palpate.grasp.state import GraspState
from palpate.object.damage import DamageModel
from palpate.sensor.array import Frame


def names(result: GraspResult) -> list[str]:
    return [moment.name for moment in result.moments if moment.finger is None]


def test_strongest_reading_restarts_after_each_movement(plan: Plan, bench: Any) -> None:
    """The maximum is updated at each frame instead of searched in all readings."""
    bench.size_mm, fallen = 50.0, list[bool]()

    def compare(grasp_state: GraspState) -> None:
        if grasp_state.estimate.touches:
            readings = [touch.sheet_n for touch in grasp_state.estimate.touches]
            assert grasp_state.estimate.strongest_n == max(readings)
            fallen.append(readings[0] > readings[-1])

    bench.grasp_until(Outcome.HELD, plan, watchers=[compare])
    assert any(fallen), "the last reading is not always the strongest"


def test_attempt_without_object_is_repeated_until_contact(plan: Plan, bench: Any) -> None:
    bench.size_mm, entered = 0.0, list[Activity | Phase]()

    def somebody(grasp_state: GraspState) -> None:
        if not entered or entered[-1] is not grasp_state.activity:
            entered.append(grasp_state.activity)
        if grasp_state.activity is Activity.WAIT:
            bench.size_mm = 50.3

    result = bench.grasp(plan, tries=3, watchers=[somebody])
    assert result.outcome is Outcome.HELD
    assert names(result)[0] == "nothing_there"
    closed = [Activity.TOUCH, Activity.SWEEP, Activity.EVALUATE, Activity.TOUCH]
    assert entered[:6] == [*closed, Activity.WAIT, Activity.TOUCH]
    assert abs(result.size_mm.value - 50.3) < 0.3


def test_last_attempt_without_object_ends_with_nothing_there(plan: Plan, bench: Any) -> None:
    bench.size_mm = 0.0
    result = bench.grasp(plan, tries=2, longest_s=300.0)
    assert result.outcome is Outcome.NOTHING_THERE
    assert names(result).count("nothing_there") == 2
    assert (result.force_n, result.peak_force_n) == (None, None)
    assert result.faults == (), "rest values are measured again, from enough frames"
    assert bench.width_mm == 74.0


def test_unconfirmed_touch_is_rejected(plan: Plan, bench: Any) -> None:
    entered = list[Activity | Phase]()

    def taken_away(grasp_state: GraspState) -> None:
        entered.append(grasp_state.activity)
        if grasp_state.activity is Activity.CONFIRM:
            bench.size_mm = 0.0

    # A light touch, whose reading alone is no grip, looked at until only fresh frames count.
    longer = replace(plan, gentle_force_n=8.0, confirm_s=0.5)
    result = bench.grasp(longer, watchers=[taken_away])
    assert Activity.CONFIRM in entered
    assert Phase.SQUEEZE not in entered
    assert result.outcome is Outcome.NOTHING_THERE


def test_grasp_with_insensitive_law_opens_the_hand(plan: Plan, bench: Any) -> None:
    coarse = replace(plan.law, floor_n=12.0)
    result = bench.grasp_until(
        Outcome.FORCE_LIMIT, plan, law=coarse, words="calibrate the force again"
    )
    assert result.force_n is None


@pytest.mark.parametrize("touched", [False, True])
def test_hand_waits_between_attempts_unless_touched(plan: Plan, bench: Any, touched: bool) -> None:
    bench.size_mm, waiting_s = 0.0, list[float]()

    def hand(grasp_state: GraspState) -> None:
        waiting = grasp_state.activity is Activity.WAIT
        if waiting:
            waiting_s.append(grasp_state.estimate.now_s)
        # Touching is squeezing the pads: the spring is in the open hand for a moment.
        bench.size_mm = 76.0 if waiting and touched and grasp_state.estimate.still_s > 0.5 else 0.0

    result = bench.grasp(plan, tries=2, wait_s=6.0, longest_s=300.0, watchers=[hand])
    waited_s = waiting_s[-1] - waiting_s[0]
    assert any(moment.name == "touch" for moment in result.moments) == touched
    assert waited_s < 3.0 if touched else waited_s >= 6.0


def test_grasp_with_lift_force_holds_at_least_that_force(plan: Plan, bench: Any) -> None:
    lifted_at_n = list[float]()

    def arm(grasp_state: GraspState) -> None:
        if grasp_state.phase is Phase.HOLD:
            lifted_at_n.append(bench.force_n)

    result = bench.grasp(plan, target_force_n=3.0, lift_force_n=4.0, watchers=[arm])
    assert result.outcome is Outcome.HELD
    assert result.force_n.low >= 4.0
    assert min(lifted_at_n) >= 4.0


def test_object_too_heavy_for_safe_grip_is_released(plan: Plan, bench: Any) -> None:
    phases, safety = set[Phase](), replace(plan.safety, force_ceiling_n=3.0)
    watchers = [lambda grasp_state: phases.add(grasp_state.phase)]
    result = bench.grasp(plan, lift_force_n=8.0, safety=safety, watchers=watchers)
    assert result.outcome is Outcome.TOO_WEAK
    assert Phase.HOLD not in phases
    assert bench.width_mm == 74.0


def test_damage_limit_below_target_stops_closing(
    plan: Plan, bench: Any, damage: DamageModel
) -> None:
    result = bench.grasp_until(Outcome.HELD, plan, target_force_n=8.0, damage=damage)
    assert "damage_limit" in names(result)
    # 2 N/mm yields near 3 N; without a limit the same hand reaches its target.
    assert 0.5 < max(bench.forces_n) < 3.0
    unlimited = type(bench)()
    unlimited.grasp(plan, target_force_n=8.0)
    assert max(unlimited.forces_n) > 7.0


def test_grasp_reaches_its_target_and_reports_it_before_the_answer(plan: Plan, bench: Any) -> None:
    result = bench.grasp(plan, target_force_n=6.0)
    assert 0.85 * 6.0 < max(bench.forces_n) < 1.1 * 6.0
    at = {moment.name: moment.time_s for moment in result.moments if moment.finger is None}
    assert at["contact"] < at["on_target"] <= at["answer"]
    assert abs(result.force_n.value / 6.0 - 1) < 0.08


def test_push_by_one_finger_is_not_contact(plan: Plan, bench: Any) -> None:
    """The first finger pushes the object for 3 mm before contact of the other."""

    def pushed(frame: Frame) -> Frame:
        # A sheet without any noise would count as stuck.
        frame = replace(frame, counts=np.array(frame.counts) + frame.sequence % 2)
        if bench.force_n == 0 and bench.width_mm < bench.size_mm + 3.0:
            counts = np.array(frame.counts)
            counts[:2] = counts[:2] * 1.1
            return replace(frame, counts=counts)
        return frame

    contact_n = list[float]()

    def watch(grasp_state: GraspState) -> None:
        if "contact" in names(grasp_state.result) and not contact_n:
            contact_n.append(bench.force_n)

    bench.change_frames(pushed)
    result = bench.grasp_until(Outcome.HELD, plan, watchers=[watch])
    assert contact_n[0] > 0
    first = [m for m in result.moments if m.name == "finger_contact"]
    assert first[0].finger == 0
    assert first[0].time_s < first[-1].time_s


def test_unknown_damage_limit_stops_closing(plan: Plan, bench: Any, damage: DamageModel) -> None:
    """Without compliance there is no stiffness: the hand stays after contact."""
    bench.n_per_mm = 0.7
    result = bench.grasp(plan, target_force_n=8.0, damage=damage, compliance=None)
    assert "damage_limit" in names(result)
    touched_n = 0.5 * 0.7 / (1 + 0.7 * 0.2)
    assert max(bench.forces_n) < touched_n + 0.3 + 0.7 / (1 + 0.7 * 0.2)


def test_run_grasp_uses_command_rounded_by_gripper(plan: Plan, bench: Any) -> None:
    """The gripper rounds targets to half a millimetre."""
    command = bench.command
    bench.command = lambda wanted: command(replace(wanted, target=round(2 * wanted.target) / 2))
    sent = list[float]()

    def watch(grasp_state: GraspState) -> None:
        if grasp_state.phase in (Phase.SQUEEZE, Phase.SETTLE):
            sent.append(grasp_state.estimate.sent)

    bench.grasp(plan, target_force_n=4.0, watchers=[watch])
    assert sent
    assert all(2 * closure == round(2 * closure) for closure in sent)


def test_object_that_yields_while_closing_is_released(plan: Plan, bench: Any) -> None:
    """Above 2 N the spring shortens faster than the hand closes."""
    read = type(bench).read
    widest = bench.size_mm

    def yielding(*, timeout_s: float) -> Any:
        closed_mm = widest - bench.width_mm
        bench.size_mm = widest - 1.3 * max(closed_mm - 1.4, 0.0)
        return read(bench, timeout_s=timeout_s)

    bench.read = yielding
    words = "the reading falls while the hand closes"
    bench.grasp_until(Outcome.SENSOR_LOST, plan, target_force_n=6.0, words=words)
    assert bench.width_mm == 74.0
    narrowest_mm = min(command.target for command in bench.commands)
    assert widest - narrowest_mm < 6.0, "it stops closing soon"


@pytest.mark.parametrize(
    ("target_force_n", "shown_n"),
    [(4.0, lambda force_n: 9.0 - force_n), (6.0, lambda force_n: 5.0 - 0.3 * force_n)],
    ids=["more where the hand opens", "a little less at each step"],
)
def test_reading_against_the_movement_opens_the_hand(
    plan: Plan, bench: Any, target_force_n: float, shown_n: Callable[[float], float]
) -> None:
    """Above 3 N the sheet shows a wrong force."""

    def turned(frame: Frame) -> Frame:
        if max(bench.forces_n) < 3.0:
            return frame
        ohm = plan.rest_ohm[0, 0] / (1 + 2 * max(shown_n(bench.force_n), 0.0) / frame.counts.size)
        return replace(frame, counts=np.full_like(frame.counts, 1024 * 4700 / (4700 + ohm)))

    bench.change_frames(turned)
    bench.grasp_until(
        Outcome.SENSOR_LOST,
        replace(plan, target_force_n=target_force_n),
        words="rises while the hand opens" if target_force_n == 4.0 else "falls while the hand",
    )
    assert max(bench.forces_n) < 7.0


@pytest.mark.parametrize(("finger", "from_n"), [(0, 0.0), (1, 1.0), (0, 3.0)])
def test_grip_shown_by_one_finger_only_ends_grasp(
    plan: Plan, bench: Any, finger: int, from_n: float
) -> None:
    def half_dead(frame: Frame) -> Frame:
        if max(bench.forces_n) < from_n:
            return frame
        counts, rows = frame.counts.copy(), frame.counts.shape[0] // 2
        at_rest = 1024 * 4700 / (4700 + plan.rest_ohm[0, 0]) + frame.sequence % 2
        counts[finger * rows : (finger + 1) * rows] = round(at_rest)
        return replace(frame, counts=counts)

    bench.change_frames(half_dead)
    words = f"finger {1 - finger} measures a grip force and the other finger none"
    bench.grasp_until(Outcome.SENSOR_LOST, plan, target_force_n=4.0, words=words)
    assert max(bench.forces_n) < 1.1 * 4.0


def test_hold_with_external_force_above_ceiling_opens_at_once(plan: Plan, bench: Any) -> None:
    read, pressed_s = type(bench).read, list[float]()

    def squeezed(*, timeout_s: float) -> Any:
        if pressed_s:
            bench.size_mm = 66.0
        return read(bench, timeout_s=timeout_s)

    def watch(grasp_state: GraspState) -> None:
        if grasp_state.phase is Phase.HOLD and not pressed_s:
            pressed_s.append(grasp_state.estimate.now_s)

    bench.read = squeezed
    result = bench.grasp_until(
        Outcome.FORCE_LIMIT, plan, hold_s=20.0, watchers=[watch], words="the limit is 15 N"
    )
    opened_s = next(m.time_s for m in result.moments if m.name == "force_limit")
    assert opened_s - pressed_s[0] < 0.5
    assert bench.width_mm == 74.0
