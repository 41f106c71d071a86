"""A simulated SO-101 in real time: its servo line and its sensor on pseudo-terminals.

Servo 6 moves the twin's fingers around a fruit, servos 1 to 5 move freely. The line is shared: one
port for the gripper, one for the arm. The twin's pads stay parallel, unlike those of an SO-101.
"""

from __future__ import annotations

import json
import math
import os
import select
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from palpate.clock import ManualClock
from palpate.errors import DeviceError, InputError
from palpate.gripper import bus_share
from palpate.gripper import sts_series as sts
from palpate.gripper.fingers import HingedJaw
from palpate.twin.line_end import open_terminal
from palpate.twin.objects import draw_object
from palpate.twin.rig import calibrate_world
from palpate.twin.sts_bus import ArmServo, StsBus
from palpate.twin.world import World

assert sys.platform != "win32", "there are no pseudo-terminals"

#: Seeds of the sheet, of the fruit with all noise, and of the calibration's noise.
_SHEET_SEED, _SEED, _CALIBRATION_SEED = 5, 1, 11
#: Distance from the hinge to the pad, and the twin's range: those of the simulated jaw alone.
_JAW_MM, _LOWEST_MM, _HIGHEST_MM = 70.0, 5.0, 74.0
_CLOSED_TICK = 1000
_ARM = range(1, 6)
#: LeRobot's names of servos 1 to 6.
_MOTORS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
#: Longest wait for a simulated reply.
_REPLY_S = 0.5
#: Scans per second of the sensor's board, and the usual and the longest step of the world.
_RATE_HZ, _STEP_S, _LONGEST_STEP_S = 60.0, 0.002, 0.02
#: Time between lines with the truth.
_SHOW_S = 1.0
_RIG = """\
# SIMULATED: written by `palpate demo so101`, which must be running.
calibration = "calibration.json"

[array]
open = "palpate.sensor.text_lines:open_board"
port = "{sensor}"
layout = "rigid-2x2"

[gripper]
open = "palpate.gripper.feetech:open_gripper"
port = "{hand}"
servo_id = 6
jaw_mm = {jaw_mm}
closed_tick = {closed_tick}
lowest_mm = {lowest_mm}
highest_mm = {highest_mm}
reply_s = {patience_s}      # a busy computer simulates slowly
"""


