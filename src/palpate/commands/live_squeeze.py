"""Frames at the pace of the clock on the wall; a simulated rig squeezes its object meanwhile."""

from __future__ import annotations

from collections.abc import Iterator

from palpate.arrays import FloatArray
from palpate.clock import Clock
from palpate.commands.sensor_source import SensorSource
from palpate.errors import DeviceTimeoutError
from palpate.gripper.interface import Gripper, GripperCommand
from palpate.sensor.array import Frame
from palpate.sensor.pixel_resistance import pixel_resistance_ohm
from palpate.signal.relative import mean_change, relative_change_percent

#: A silent sensor is shown as such, so a read must not wait long.
_WAIT_S = 0.2
#: Close quickly to a touch, then slowly to each depth, keep it, and open: shares of the gripper's
#: greatest rate, percent, seconds.
_APPROACH, _SQUEEZE, _TOUCH_PERCENT = 0.3, 0.02, -3.0
_DEPTHS_PERCENT, _KEEP_S, _OPEN_S = (-30.0, -50.0), 4.0, 5.0


def paced(source: SensorSource, *, clock: Clock) -> Iterator[Frame | None]:
    """Yield frames as they come; None where none came for a while.

    `source`: an open sensor. A simulated one is held back to the pace of `clock`.
    `clock`: the clock on the wall.
    """
    if source.gripper is None or source.calibration is None:
        while True:
            try:
                yield source.array.read(timeout_s=_WAIT_S)
            except DeviceTimeoutError:
                yield None
    squeeze = Squeeze(source.gripper, rest_ohm=source.calibration.rest_ohm)
    first_s, start_s = None, clock.now_s()
    while True:
        frame = source.array.read(timeout_s=1.0)
        first_s = frame.time_s if first_s is None else first_s
        clock.sleep_s(start_s + frame.time_s - first_s - clock.now_s())
        ohm = pixel_resistance_ohm(
            frame.counts, layout=source.array.layout, oversampling=frame.oversampling
        )
        squeeze.see(frame.time_s, ohm)
        yield frame


class Squeeze:
    """Closes a simulated gripper in two steps, opens it, and begins again."""

    def __init__(self, gripper: Gripper, *, rest_ohm: FloatArray) -> None:
        self._gripper, self._rest_ohm = gripper, rest_ohm
        self._depths = list(_DEPTHS_PERCENT)
        self._until_s: float | None = None
        self._touched = self._closing = False

    def see(self, time_s: float, ohm: FloatArray) -> None:
        """Take a frame's resistances, and command what is next."""
        change = float(mean_change(relative_change_percent(ohm, rest_ohm=self._rest_ohm)))
        if self._until_s is None:
            self._until_s = time_s + _OPEN_S
        if time_s < self._until_s:
            return
        if not self._closing:
            self._close() if self._depths else self._open(time_s)
        elif not self._touched and change < _TOUCH_PERCENT:
            self._touched = True
            self._close()
        elif change < self._depths[0] or not self._gripper.state().moving:
            # Deep enough, or as far as this gripper goes.
            del self._depths[0]
            self._gripper.stop()
            self._closing, self._until_s = False, time_s + _KEEP_S

    def _close(self) -> None:
        limits = self._gripper.limits
        closed = limits.lowest if limits.drive == "width" else limits.highest
        rate = limits.fastest * (_SQUEEZE if self._touched else _APPROACH)
        self._gripper.command(GripperCommand(target=closed, rate=rate))
        self._closing = True

    def _open(self, time_s: float) -> None:
        self._gripper.release()
        self._depths, self._touched = list(_DEPTHS_PERCENT), False
        self._until_s = time_s + _OPEN_S
