"""The pneumatic driver with failures of the board, alone and during a grasp."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.contract.faulty import run_recorded_grasp
from tests.contract.hands import make_world, open_board
from tests.contract.regulator_board import RegulatorBoard
from tests.fixtures import calibrate_once

from palpate.errors import DeviceError, DeviceTimeoutError, InputError
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.planning import plan_grasp
from palpate.grasp.result import Outcome
from palpate.grasp.runner import run_grasp
from palpate.grasp.state import GraspState
from palpate.gripper.interface import GripperCommand
from palpate.gripper.pneumatic import PneumaticGripper, open_gripper
from palpate.recording import load_recording
from palpate.sensor.serial_array import SerialArray
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import Truth


@pytest.fixture(scope="module")
def plan() -> Plan:
    calibration = calibrate_once(seed=5, level="lab", apart_from="tomato", kind="soft")
    return plan_grasp(calibration, gripper=TwinGripper(make_world("soft")))


@pytest.fixture
def board() -> RegulatorBoard:
    return RegulatorBoard(make_world("soft", "tomato"))


def follow(array: SerialArray, gripper: PneumaticGripper, duration_s: float) -> None:
    first_s = array.read(timeout_s=1.0).time_s
    while array.read(timeout_s=1.0).time_s < first_s + duration_s:
        gripper.state()


def test_pneumatic_fingers_vent_if_the_host_is_silent(board: RegulatorBoard) -> None:
    world = board.world
    array, gripper = open_board(world, board)
    gripper.command(GripperCommand(target=20.0, rate=60.0))
    follow(array, gripper, 1.0)
    assert board.pressure_kpa == pytest.approx(20.0, abs=0.3)
    world.clock.sleep_s(0.3)
    board.run()
    assert board.pressure_kpa == pytest.approx(20.0, abs=0.3)
    world.clock.sleep_s(0.6)
    board.run()
    assert board.pressure_kpa < 1.0
    with pytest.raises(DeviceError, match=r"vented the fingers: it received nothing for 0\.5 s"):
        follow(array, gripper, 1.0)
    gripper.command(GripperCommand(target=10.0, rate=60.0))
    follow(array, gripper, 1.0)
    assert gripper.state().pressure_kpa == pytest.approx(10.0, abs=0.3)


def test_pneumatic_state_with_a_stale_pressure_raises(board: RegulatorBoard) -> None:
    array, gripper = open_board(board.world, board)
    follow(array, gripper, 0.2)
    board.silence()
    board.world.clock.sleep_s(0.6)
    with pytest.raises(DeviceTimeoutError, match=r"last pressure is 0\.\d+ s old"):
        gripper.state()


def test_pneumatic_state_without_pressure_in_the_frames_raises(board: RegulatorBoard) -> None:
    world = board.world
    array = SerialArray(board, clock=world.clock, layout=world.layout, rate_hz=15.0)
    array.read(timeout_s=1.0)
    gripper = PneumaticGripper(array, clock=world.clock)
    with pytest.raises(DeviceError, match="open the array with pressure = true"):
        gripper.state()


def test_pneumatic_stop_on_an_unplugged_board_raises_and_the_board_vents(
    board: RegulatorBoard,
) -> None:
    array, gripper = open_board(board.world, board)
    gripper.command(GripperCommand(target=20.0, rate=60.0))
    follow(array, gripper, 1.0)
    board.unplug()
    with pytest.raises(DeviceError, match="is gone"):
        gripper.stop()
    gripper.close()
    board.world.clock.sleep_s(1.0)
    with pytest.raises(DeviceError):
        board.run()
    assert board.pressure_kpa < 0.5


def test_open_pneumatic_gripper_with_invalid_options_raises() -> None:
    with pytest.raises(InputError, match="board with a regulator, not TwinArray"):
        open_gripper(array=TwinArray(make_world("soft")))
    board = RegulatorBoard(make_world("soft"))
    array, _ = open_board(board.world, board)
    with pytest.raises(InputError, match="highest_kpa 80"):
        open_gripper(array=array, highest_kpa=80.0)
    assert open_gripper(array=array, highest_kpa=30.0).limits.highest == 30.0


# -- in a grasp ------------------------------------------------------------------------------------


@pytest.mark.slow
def test_grasp_with_the_pneumatic_gripper_holds_the_object(
    plan: Plan, board: RegulatorBoard
) -> None:
    (array, gripper), clock = open_board(board.world, board), board.world.clock
    held: list[Truth] = []

    def record_truth(grasp_state: GraspState) -> None:
        if grasp_state.phase is Phase.HOLD:
            held.append(board.world.truth())

    result = run_grasp(plan, array=array, gripper=gripper, clock=clock, watchers=[record_truth])
    assert (result.outcome, result.faults) == (Outcome.HELD, ())
    assert result.force_n.value > 0.5
    assert result.size_mm is None
    found = result.stiffness_n_per_mm
    assert found.low <= held[-1].stiffness_n_per_mm <= found.high
    assert board.pressure_kpa < 1.0


#: Each fault with its outcome, words of its message, and the time until the fingers vent. Stale
#: frames are detected after 5 periods. A lost supply is detected at the next movement, after its
#: duration and two frames.
FAULTS: dict[str, tuple[Callable[[RegulatorBoard], None], Outcome, str, float]] = {
    "supply lost": (RegulatorBoard.cut_supply, Outcome.GRIPPER_FAULT, "missing supply", 0.7),
    "port vanishes": (RegulatorBoard.unplug, Outcome.GRIPPER_FAULT, "is gone", 0.6),
    "frames stop": (RegulatorBoard.silence, Outcome.SENSOR_LOST, "no frame from", 5 / 15 + 0.1),
    "ctrl-c": (lambda _: os.kill(os.getpid(), signal.SIGINT), Outcome.STOPPED, "", 0.1),
    "sigterm": (lambda _: os.kill(os.getpid(), signal.SIGTERM), Outcome.STOPPED, "", 0.1),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_grasp_ends_and_vents_after_a_fault(
    plan: Plan, board: RegulatorBoard, fault: str, tmp_path: Path
) -> None:
    world, path, injected_s = board.world, tmp_path / "fault.mcap", list[float]()
    inject, outcome, words, most_s = FAULTS[fault]
    array, gripper = open_board(world, board)

    def inject_fault(grasp_state: GraspState) -> None:
        if grasp_state.phase is Phase.SQUEEZE and not injected_s:
            injected_s.append(world.clock.now_s())
            inject(board)

    result = run_recorded_grasp(plan, world, array, gripper, path, watchers=[inject_fault])
    assert len(load_recording(path).time_s) == result.frames
    assert result.outcome is outcome
    assert words in " ".join(result.faults)
    assert board.vented_s - injected_s[0] <= most_s
