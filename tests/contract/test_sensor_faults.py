"""Grasps ended by the sensor, the object or the user, with rigid and soft fingers."""

from __future__ import annotations

import math
import os
import signal
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest
from tests.contract.faulty import (
    FailingArray,
    NoisyLine,
    RecordingGripper,
    replace_first_pixel,
    run_recorded_grasp,
)
from tests.contract.hands import make_object, make_world
from tests.contract.regulator_board import RegulatorBoard
from tests.fixtures import calibrate_once

from palpate.clock import ManualClock
from palpate.grasp.estimator import Observation
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.planning import plan_grasp
from palpate.grasp.result import GraspResult, Outcome
from palpate.grasp.runner import Subscriber, Watcher
from palpate.grasp.state import GraspState
from palpate.recording import load_recording
from palpate.sensor.array import PressureArray
from palpate.sensor.serial_array import SerialArray
from palpate.twin.devices import TwinGripper
from palpate.twin.world import World

PERIOD_S = 1 / 15
#: Detection time of stale frames (five periods), and of a fault in a frame (one period).
STALE_S, NEXT_S = 5 * PERIOD_S, PERIOD_S
#: Time limit for the stop after the detection.
STOP_S = 0.1
OBJECTS = {"rigid": "strawberry", "soft": "tomato"}
#: Initial gap of the rigid fingers, and time to reach this gap before the grasp.
GAP_MM, BEGINS_S = 14.0, 1.0


@dataclass(kw_only=True)
class FaultyGrasp:
    """A grasp with a fault during the hold or before contact."""

    world: World
    array: FailingArray
    hand: RecordingGripper
    row: Row
    injected_s: float = math.nan

    def watch(self, grasp_state: GraspState) -> None:
        now_s = self.world.clock.now_s()
        holds = grasp_state.phase in (Phase.SETTLE, Phase.HOLD)
        held = holds and grasp_state.estimate.still_s > 0.5
        is_due = now_s > BEGINS_S + 1.0 if self.row.early else held
        if is_due and math.isnan(self.injected_s):
            self.injected_s = now_s
            self.row.inject(self)


@dataclass(frozen=True)
class Row:
    """A fault, with the expected outcome, message and detection time."""

    inject: Callable[[FaultyGrasp], object]
    outcome: Outcome
    words: str
    detection_s: float
    early: bool = False
    #: Whether the rigid fingers open; the soft fingers always vent.
    opens: bool = False


def _kill(number: int) -> Callable[[FaultyGrasp], None]:
    return lambda _: os.kill(os.getpid(), number)


def _pixel(counts: int | None) -> Callable[[FaultyGrasp], None]:
    return lambda grasp: setattr(grasp.array, "spoil", replace_first_pixel(counts))


def _fail(attribute: str) -> Callable[[FaultyGrasp], None]:
    return lambda grasp: setattr(grasp.array, attribute, True)


LOST, STOPPED = Outcome.SENSOR_LOST, Outcome.STOPPED
SHORT = "pixel R0 C0 reads short"
ROWS = {
    "frames stop": Row(_fail("silent"), LOST, "no frame in 0.33 s", STALE_S),
    "port vanishes": Row(_fail("gone"), LOST, "vanished", 0.0),
    "pixel open": Row(_pixel(0), LOST, "pixel R0 C0 reads open", 2 * NEXT_S),
    "pixel shorted": Row(_pixel(1023), LOST, SHORT, 2 * NEXT_S),
    "pixel shorted while open": Row(_pixel(1023), LOST, SHORT, 2 * NEXT_S, early=True),
    # Four movements after the fast approach, each with its rest.
    "pixel stuck": Row(_pixel(None), LOST, "pixel R0 C0 reads stuck", 4.5, early=True),
    "object removed": Row(
        lambda grasp: grasp.world.place(None), Outcome.SLIPPED, "", 1.0, opens=True
    ),
    "Ctrl-C": Row(_kill(signal.SIGINT), STOPPED, "", 0.0),
    "SIGTERM": Row(_kill(signal.SIGTERM), STOPPED, "", 0.0),
}


def world_for(kind: str) -> World:
    world, obj = make_world(kind, OBJECTS[kind]), make_object(OBJECTS[kind])
    if kind == "rigid":
        world.drive(obj.size_mm + GAP_MM, rate=60.0)
    world.clock.sleep_s(BEGINS_S)
    return world