class SimulatedSo101:
    """A running SO-101 in front of a strawberry.

    Parameters
    ----------
    folder : Path
        Receives ``simulated.toml``, ``calibration.json``, ``lerobot.json`` (the calibration of
        LeRobot's robot with this id) and the ports ``hand``, ``arm``, ``sensor``.

    Attributes
    ----------
    bus : str
        The simulated servo line, which is shared as ``hand`` and ``arm``.
    arm : dict of int to ArmServo
        The arm's servos by their numbers.
    world : World
        The fruit and the fingers.

    Raises
    ------
    InputError
        If the folder has another rig file, or is that of a running demo.
    DeviceNotFoundError
        If the system has no pseudo-terminals.
    """

    def __init__(self, folder: Path) -> None:
        rig = folder / "simulated.toml"
        if rig.exists() and not rig.read_text(encoding="utf-8").startswith(_RIG.splitlines()[0]):
            raise InputError(f"{rig}: is not of this demo and is not overwritten; choose --out DIR")
        names = {name: (folder / name).absolute() for name in ("hand", "arm", "sensor")}
        folder.mkdir(parents=True, exist_ok=True)
        bus_share.check_names(list(names.values()))
        self._sensor, self._sensor_slave, sensor = open_terminal()
        os.set_blocking(self._sensor, False)
        # The device end sees a hang-up until a program opens the port.
        os.close(self._sensor_slave)
        self._poll = select.poll()
        self._poll.register(self._sensor, select.POLLIN)
        clock = ManualClock()
        fruit = draw_object(np.random.default_rng([_SEED, 10]), "strawberry")
        self.world = World(
            fruit, seed=_SEED, sheet_seed=_SHEET_SEED, frame_rate_hz=_RATE_HZ, clock=clock
        )
        self._clock, self._scanned = clock, 0
        self.arm = {number: ArmServo() for number in _ARM}
        jaw = HingedJaw(jaw_mm=_JAW_MM)
        self._servos = StsBus(self.world, jaw=jaw, closed_tick=_CLOSED_TICK, arm=self.arm)
        # The servo holds where it is when its torque is switched on, and has the limits that
        # LeRobot's calibration stores.
        open_tick = _CLOSED_TICK + math.ceil(jaw.angle_rad(_HIGHEST_MM) / sts.RAD_PER_TICK)
        self._servos.set(sts.GOAL_POSITION, open_tick)
        self._servos.set(sts.MIN_POSITION_LIMIT, _CLOSED_TICK)
        self._servos.set(sts.MAX_POSITION_LIMIT, open_tick)
        self.bus = self._servos.name
        self._share = bus_share.SharedBus(self.bus, [names["hand"], names["arm"]], reply_s=_REPLY_S)
        self._link = names["sensor"]
        self._link.unlink(missing_ok=True)
        self._link.symlink_to(sensor)
        empty = World(None, seed=_SHEET_SEED + _CALIBRATION_SEED, sheet_seed=_SHEET_SEED)
        calibration = calibrate_world(
            empty, seed=_SHEET_SEED, apart_from=fruit.name, sensor_id="demo-so101"
        )
        calibration.save(folder / "calibration.json")
        text = _RIG.format(
            **names,
            jaw_mm=_JAW_MM,
            closed_tick=_CLOSED_TICK,
            lowest_mm=_LOWEST_MM,
            highest_mm=_HIGHEST_MM,
            patience_s=2 * _REPLY_S,
        )
        rig.write_text(text, encoding="utf-8")
        ranges = [(0, sts.TICKS - 1)] * len(_ARM) + [(_CLOSED_TICK, open_tick)]
        stored = {
            name: {
                "id": number,
                "drive_mode": 0,
                "homing_offset": 0,
                "range_min": low,
                "range_max": high,
            }
            for number, (name, (low, high)) in enumerate(zip(_MOTORS, ranges, strict=True), start=1)
        }
        (folder / "lerobot.json").write_text(json.dumps(stored, indent=4), encoding="utf-8")

    def run(self, show: Callable[[str], None] = lambda _: None) -> None:
        """Run in real time until an exception, such as `KeyboardInterrupt`.

        `show`: receives a line with the true force each second of a contact, and at its end.
        Raises `DeviceError` if the shared line failed.
        """
        start_s = time.monotonic() - self._clock.now_s()
        shown_s, is_touching = -math.inf, False
        while self._share.failure is None:
            late_s = time.monotonic() - start_s - self._clock.now_s()
            # Short steps, so that the servos answer while the world of a busy computer catches up.
            self._advance(min(late_s, _LONGEST_STEP_S))
            now_s = self._clock.now_s()
            if now_s - shown_s >= _SHOW_S:
                force_n, width_mm = self.truth()
                if force_n > 0 or is_touching:
                    show(f"SIMULATED truth: {force_n:.2f} N, {width_mm:.1f} mm between the pads")
                shown_s, is_touching = now_s, force_n > 0
            time.sleep(_STEP_S if late_s < _LONGEST_STEP_S else 0.0)
        raise DeviceError(f"{self.bus}: {self._share.failure!r}; start the demo again")

    def truth(self) -> tuple[float, float]:
        """Return the true grip force, N, and the distance of the pads, mm."""
        with self._servos.lock:
            now_s = self._clock.now_s()
            return self.world.force_n(now_s), self.world.drive_value(now_s)

    def close(self) -> None:
        """Remove the ports."""
        self._share.close()
        self._servos.close()
        self._link.unlink(missing_ok=True)
        os.close(self._sensor)

    def _advance(self, duration_s: float) -> None:
        with self._servos.lock:
            now_s = self._clock.now_s() + duration_s
            while (due_s := (self._scanned + 1) / _RATE_HZ) <= now_s:
                self._scanned += 1
                self._clock.sleep_s(due_s - self._clock.now_s())
                counts = self.world.scan(due_s)
                self._print(",".join(map(str, counts.ravel().tolist())).encode() + b"\r\n")
            self._clock.sleep_s(now_s - self._clock.now_s())

    def _print(self, line: bytes) -> None:
        """Send a line to the program that has the sensor's port open; else it is lost."""
        if dict(self._poll.poll(0)).get(self._sensor, 0) & select.POLLHUP:
            return
        with suppress(BlockingIOError):
            os.write(self._sensor, line)


@contextmanager
def simulate_so101(folder: Path) -> Iterator[SimulatedSo101]:
    """Open a simulated SO-101, and remove its ports at the end; see `SimulatedSo101`."""
    arm = SimulatedSo101(folder)
    try:
        yield arm
    finally:
        arm.close()
