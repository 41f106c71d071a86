"""The touch of a rig's sensor on a robot that LeRobot drives, and a jaw held at a force limit."""

from __future__ import annotations

import logging
import threading
from contextlib import ExitStack
from typing import Protocol

import numpy as np

from palpate.calibration import Calibration
from palpate.errors import CalibrationError, DeviceError, DeviceTimeoutError
from palpate.object.compliance import Compliance
from palpate.rig import Rig
from palpate.rig.guard import STALE_S, ForceGuard
from palpate.rig.reading import Reading
from palpate_lerobot.jaw_motion import JawMotion

#: Names of the observations: force with its 90 % interval, N, and mean change of the pixels
#: relative to rest, %.
TOUCH_NAMES = ("force_n", "force_low_n", "force_high_n", "change_percent")
#: Rise of the force on a rigid object without a calibrated compliance, N/mm: hands give way by 2 to
#: 4 mm at 15 N.
STIFFEST_N_PER_MM = 7.5
#: Smallest and longest step of the opening of a jaw that presses too hard, and time between two, so
#: that a reading follows each: a servo does not move by less, and the object is not to be dropped.
_LEAST_MM, _MOST_MM, _REOPEN_S = 0.1, 0.5, 0.15


class Jaw(Protocol):
    """A jaw that another program drives; its position increases as it opens."""

    @property
    def mm_per_unit(self) -> float:
        """Movement of the pad per unit of the position."""
        ...

    def read(self) -> float:
        """Return the present position."""
        ...

    def write(self, position: float) -> None:
        """Command a position."""
        ...


