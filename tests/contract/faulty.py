"""Sensors that fail on demand, a gripper that records its commands, and recorded grasps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from palpate.errors import DeviceError, DeviceTimeoutError
from palpate.grasp.plan import Plan
from palpate.grasp.result import GraspResult
from palpate.grasp.runner import Subscriber, Watcher, run_grasp
from palpate.gripper.interface import Gripper, GripperCommand, GripperLimits, GripperState
from palpate.recording import RecordingInfo, RecordingWriter
from palpate.rig.recorded import GraspRecorder
from palpate.sensor.array import ArrayLayout, Frame, PressureArray
from palpate.sensor.byte_stream import ByteStream
from palpate.twin.devices import TwinArray
from palpate.twin.world import World

Spoil = Callable[[np.ndarray], np.ndarray]


class FailingArray:
    """The twin's array, which fails if `silent`, `gone` or `spoil` is set."""

    def __init__(self, world: World) -> None:
        self._array, self._clock = TwinArray(world), world.clock
        self.silent = self.gone = False
        self.spoil: Spoil | None = None

    @property
    def layout(self) -> ArrayLayout:
        return self._array.layout

    def read(self, *, timeout_s: float) -> Frame:
        if self.gone:
            raise DeviceError("port /dev/ttyUSB0 vanished; plug it in again")
        if self.silent:
            self._clock.sleep_s(timeout_s)
            raise DeviceTimeoutError(f"no frame in {timeout_s:.2f} s; check the cable")
        frame = self._array.read(timeout_s=timeout_s)
        return frame if self.spoil is None else replace(frame, counts=self.spoil(frame.counts))

    def close(self) -> None:
        self._array.close()


def replace_first_pixel(counts: int | None) -> Spoil:
    """Return a function that fixes the first pixel at `counts`; None is its first reading."""
    stuck = [] if counts is None else [counts]

    def spoil(frame: np.ndarray) -> np.ndarray:
        spoilt = frame.copy()
        if not stuck:
            stuck.append(int(spoilt[0, 0]))
        spoilt[0, 0] = stuck[0]
        return spoilt

    return spoil


class NoisyLine:
    """A byte stream that damages every n-th packet once `every` is set to n."""

    def __init__(self, stream: ByteStream) -> None:
        self._stream, self.name = stream, stream.name
        self._packets = 0
        self.every = 0

    def read_waiting(self) -> bytes:
        data = bytearray(self._stream.read_waiting())
        for index, byte in enumerate(bytes(data)):
            if byte == 0 and index > 2:
                self._packets += 1
                if self.every and self._packets % self.every == 0:
                    # Never a zero, which would end the packet early.
                    data[index - 2] = data[index - 2] % 255 + 1
        return bytes(data)

    def write(self, data: bytes) -> None:
        self._stream.write(data)

    def close(self) -> None:
        self._stream.close()


class RecordingGripper:
    """A gripper that records the time of each command, with `None` for a stop."""

    def __init__(self, gripper: Gripper, *, now_s: Callable[[], float]) -> None:
        self._gripper, self._now_s = gripper, now_s
        self.commands: list[tuple[float, GripperCommand | None]] = []

    @property
    def limits(self) -> GripperLimits:
        return self._gripper.limits

    def state(self) -> GripperState:
        return self._gripper.state()

    def command(self, wanted: GripperCommand) -> GripperCommand:
        self.commands.append((self._now_s(), wanted))
        return self._gripper.command(wanted)

    def stop(self) -> None:
        self.commands.append((self._now_s(), None))
        self._gripper.stop()

    def release(self) -> None:
        self._gripper.release()

    def close(self) -> None:
        self._gripper.close()


def run_recorded_grasp(
    plan: Plan,
    world: World,
    array: PressureArray,
    gripper: Gripper,
    path: Path,
    *,
    subscribers: Sequence[Subscriber] = (),
    watchers: Sequence[Watcher] = (),
) -> GraspResult:
    """Run a grasp and record it to a file; `subscribers` are called after the recorder."""
    with RecordingWriter(path, info=RecordingInfo(layout=world.layout, origin="twin")) as writer:
        return run_grasp(
            plan,
            array=array,
            gripper=gripper,
            clock=world.clock,
            subscribers=[GraspRecorder(writer), *subscribers],
            watchers=watchers,
        )
