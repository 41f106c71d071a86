"""The touch of a rig's sensor on a robot that LeRobot drives, and a jaw held at a force limit."""

from __future__ import annotations

import logging
import threading
from contextlib import ExitStack
from typing import Protocol

import numpy as np

from palpate.errors import CalibrationError, DeviceTimeoutError
from palpate.rig import Rig
from palpate.rig.guard import STALE_S, ForceGuard
from palpate.rig.reading import Reading

#: Names of the observations: force with its 90 % interval, N, and mean change of the pixels
#: relative to rest, %.
TOUCH_NAMES = ("force_n", "force_low_n", "force_high_n", "change_percent")


class Jaw(Protocol):
    """A jaw that another program drives; its position increases as it opens."""

    def read(self) -> float:
        """Return the present position."""
        ...

    def write(self, position: float) -> None:
        """Command a position."""
        ...


class Touch:
    """The touch of a sensor, and a jaw that is held once the force could exceed a limit.

    A held jaw stays where it was stopped and may open. When it has opened, and a newer reading is
    within the limit, it may close again. All other joints are left alone.

    Parameters
    ----------
    rig : Rig
        The sensor, with a force law; `close` closes it.
    jaw : Jaw
        The jaw, as the robot's program drives it.
    limit_n : float, optional
        Limit of the force, N; no guard without it.

    Attributes
    ----------
    lock : RLock
        Held while the guard uses the jaw; the robot's program holds it for each use of its bus, and
        from `limit` until the action is sent.

    Raises
    ------
    CalibrationError
        If the calibration has no force law.
    InputError
        If the limit is not above 0.
    """

    def __init__(self, rig: Rig, *, jaw: Jaw, limit_n: float | None = None) -> None:
        if not rig.has_force:
            raise CalibrationError(
                f"{rig.name}: the calibration has no force law; run `palpate calibrate force`"
            )
        self.lock = threading.RLock()
        self._rig, self._jaw = rig, jaw
        self._held: float | None = None
        self._limit_n, self._guard = limit_n, None
        if limit_n is not None:
            self._guard = ForceGuard(rig, limit_n=limit_n, gripper=self)
        self._open = ExitStack()
        self._open.callback(rig.close)

    @property
    def reason(self) -> str:
        """Why the jaw is held, in one line; empty if it is not."""
        return "" if self._guard is None else self._guard.reason

    def start(self) -> None:
        """Start to guard the jaw; the robot must be connected."""
        if self._guard is not None:
            self._open.enter_context(self._guard)

    def observe(self) -> dict[str, float]:
        """Return the newest reading by `TOUCH_NAMES`.

        Raises
        ------
        DeviceError
            If there is no present reading: the sensor is lost, or no pixel has a signal.
        """
        reading = self._rig.read() if self._guard is None else self._guard.wait_for_reading()
        if self._rig.clock.now_s() - reading.time_s > STALE_S:
            raise DeviceTimeoutError(self.reason or f"no frame for {STALE_S} s; check the sensor")
        force = reading.force_n
        assert force is not None
        if force.known_ends == (None, None):
            raise DeviceTimeoutError("no pixel has a reading; check the sensor's cable")
        change_percent = float(np.nanmean(reading.change_percent))
        values = (force.middle, force.low, force.high, change_percent)
        return dict(zip(TOUCH_NAMES, values, strict=True))

    def limit(self, position: float) -> float:
        """Return the position to command instead of a wanted one; call it with `lock` held."""
        if self._guard is None or not self._guard.is_tripped:
            return position
        if self._held is None:
            # The guard has tripped, and waits for the lock.
            self.stop()
        assert self._held is not None
        if position <= self._held:
            return self._held
        if self._is_below_limit(self._guard):
            self._held = None
            self._guard.rearm()
        return position

    def stop(self) -> None:
        """Hold the jaw where it is; called by the guard."""
        with self.lock:
            self._held = self._jaw.read()
            self._jaw.write(self._held)
        logging.getLogger(__name__).warning("the jaw is held, and may open: %s", self.reason)

    def close(self) -> None:
        """End the guard and close the sensor."""
        self._open.close()

    def _is_below_limit(self, guard: ForceGuard) -> bool:
        """Return whether a reading after the stop is within the limit."""
        reading: Reading | None = guard.reading
        if reading is None or guard.tripped_s is None or reading.time_s <= guard.tripped_s:
            return False
        assert reading.force_n is not None
        assert self._limit_n is not None
        high_n = reading.force_n.known_ends[1]
        return high_n is not None and high_n <= self._limit_n