class Touch:
    """The touch of a sensor, and a jaw that does not close beyond a limit of the force.

    The jaw closes at most by what is left to the limit over the stiffness of a rigid object. Once
    the force could exceed the limit, it is held, and opened in small steps until the force is
    below. It may open at any time. When it has opened, and a newer reading is within the limit, it
    may close again. All other joints are left alone. If the force rises as the jaw opens, it is
    held for good, and `observe` raises an error.

    Parameters
    ----------
    rig : Rig
        The sensor, with a force law; `close` closes it.
    jaw : Jaw
        The jaw, as the robot's program drives it.
    limit_n : float, optional
        Limit of the force, N; no guard without it.
    stiffest_n_per_mm : float, optional
        Largest rise of the force per mm of closing; by default that of a rigid object by the
        calibrated compliance, or else `STIFFEST_N_PER_MM`. The jaw closes the slower, the larger
        it is.
    free_above : float, optional
        Position above which the jaw cannot meet an object, and is not slowed unless it does.

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
        If the limit is not above 0, or above the force ceiling.
    """

    def __init__(
        self,
        rig: Rig,
        *,
        jaw: Jaw,
        limit_n: float | None = None,
        stiffest_n_per_mm: float | None = None,
        free_above: float = float("inf"),
    ) -> None:
        if not rig.has_force:
            raise CalibrationError(
                f"{rig.name}: the calibration has no force law; run `palpate calibrate force`"
            )
        self.lock = threading.RLock()
        self._rig, self._jaw, self._free_above = rig, jaw, free_above
        self._held: float | None = None
        self._limit_n, self._guard = limit_n, None
        if limit_n is not None:
            self._guard = ForceGuard(rig, limit_n=limit_n, gripper=self, ease=self._reopen)
        self._stiffest = stiffest_n_per_mm or _stiffest_n_per_mm(rig.calibration)
        self._motion: JawMotion | None = None
        self._fault = ""
        self._reopened_s = float("-inf")
        self._open = ExitStack()
        self._open.callback(rig.close)

    @property
    def reason(self) -> str:
        """Why the jaw is held, in one line; empty if it is not."""
        return self._fault or ("" if self._guard is None else self._guard.reason)

    def start(self) -> None:
        """Start to guard the jaw; the robot must be connected."""
        mm_per_unit = self._jaw.mm_per_unit
        self._motion = JawMotion(
            limit_n=self._limit_n or float("inf"),
            n_per_unit=self._stiffest * mm_per_unit,
            mm_per_unit=mm_per_unit,
        )
        if self._guard is not None:
            self._open.enter_context(self._guard)

    def observe(self, position: float | None = None) -> dict[str, float]:
        """Return the newest reading by `TOUCH_NAMES`.

        `position`: the present one of the jaw, if known. Where it is open by 2 mm more than at the
        begin of the contact, force and lower limit are 0: the sheet recovers more slowly.

        Raises
        ------
        DeviceError
            If there is no present reading: the sensor is lost, or no pixel has a signal; or if the
            force rises as the jaw opens.
        """
        if self._fault:
            raise DeviceError(self._fault)
        reading = self._rig.read() if self._guard is None else self._guard.wait_for_reading()
        if self._rig.clock.now_s() - reading.time_s > STALE_S:
            lost = "" if self._guard is None else self._guard.loss
            raise DeviceTimeoutError(lost or f"no frame for {STALE_S} s; check the sensor's cable")
        force = reading.force_n
        assert force is not None
        if force.known_ends == (None, None):
            raise DeviceTimeoutError("no pixel has a reading; check the sensor's cable")
        middle_n, low_n = force.middle, force.low
        if position is not None and self._motion is not None:
            with self.lock:
                self._motion.move(position, now_s=self._rig.clock.now_s())
                self._feel(self._motion, reading)
                if self._motion.is_free:
                    middle_n = low_n = 0.0
        change_percent = float(np.nanmean(reading.change_percent))
        values = (middle_n, low_n, force.high, change_percent)
        return dict(zip(TOUCH_NAMES, values, strict=True))

    def limit(self, position: float) -> float:
        """Return the position to command instead of a wanted one; call it with `lock` held."""
        guard, motion = self._guard, self._motion
        if guard is None or motion is None:
            return position
        present = self._jaw.read()
        motion.move(present, now_s=self._rig.clock.now_s())
        if guard.reading is not None:
            self._feel(motion, guard.reading)
        if self._is_reversed(motion):
            assert self._held is not None
            return self._held
        if not guard.is_tripped:
            if motion.is_touching:
                return max(position, motion.most_closed)
            return max(position, min(motion.most_closed, self._free_above))
        if self._held is None:
            # The guard has tripped, and waits for the lock.
            self.stop()
        assert self._held is not None
        if position <= self._held:
            return self._held
        if self._is_below_limit(guard):
            self._held = None
            guard.rearm()
        else:
            self._held = max(self._held, present)
        return position

    def stop(self) -> None:
        """Hold the jaw where it is; called by the guard."""
        with self.lock:
            self._held = self._jaw.read()
            self._jaw.write(self._held)
            may = "held" if self._fault else "held, and may open"
        logging.getLogger(__name__).warning("the jaw is %s: %s", may, self.reason)

    def close(self) -> None:
        """End the guard and close the sensor."""
        self._open.close()

    def _reopen(self, reading: Reading) -> None:
        """Open by a step if the force of a reading after the last step is above the limit."""
        with self.lock:
            force, motion = reading.force_n, self._motion
            assert force is not None
            assert motion is not None
            assert self._limit_n is not None
            if self._held is None or reading.time_s < self._reopened_s + _REOPEN_S:
                return
            present, now_s = self._jaw.read(), self._rig.clock.now_s()
            motion.move(present, now_s=now_s)
            self._feel(motion, reading)
            if self._is_reversed(motion):
                return
            high_n = force.known_ends[1]
            step_mm = _MOST_MM
            if high_n is not None:
                step_mm = min(max((high_n - self._limit_n) / self._stiffest, _LEAST_MM), _MOST_MM)
            self._held = max(self._held, present + step_mm / self._jaw.mm_per_unit)
            self._jaw.write(self._held)
            self._reopened_s = now_s

    def _feel(self, motion: JawMotion, reading: Reading) -> None:
        assert reading.force_n is not None
        low_n, high_n = reading.force_n.known_ends
        motion.feel(low_n or 0.0, high_n, at_s=reading.time_s)

    def _is_reversed(self, motion: JawMotion) -> bool:
        """Return whether the jaw has pressed harder as it opened; stop it at first."""
        if not self._fault and (found := motion.find_reversal()):
            before_n, now_n = found
            self._fault = (
                f"the force rose from at most {before_n:.2f} to at least {now_n:.2f} N as the jaw "
                "opened: the jaw closes towards 100 %; calibrate it the other way"
            )
            self.stop()
        return bool(self._fault)

    def _is_below_limit(self, guard: ForceGuard) -> bool:
        """Return whether a reading after the stop is within the limit."""
        reading: Reading | None = guard.reading
        if reading is None or guard.tripped_s is None or reading.time_s <= guard.tripped_s:
            return False
        assert reading.force_n is not None
        assert self._limit_n is not None
        high_n = reading.force_n.known_ends[1]
        return high_n is not None and high_n <= self._limit_n


def _stiffest_n_per_mm(calibration: Calibration) -> float:
    """Return the rise of the force on a rigid object, at least that without a calibration."""
    block = calibration.block
    if len(block.width_mm) < 4:
        return STIFFEST_N_PER_MM
    fitted = Compliance.fit(block.force_n, width_mm=block.width_mm, block_mm=block.block_mm)
    # Of a fit without a slope, the stiffness is no measurement.
    return min(fitted.stiffest_n_per_mm, 2 * STIFFEST_N_PER_MM)
