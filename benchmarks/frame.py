"""Processing time of a frame, from its bytes to the next command (simulated).

    python benchmarks/frame.py --rate 250

Every frame of the twin is encoded like the firmware's and decoded from its bytes. The runner then
does the work of a grasp: resistance, force with interval, monitors, controller. The time of the
twin's physics is measured separately.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from palpate.grasp.planning import plan_grasp
from palpate.grasp.runner import run_grasp
from palpate.gripper.interface import GripperCommand, GripperState
from palpate.sensor.array import Frame
from palpate.sensor.wire import Decoder
from palpate.sensor.wire_messages import FrameMessage
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import draw_object
from palpate.twin.rig import calibrate_twin
from palpate.twin.world import World
from palpate_studies.board_bytes import encode_message

LEVEL, SEED = "field", 5


class Stopwatch:
    """Processor time inside the twin, and outside of it per frame."""

    def __init__(self) -> None:
        self.twin_s = 0.0
        self.palpate_s: list[float] = []
        self._since_s = time.process_time()
        self._in_twin_s = 0.0

    def time_twin(self, act: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
        started_s = time.process_time()
        try:
            return act(*arguments, **named)
        finally:
            taken_s = time.process_time() - started_s
            self.twin_s += taken_s
            self._in_twin_s += taken_s

    def frame(self) -> None:
        """End the time of one frame."""
        now_s = time.process_time()
        self.palpate_s.append(now_s - self._since_s - self._in_twin_s)
        self._since_s, self._in_twin_s = now_s, 0.0


class DecodedArray:
    """The twin's array, with frames decoded from the bytes of the firmware."""

    def __init__(self, array: TwinArray, watch: Stopwatch) -> None:
        self._array, self._watch, self._decoder = array, watch, Decoder()
        self.layout, self._sequence = array.layout, 0

    def read(self, *, timeout_s: float) -> Frame:
        self._watch.frame()
        frame, data = self._watch.time_twin(self._read_packed, timeout_s)
        [message] = self._decoder.feed(data)
        return Frame(
            time_s=frame.time_s,
            sequence=message.sequence,
            counts=message.counts,
            oversampling=message.oversampling,
        )

    def _read_packed(self, timeout_s: float) -> tuple[Frame, bytes]:
        frame = self._array.read(timeout_s=timeout_s)
        self._sequence += 1
        message = FrameMessage(
            sequence=self._sequence,
            time_us=int(1e6 * frame.time_s),
            stream=1,
            oversampling=frame.oversampling,
            status=0,
            counts=frame.counts,
        )
        return frame, encode_message(message)

    def close(self) -> None:
        self._array.close()


class TimedGripper:
    """The twin's gripper, with its time measured separately."""

    def __init__(self, gripper: TwinGripper, watch: Stopwatch) -> None:
        self._gripper, self._watch, self.limits = gripper, watch, gripper.limits

    def state(self) -> GripperState:
        return self._watch.time_twin(self._gripper.state)

    def command(self, wanted: GripperCommand) -> GripperCommand:
        return self._watch.time_twin(self._gripper.command, wanted)

    def stop(self) -> None:
        self._watch.time_twin(self._gripper.stop)

    def close(self) -> None:
        self._watch.time_twin(self._gripper.close)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rate", type=float, default=250.0)
    parser.add_argument("--grasps", type=int, default=10)
    parser.add_argument("--hand", choices=("rigid", "soft"), default="rigid")
    parser.add_argument("--target-force-n", type=float, help="by default a gentle squeeze")
    options = parser.parse_args()
    calibration = calibrate_twin(seed=SEED, level=LEVEL, apart_from="strawberry", kind=options.hand)
    palpate_s, twin_s, simulated_s = list[float](), 0.0, 0.0
    for number in range(options.grasps):
        obj = draw_object(np.random.default_rng(SEED + number), "strawberry")
        world = World(
            obj, seed=SEED + number, level=LEVEL, gripper=options.hand, frame_rate_hz=options.rate
        )
        watch = Stopwatch()
        gripper = TimedGripper(TwinGripper(world), watch)
        run_grasp(
            plan_grasp(calibration, gripper=gripper, target_force_n=options.target_force_n),
            array=DecodedArray(TwinArray(world), watch),
            gripper=gripper,
            clock=world.clock,
        )
        # The first entry is the preparation of the grasp.
        palpate_s += watch.palpate_s[1:]
        twin_s += watch.twin_s
        simulated_s += world.clock.now_s()
    us = 1e6 * np.array(palpate_s)
    print(
        f"simulated; {len(us)} frames of {calibration.layout.pixels} pixels at "
        f"{options.rate:g}/s in {options.grasps} grasps"
    )
    print(
        f"from bytes to command: median {np.median(us):.0f} us, p99 {np.percentile(us, 99):.0f}, "
        f"longest {us.max():.0f} us; one core processes {1e6 / us.mean():.0f} frames/s"
    )
    total_s = us.sum() / 1e6 + twin_s
    print(
        f"the twin: {1e6 * twin_s / len(us):.0f} us a frame; both together {len(us) / total_s:.0f} "
        f"frames/s, {simulated_s / total_s:.1f} x real time"
    )


if __name__ == "__main__":
    main()
