"""The drivers of both servo families with all failures of a servo, alone and during a grasp."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from tests.contract.conftest import MakeServo
from tests.contract.faulty import run_recorded_grasp
from tests.contract.hands import CLOSED_TICK, JAW, REPLY_S, Servo, make_world
from tests.fixtures import calibrate_once

from palpate.calibration import Calibration
from palpate.errors import DeviceError, DeviceNotFoundError, DeviceTimeoutError, InputError
from palpate.grasp.estimator import Observation
from palpate.grasp.paper import Paper
from palpate.grasp.paper_method import use_paper_method
from palpate.grasp.plan import Plan
from palpate.grasp.planning import plan_grasp
from palpate.grasp.result import Outcome
from palpate.grasp.runner import run_grasp
from palpate.gripper import dynamixel as dynamixel_driver
from palpate.gripper import feetech as feetech_driver
from palpate.gripper import sts_series as sts
from palpate.gripper import x_series as x
from palpate.gripper.interface import open_fully
from palpate.gripper.packets import Register
from palpate.recording import load_recording
from palpate.rig import open_rig
from palpate.sensor.byte_stream import SerialStream
from palpate.twin.devices import TwinArray


#: Of DYNAMIXEL servos, 1020 measures its current and 1060 does not; 777 is a Feetech servo.
@pytest.fixture(params=[1020, 777])
def servo(make_servo: MakeServo, request: pytest.FixtureRequest) -> Servo:
    return make_servo(request.param)


def refused(servo: Servo) -> str:
    """Return the message of a servo that is refused, with its torque off."""
    with pytest.raises((DeviceError, InputError)) as raised:
        servo.open()
    assert servo.bus.value(servo.driver.TORQUE) == 0
    assert "\n" not in str(raised.value)
    return str(raised.value)


@pytest.mark.slow
def test_servo_without_a_reply_raises_a_timeout(servo: Servo) -> None:
    gripper = servo.open()
    servo.fall_silent()
    for method in (gripper.state, gripper.stop):
        with pytest.raises(DeviceTimeoutError, match=r"servo \d on /dev/pts/\d+ does not reply"):
            method()


def test_servo_damaged_replies_are_retried(servo: Servo) -> None:
    gripper, servo.bus.damaged_replies = servo.open(), 2
    assert gripper.state().width_mm == pytest.approx(74.0, abs=0.1)
    servo.bus.damaged_replies = 3
    with pytest.raises(DeviceError, match="replies are damaged") as raised:
        gripper.state()
    assert not isinstance(raised.value, DeviceTimeoutError)


def test_servo_on_a_lost_port_raises(servo: Servo) -> None:
    gripper = servo.open()
    servo.bus.unplug()
    with pytest.raises(DeviceError, match="the port is gone"):
        gripper.state()


def test_servo_of_unknown_model_is_refused(servo: Servo) -> None:
    servo.bus.set(sts.MODEL_NUMBER if servo.is_feetech else x.MODEL_NUMBER, 4660)
    assert "model number 4660, which is not supported; use " in refused(servo)


# -- opening ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "wanted"),
    [
        # 300 mA in units of 2.69 or 1 mA, and 40 % of 885.
        (1020, {x.OPERATING_MODE: 5, x.GOAL_CURRENT: 112, x.BUS_WATCHDOG: 10}),
        (1200, {x.OPERATING_MODE: 5, x.GOAL_CURRENT: 300, x.BUS_WATCHDOG: 10}),
        (1060, {x.OPERATING_MODE: 3, x.GOAL_PWM: 354, x.BUS_WATCHDOG: 10}),
        (777, {sts.TORQUE_LIMIT: 200}),
    ],
)
def test_servo_setup_overwrites_the_settings_of_an_earlier_host(
    make_servo: MakeServo, model: int, wanted: dict[Register, int]
) -> None:
    servo, options = make_servo(model), {"torque_limit_percent": 20.0}
    acceleration = sts.ACCELERATION if servo.is_feetech else x.PROFILE_ACCELERATION
    if not servo.is_feetech:
        options = {"current_limit_ma": 300.0, "pwm_limit_percent": 40.0, "watchdog_s": 0.2}
    servo.bus.set(acceleration, 50)
    servo.open(**options)
    wanted = wanted | {acceleration: 0, servo.driver.TORQUE: 1}
    assert {register: servo.bus.value(register) for register in wanted} == wanted
    assert math.isnan(servo.gripper.state().current_ma) == (model == 1060)


_X_SETUP = (x.DRIVE_MODE, x.OPERATING_MODE, x.GOAL_CURRENT, x.PROFILE_ACCELERATION)


@pytest.mark.parametrize(
    ("model", "register"),
    [(1020, register) for register in (*_X_SETUP, x.TORQUE_ENABLE, x.BUS_WATCHDOG)]
    + [(777, register) for register in (sts.TORQUE_LIMIT, sts.ACCELERATION, sts.TORQUE_ENABLE)],
)
def test_servo_setup_raises_if_a_register_does_not_keep_its_value(
    make_servo: MakeServo, model: int, register: Register
) -> None:
    servo = make_servo(model)
    stored = {x.DRIVE_MODE: x.TIME_BASED, x.PROFILE_ACCELERATION: 30}
    for setting, value in ({sts.ACCELERATION: 50} if servo.is_feetech else stored).items():
        servo.bus.set(setting, value)
    servo.bus.failing_registers.add(register)
    with pytest.raises(DeviceError, match=f"at address {register.address} after it was set to"):
        servo.open()
    # The watchdog is set after the torque.
    assert servo.bus.value(servo.driver.TORQUE) == (register is x.BUS_WATCHDOG)


@pytest.mark.parametrize(("model", "error"), [(1020, 100), (1060, 100), (777, 0)])
def test_servo_setup_does_not_move_to_an_old_goal(
    make_servo: MakeServo, model: int, error: int
) -> None:
    """Not even from an end stop beyond the range of the rig file."""
    servo = make_servo(model)
    servo.bus.position_error = error
    servo.bus.set(servo.driver.GOAL, CLOSED_TICK if servo.is_feetech else x.CENTRE_TICK)
    servo.open()
    assert servo.bus.value(servo.driver.GOAL) == servo.bus.value(servo.driver.POSITION)
    servo.wait(1.0)
    assert servo.width_mm == pytest.approx(74.0, abs=0.1)


@pytest.mark.parametrize(
    ("model", "register", "value", "remedy"),
    [
        (model, *row)
        for model in (1020, 1060)
        for row in (
            (x.MIN_POSITION_LIMIT, 2100, "Set it to 1802 or less with DYNAMIXEL Wizard"),
            (x.MAX_POSITION_LIMIT, 2600, "Set it to 2875 or more with DYNAMIXEL Wizard"),
            (x.HOMING_OFFSET, -300, "add homing_offset = -300 to"),
            (x.HOMING_OFFSET, 4096, "Set the register to 0 with DYNAMIXEL Wizard"),
            (x.VELOCITY_LIMIT, 40, "60 mm/s need"),
            (x.DRIVE_MODE, x.REVERSE, "Clear bit 0 of Drive_Mode"),
            (x.DRIVE_MODE, x.REVERSE | x.TIME_BASED, "runs in reverse (DRIVE_MODE 5)"),
        )
    ]
    + [
        (777, sts.MIN_POSITION_LIMIT, 1100, "Set it to 1047 or less"),
        (777, sts.MAX_POSITION_LIMIT, 1600, "Set it to 1726 or more"),
        (777, sts.HOMING_OFFSET, 85, "add homing_offset = 85"),
        (777, sts.HOMING_OFFSET, -1200, "Set the register to 0"),
        (777, sts.PHASE, 8, "Set bit 2 (4)"),
        (777, sts.PHASE, 13, "Set bits 0 (1) and 7 (128) to the same value"),
        (777, sts.PHASE, 140, "Set bits 0 (1) and 7 (128) to the same value"),
        (777, sts.OPERATING_MODE, 3, "is in operating mode 3; set"),
        (777, sts.RESPONSE_LEVEL, 0, "Set it to 1"),
        (777, sts.MAX_TORQUE_LIMIT, 200, "torque_limit_percent 30: must be above 0 and at most 20"),
    ],
)
def test_servo_stored_setting_that_misleads_the_fingers_is_refused(
    make_servo: MakeServo, model: int, register: Register, value: int, remedy: str
) -> None:
    servo = make_servo(model)
    servo.bus.set(register, value)
    message = refused(servo)
    assert f"{register.name} (address {register.address})" in message
    assert remedy in message


@pytest.mark.parametrize(
    ("model", "ticks", "phase", "words"),
    [(1020, ticks, 0, "Present_Position (address 132) is") for ticks in (300, 2048, -2000, 4796)]
    + [
        (777, 4096, 28, "Present_Position (address 56) is 5822, but goals are 0 to 4095"),
        (2825, -4096, 28, "clear bit 4 (16) of Phase (address 18), which is 28"),
        (777, -2048, 28, "is -322, but goals are 0 to 4095"),
        (777, -2048, 12, "outside the fingers' travel of 1000 to 1726"),
        (2825, 300, 12, "is 2026, 26° outside the fingers' travel of 1000 to 1726"),
        (777, -900, 12, "With opens = -1 the jaw would be within: check opens (1) first"),
    ],
)
def test_servo_outside_its_travel_is_refused(
    make_servo: MakeServo, model: int, ticks: int, phase: int, words: str
) -> None:
    servo = make_servo(model)
    if phase:
        servo.bus.set(sts.PHASE, phase)
    servo.bus.position_error = ticks
    message = refused(servo)
    assert words in message
    assert servo.is_feetech or "The horn is mounted at a wrong angle" in message


#: Invalid options of both drivers, of a DYNAMIXEL and of a Feetech servo.
OPTIONS = {
    (1020, 777): [
        ({"port": "/dev/no-such-servo"}, DeviceNotFoundError, "no port .*; `palpate ports`"),
        ({"lowest_mm": 40.0, "highest_mm": 30.0}, InputError, "lowest_mm is the smaller one"),
        ({"servo_id": 3, "reply_s": 0.05}, DeviceTimeoutError, "servo 3"),
        ({"servo_id": 0.5}, InputError, "servo_id 0.5: must be a whole number from 0 to 25[23]"),
        ({"baud": 250}, InputError, "baud 250: must be one of (9600|38400), 57600, 115200"),
        ({"homing_offset": 2_000_000}, InputError, "must be -(1044479 to 1044479|2047 to 2047)"),
    ],
    (1020,): [
        ({"lowest_mm": 3.0}, InputError, "carriages move from 20 to 76 mm"),
        ({"current_limit_ma": 0.0}, InputError, "current_limit_ma 0: must be above 0 and at most"),
        ({"current_limit_ma": 5000.0}, InputError, "at most 3209"),
        ({"watchdog_s": 0.0}, InputError, "watchdog requires 0.02 to 2.54 s"),
    ],
    (1060,): [({"pwm_limit_percent": 101.0}, InputError, "101: must be above 0 and at most 100")],
    (777,): [
        ({"highest_mm": 300.0}, InputError, "the jaw opens from 0 to 140 mm"),
        ({"closed_tick": 4000}, InputError, "remount its horn"),
        ({"torque_limit_percent": 0.0}, InputError, "must be 1 to 100"),
        ({"opens": -1}, DeviceError, "With opens = 1 the jaw would be within"),
    ],
}


@pytest.mark.parametrize(
    ("model", "options", "error", "words"),
    [(model, *row) for models, rows in OPTIONS.items() for row in rows for model in models],
)
def test_open_gripper_with_invalid_options_raises_one_line(
    make_servo: MakeServo, model: int, options: dict[str, Any], error: type[Exception], words: str
) -> None:
    servo, driver = make_servo(model), dynamixel_driver
    given: dict[str, Any] = {"port": servo.bus.name, "reply_s": REPLY_S}
    if servo.is_feetech:
        driver = feetech_driver  # type: ignore[assignment]
        given |= {"jaw_mm": JAW.jaw_mm, "closed_tick": CLOSED_TICK, "highest_mm": 74.0}
    with pytest.raises(error, match=words) as raised:
        driver.open_gripper(**given | options)
    assert "\n" not in str(raised.value)


# -- movements -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "ticks"),
    [(model, ticks) for model in (1020, 1060) for ticks in (-70, -300, -1024, -1800)]
    + [(777, ticks) for ticks in (-80, -300, -700)],
)
def test_servo_at_its_end_stop_before_its_goal_names_the_zero_position(
    make_servo: MakeServo, model: int, ticks: int
) -> None:
    """With open fingers, this shift leaves the position within the travel."""
    servo = make_servo(model)
    servo.bus.position_error = ticks
    gripper = servo.open()
    with pytest.raises(DeviceError, match="are at their end stop") as raised:
        open_fully(gripper, clock=servo.world.clock)
    words = (
        "read closed_tick (1000) again"
        if servo.is_feetech
        else f"at least {-ticks} steps wrong. The horn is mounted at a wrong angle"
    )
    assert words in str(raised.value)
    gripper.stop()


@pytest.mark.parametrize(
    ("model", "options", "low_n", "high_n"),
    [
        # 14 mA per newton, plus or minus friction.
        (1020, {"current_limit_ma": 150.0}, 4.0, 15.0),
        (777, {"torque_limit_percent": 20.0}, 5.0, 12.0),
    ],
)
def test_servo_yields_at_its_limit_without_a_fault(
    make_servo: MakeServo, model: int, options: dict[str, float], low_n: float, high_n: float
) -> None:
    """An object in the way of a closing is no fault."""
    servo = make_servo(model, world=make_world("rigid", "rigid-block"))
    servo.open(**options)
    servo.move(30.0, rate=20.0)
    state = servo.follow(3.0, every_s=0.02)
    assert low_n < servo.force_n < high_n
    assert not state.moving
    if servo.is_feetech:
        open_fully(servo.gripper, clock=servo.world.clock)
        assert servo.gripper.state().width_mm == pytest.approx(74.0, abs=0.1)


#: Errors of both families, and whether they switch the torque of a DYNAMIXEL servo off.
ERRORS = [
    (1020, x.HardwareError.INPUT_VOLTAGE, 1, "supply is at 8.9 V now (9.5 to 16.0 V are allowed)"),
    (1020, x.HardwareError.OVERHEATING, 0, "servo is at 84 °C"),
    (1020, x.HardwareError.OVERLOAD, 0, "load was too large"),
    (1020, x.HardwareError.ELECTRICAL_SHOCK, 0, "short circuit"),
    (1020, x.HardwareError.ENCODER, 1, "position sensor"),
    (1020, x.HardwareError(0x40), 1, "error 0x40"),
]
ERRORS += [
    (777, error, torque, cause)
    for torque in (0, 1)
    for error, cause in (
        (sts.State.VOLTAGE, "supply is at 8.9 V now (4.0 to 8.0 V are allowed)"),
        (sts.State.OVERHEATING, "servo is at 84 °C"),
        (sts.State.OVERCURRENT, "load was too large"),
        (sts.State.OVERLOAD, "load was too large"),
        (sts.State.OVERLOAD | sts.State.OVERHEATING, "protects itself: overheating, overload; "),
        (sts.State.ENCODER, "position sensor"),
        (sts.State(0x10), "error 0x10"),
    )
]


@pytest.mark.parametrize(("model", "error", "torque", "cause"), ERRORS)
def test_servo_error_names_its_cause_and_the_torque(
    make_servo: MakeServo, model: int, error: int, torque: int, cause: str
) -> None:
    servo = make_servo(model)
    servo.open()
    servo.bus.set(servo.driver.VOLTAGE, 89)
    servo.bus.set(servo.driver.TEMPERATURE, 84)
    if servo.is_feetech:
        servo.bus.set(sts.TORQUE_ENABLE, torque)
        servo.bus.state = error
    else:
        servo.bus.fail(error)
    for method in (servo.gripper.state, lambda: servo.move(50.0, rate=5.0)):
        with pytest.raises(DeviceError, match=f"torque is {['off', 'on'][torque]}") as raised:
            method()
        assert cause in str(raised.value)
    message = str(raised.value)
    assert ("V now" in message) == ("V now" in cause)
    assert ("°C" in message) == ("overheating" in message)


# -- in a rig file ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return calibrate_once(seed=5, level="lab", apart_from="strawberry")


@pytest.mark.slow
def test_servo_gripper_is_opened_from_a_rig_file_unless_its_port_is_the_array_s(
    dynamixel: Servo, calibration: Calibration, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The refusal of the port alone would blame another program."""
    calibration.save(tmp_path / "pad.json")
    streams = []

    def open_array(port: str = "") -> TwinArray:
        if port:
            streams.append(SerialStream(port))
        return TwinArray(dynamixel.world)

    monkeypatch.setitem(sys.modules, "my_bench", SimpleNamespace(array=open_array))
    (tmp_path / "link").symlink_to(dynamixel.bus.name)
    path = tmp_path / "rig.toml"
    text = (
        "calibration = 'pad.json'\n[array]\nopen = 'my_bench:array'\n[gripper]\n"
        "open = 'palpate.gripper.dynamixel:open_gripper'\noffset_mm = -4.0\nreply_s = 0.5\n"
        f"port = '{tmp_path / 'link'}'\n"
    )
    path.write_text(text)
    gripper = open_rig(str(path)).gripper
    assert gripper.limits.highest == 70.0
    assert gripper.state().width_mm == pytest.approx(70.0, abs=0.05)
    gripper.close()
    path.write_text(text.replace("[gripper]", f"port = '{dynamixel.bus.name}'\n[gripper]"))
    with pytest.raises(InputError, match=r"\[gripper\] port = .*link' is also that of \[array\]"):
        open_rig(str(path))
    streams[0].close()