@cache
def plan_for(kind: str) -> Plan:
    calibration = calibrate_once(seed=5, level="lab", apart_from=OBJECTS[kind], kind=kind)
    return plan_grasp(calibration, gripper=TwinGripper(make_world(kind)))


def run(
    kind: str,
    world: World,
    path: Path,
    array: PressureArray,
    hand: RecordingGripper,
    *others: Subscriber,
    watchers: Sequence[Watcher] = (),
) -> GraspResult:
    """Run and record a grasp; `others` are subscribed after the recorder."""
    return run_recorded_grasp(
        plan_for(kind), world, array, hand, path, subscribers=others, watchers=watchers
    )


@pytest.mark.slow
@pytest.mark.parametrize("kind", OBJECTS)
@pytest.mark.parametrize("name", ROWS)
def test_grasp_ends_safely_in_time_after_a_sensor_object_or_user_event(
    name: str, kind: str, tmp_path: Path
) -> None:
    row, path, world = ROWS[name], tmp_path / "fault.mcap", world_for(kind)
    hand = RecordingGripper(TwinGripper(world), now_s=world.clock.now_s)
    grasp = FaultyGrasp(world=world, array=FailingArray(world), hand=hand, row=row)
    handlers = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    result = run(kind, world, path, grasp.array, hand, watchers=[grasp.watch])
    assert handlers == [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    limits = hand.limits
    assert result.outcome is row.outcome
    assert row.words in " ".join(result.faults)
    opens = kind == "soft" or row.opens
    open_at = limits.target(0.0)
    first_s = min(
        time_s
        for time_s, sent in grasp.hand.commands
        if time_s >= grasp.injected_s and (sent is None or (sent.target == open_at and opens))
    )
    assert first_s - grasp.injected_s <= row.detection_s + STOP_S
    assert len(load_recording(path).time_s) == result.frames
    world.clock.sleep_s(1.0)
    assert not world.is_moving(world.clock.now_s())
    if opens:
        assert limits.closure(grasp.hand.state()) == pytest.approx(0.0, abs=0.5)
    elif not row.early:
        assert world.force_n(world.clock.now_s()) > 0.0, "the object must not be dropped"


# -- damaged packets ---------------------------------------------------------------------------


@pytest.fixture
def line() -> tuple[World, NoisyLine, SerialArray]:
    """Return a world with rigid fingers, and a sensor board on a noisy line."""
    world = world_for("rigid")
    noisy = NoisyLine(RegulatorBoard(world))
    clock: ManualClock = world.clock
    return world, noisy, SerialArray(noisy, clock=clock, layout=world.layout, rate_hz=15.0)


@pytest.mark.slow
def test_grasp_completes_with_some_damaged_frames_and_counts_them(
    line: tuple[World, NoisyLine, SerialArray], tmp_path: Path
) -> None:
    world, noisy, array = line
    noisy.every = 7
    hand = RecordingGripper(TwinGripper(world), now_s=world.clock.now_s)
    result = run("rigid", world, tmp_path / "line.mcap", array, hand)
    assert result.outcome is Outcome.HELD
    assert result.frames_lost > 10
    assert array.counters.corrupt >= result.frames_lost
    assert result.force_n.value == pytest.approx(world.truth().force_n, rel=0.2)


def test_grasp_with_only_damaged_frames_ends_as_sensor_lost(
    line: tuple[World, NoisyLine, SerialArray], tmp_path: Path
) -> None:
    world, noisy, array = line
    hand, injected_s = RecordingGripper(TwinGripper(world), now_s=world.clock.now_s), list[float]()

    def spoil(_: Observation) -> None:
        if world.force_n(world.clock.now_s()) > 1.0 and not injected_s:
            injected_s.append(world.clock.now_s())
            noisy.every = 1

    path = tmp_path / "line.mcap"
    result = run("rigid", world, path, array, hand, spoil)
    assert result.outcome is Outcome.SENSOR_LOST
    assert world.clock.now_s() - injected_s[0] <= STALE_S + PERIOD_S + STOP_S
    assert world.force_n(world.clock.now_s()) > 0.0
    assert len(load_recording(path).time_s) == result.frames
