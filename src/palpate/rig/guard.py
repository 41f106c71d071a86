"""A guard that stops any gripper before the force passes a limit."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from types import TracebackType
from typing import Protocol, Self

from palpate.errors import DeviceError, DeviceTimeoutError, InputError
from palpate.grasp.safety import FORCE_CEILING_N
from palpate.gripper.no_gripper import NO_GRIPPER, NoGripper
from palpate.measurement import Measurement
from palpate.rig import Rig
from palpate.rig.guard_limit import USUAL_CERTAINTY, explain_stop, find_stop, is_early
from palpate.rig.paced_array import PacedArray
from palpate.rig.reading import Reading

#: Age from which a reading does not show the present force, and time limit for a frame, seconds.
#: A busy computer passes bytes of a serial port on up to this late.
STALE_S = 0.3


def check_limit(name: str, limit_n: float) -> None:
    """Raise `InputError` if a limit, called `name`, is no force that a grasp could have."""
    if not 0 < limit_n <= FORCE_CEILING_N:
        raise InputError(
            f"{name} {limit_n:g}: must be above 0, and at most {FORCE_CEILING_N:g} N (grams times "
            "0.00981)"
        )


class Stoppable(Protocol):
    """What the guard needs of a gripper."""

    def stop(self) -> object:
        """Stop in place."""
        ...


class ForceGuard:
    """Stops a gripper once the force could exceed a limit, or the sensor fails.

    A thread reads the sensor in a `with` block, and calls `stop()` of the gripper, once, when

    - the force is no longer below `limit_n` with the probability `certainty`, or has no upper limit
      (a saturated pixel);
    - no pixel has a reading;
    - no frame has arrived for `stale_s`, or the sensor is lost.

    The wider the interval, the earlier it stops: `print(guard)` says where. A lower `certainty`
    stops nearer to the limit, and more often above it.

    The sensor must not be read elsewhere meanwhile: `reading` is the newest one. The guard does not
    prevent a later command; ask `is_tripped` before each. `stop()` is called from the guard's
    thread.

    Parameters
    ----------
    source : Rig
        An open rig, which may have no gripper, with a force law in its calibration.
    limit_n : float
        Limit of the grip force, newtons.
    gripper : object, optional
        Any object with `stop()`; by default the rig's gripper.
    certainty : float
        Probability that the force is below the limit until the guard stops, 0.5 to below 1. At 0.95
        the upper end of the 90 % interval must be below it, at 0.5 the force itself.
    stale_s : float
        Time without a new frame that stops the gripper, seconds.
    ease : function, optional
        Called from the guard's thread with each reading after the stop at which the gripper must
        still not close, for example to open it by a step.

    Attributes
    ----------
    loss : str
        Why there is no reading now, in one line; empty while frames arrive.
    reading : Reading or None
        The newest reading; None before the first.
    reason : str
        Why the gripper was stopped, in one line; empty before.
    tripped_s : float or None
        Time of the stop on the rig's clock.

    Raises
    ------
    InputError
        If the limit is not above 0 or exceeds the force ceiling, `stale_s` is not above 0,
        `certainty` is out of range, or there is no gripper or no force law.

    Examples
    --------
    >>> from palpate.rig import open_rig
    >>> with open_rig("sim-rigid", object_name="tomato", seed=4) as rig:
    ...     with ForceGuard(rig, limit_n=3.0) as guard:
    ...         known = guard.wait_for_reading()
    >>> known.force_n.high < 3.0, guard.is_tripped
    (True, False)
    """

    def __init__(
        self,
        source: Rig,
        *,
        limit_n: float,
        gripper: Stoppable | None = None,
        certainty: float = USUAL_CERTAINTY,
        stale_s: float = STALE_S,
        ease: Callable[[Reading], object] | None = None,
    ) -> None:
        check_limit("limit_n", limit_n)
        if not stale_s > 0:
            raise InputError(f"stale_s {stale_s:g}: must be above 0")
        if not 0.5 <= certainty < 1.0:
            raise InputError(f"certainty {certainty:g}: must be 0.5 to below 1, such as 0.8")
        if gripper is None and isinstance(source.gripper, NoGripper):
            raise InputError(NO_GRIPPER)
        self._rig = source
        if source.is_simulated:
            # Its sensor has a frame at any time, and the guard would read without end.
            self._rig = replace(source, array=PacedArray(source.array, speed=1.0))
        self._limit_n, self._certainty, self._stale_s = limit_n, certainty, stale_s
        self._gripper = source.gripper if gripper is None else gripper
        if not self._rig.has_force:
            raise InputError(
                "the calibration has no force law, so there is no force to guard; run `palpate "
                "calibrate force`"
            )
        known = source.calibration
        stop = find_stop(known, limit_n=limit_n, certainty=certainty)
        self._expectation = explain_stop(stop, limit_n=limit_n, calibration=known)
        self._is_early = is_early(stop, limit_n=limit_n)
        self.reading: Reading | None = None
        self.reason = self.loss = ""
        self._ease = ease
        self.tripped_s: float | None = None
        self._is_stopped, self._failure = True, ""
        #: Whether `stop()` was called since the guard was armed.
        self._has_stopped_once = False
        self._news, self._closing = threading.Condition(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="palpate-guard", daemon=True)

    @property
    def is_tripped(self) -> bool:
        """Whether the gripper was stopped."""
        return self.reason != ""

    def __repr__(self) -> str:
        return f"ForceGuard({self.reason or self._expectation or f'limit {self._limit_n:g} N'})"

    def __enter__(self) -> Self:
        """Start to guard; log a warning if the guard will stop far below its limit."""
        if self._is_early:
            logging.getLogger(__name__).warning("%s", self._expectation)
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """End the guard.

        Raises `DeviceError` if the gripper could not be stopped.
        """
        self._closing.set()
        self._thread.join()
        if error is None and not self._is_stopped:
            raise DeviceError(f"{self.reason}, and the stop failed: {self._failure}")

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until the gripper was stopped; return whether it was within the time."""
        with self._news:
            return self._news.wait_for(lambda: self._has_stopped_once, timeout_s)

    def wait_for_reading(self, timeout_s: float | None = None) -> Reading:
        """Wait for the first reading and return the newest.

        Raises `DeviceTimeoutError` if there is none in time.
        """
        with self._news:
            self._news.wait_for(lambda: self.reading is not None or self.is_tripped, timeout_s)
        if self.reading is None:
            raise DeviceTimeoutError(self.reason or f"no frame in {timeout_s} s")
        return self.reading

    def rearm(self) -> None:
        """Guard again after a stop, for example once the object is released."""
        with self._news:
            self.reason, self.tripped_s = "", None
            self._is_stopped, self._has_stopped_once = True, False

    def _run(self) -> None:
        while not self._closing.is_set():
            try:
                reading = self._rig.read(timeout_s=self._stale_s)
                danger, self.loss = self._find_danger(reading), ""
            except DeviceError as error:
                reading, danger = None, str(error)
                self.loss = danger
            except Exception as error:
                # The thread ends, so nothing would guard.
                self._trip(f"the guard failed: {error!r}")
                raise
            if danger and not self.is_tripped:
                self._trip(danger)
            if not self._is_stopped:
                self._stop()
            elif danger and reading is not None and self._ease is not None:
                with suppress(Exception):  # as a failed stop: again at the next frame
                    self._ease(reading)
            with self._news:
                self.reading = reading or self.reading
                self._news.notify_all()
            if reading is None:
                self._closing.wait(0.05)

    def _find_danger(self, reading: Reading) -> str:
        """Return why the gripper must stop; empty if it need not."""
        if reading.age_s > self._stale_s:
            return f"the newest frame is {reading.age_s:.2f} s old"
        force = reading.force_n
        assert isinstance(force, Measurement)
        low, high = force.known_ends
        if low is None and high is None:
            return "no pixel has a reading; check the sensor's cable"
        if high is None:
            return f"a pixel is at its limit: at least {low:.2f} N, without an upper limit"
        if force.quantile(self._certainty) > self._limit_n:
            return (
                f"reads {force.middle:.2f} N, up to {high:.2f} N: not below the limit of "
                f"{self._limit_n:g} N with a certainty of {100 * self._certainty:g} %"
            )
        return ""

    def _trip(self, reason: str) -> None:
        # First the reason: a loop that asks `is_tripped` must not command the gripper after the
        # stop.
        self.reason, self.tripped_s = reason, self._rig.clock.now_s()
        self._is_stopped = False
        self._stop()
        with self._news:
            self._has_stopped_once = True
            self._news.notify_all()

    def _stop(self) -> None:
        """Stop the gripper; a failed stop is repeated at the next frame."""
        try:
            self._gripper.stop()
        except Exception as error:
            self._failure = str(error)
        else:
            self._is_stopped = True