# -- in a grasp ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def plan(calibration: Calibration) -> Plan:
    servo = Servo(1020)
    plan = plan_grasp(calibration, gripper=servo.open())
    servo.close()
    return plan


@pytest.mark.slow
@pytest.mark.parametrize(
    # The tolerance of the paper's method is two steps of 1 mm.
    ("model", "method", "error_mm"),
    [(1020, "palpate", 1.0), (1020, "paper", 2.0), (777, "palpate", 1.0)],
)
def test_grasp_with_a_servo_holds_and_measures(
    make_servo: MakeServo, calibration: Calibration, model: int, method: str, error_mm: float
) -> None:
    servo = make_servo(model)
    plan = plan_grasp(calibration, gripper=servo.open())
    if method == "paper":
        plan = use_paper_method(plan, Paper(), calibration=calibration)
    world = servo.world
    result = run_grasp(plan, array=TwinArray(world), gripper=servo.gripper, clock=world.clock)
    truth = world.truth()
    assert (result.outcome, result.faults) == (Outcome.HELD, ())
    assert abs(result.size_mm.value - truth.size_mm) < error_mm
    assert not truth.damaged
    assert servo.gripper.state().width_mm > 73.0
    if method == "paper":
        assert result.settled_percent.value == pytest.approx(truth.settled_percent, rel=0.2)
    elif model == 1020:
        # One interval in ten misses the truth, so that this test checks the error instead.
        assert abs(result.force_n.value - truth.force_n) < 0.2 * truth.force_n


#: Each fault with words of its message, and the time to its detection.
FAULTS: dict[str, tuple[Callable[[Servo], object], str, float]] = {
    "port vanishes": (lambda servo: servo.bus.unplug(), "the port is gone", 0.1),
    "no reply": (Servo.fall_silent, "does not reply", 0.1),
    "wrong CRC": (
        lambda servo: setattr(servo.bus, "damaged_replies", 10**6),
        "replies are damaged",
        0.1,
    ),
    "overload": (lambda servo: servo.bus.fail(x.HardwareError.OVERLOAD), "overload", 0.1),
    # The stop first looks like a contact. It is detected after a half step without movement.
    "no torque": (
        lambda servo: servo.bus.fail(x.HardwareError(0)),
        "without torque: its supply was interrupted",
        0.7 + 2 * 0.55,
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "at_force_n"),
    [(fault, None) for fault in FAULTS]
    + [(fault, 1.0) for fault in FAULTS if fault != "no torque"],
)
def test_grasp_ends_at_once_after_a_servo_fault(
    plan: Plan, dynamixel: Servo, tmp_path: Path, fault: str, at_force_n: float | None
) -> None:
    inject, words, most_s = FAULTS[fault]
    world, gripper, injected_s = dynamixel.world, dynamixel.open(), list[float]()
    at_s = 1.0 if fault == "no torque" else 2.0

    def inject_fault(observation: Observation) -> None:
        now_s = world.clock.now_s()
        is_due = now_s > at_s if at_force_n is None else dynamixel.force_n > at_force_n
        if is_due and not injected_s:
            injected_s.append(now_s)
            inject(dynamixel)

    path = tmp_path / "fault.mcap"
    result = run_recorded_grasp(
        plan, world, TwinArray(world), gripper, path, subscribers=[inject_fault]
    )
    assert result.outcome is Outcome.GRIPPER_FAULT
    assert words in result.faults[0]
    assert world.clock.now_s() - injected_s[0] <= most_s
    assert len(load_recording(path).time_s) == result.frames
    world.clock.sleep_s(1.0)
    assert not dynamixel.is_moving
    if at_force_n is not None:
        assert dynamixel.force_n > 0.0, "the object must not be dropped"
