"""Closing at constant speed, with contact detection.

A movement raises the resistance of all pixels, until shortly after its end. At constant speed the
rise is constant, so a contact is a change of any pixel relative to its last few tenths of a second.
During acceleration only a fall counts, because the movement causes a rise. The servo current shows
contact outside the pixels too, and does not lag.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.force.servo_force import CurrentLaw
from palpate.grasp.config import CURRENT, READING, TOUCH

#: Median of the square of a standard normal variable.
_MEDIAN_SQUARE = 0.4549


def blind_time_s(period_s: float) -> float:
    """Return the time after slowing down in which light contacts are not detected, s.

    `period_s`: frame period.

    >>> round(blind_time_s(1 / 15), 2), round(blind_time_s(1 / 250), 2)
    (0.66, 0.51)
    """
    return TOUCH.steady_s + READING.lag_s + READING.fewest_frames * max(period_s, TOUCH.window_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """A constant-speed closing motion with its latest readings.

    Attributes
    ----------
    rate : float
        Speed, mm/s or kPa/s.
    end : float
        Closure at which the sweep ends without contact.
    since_s : float
        Start time.
    begin : float
        Closure at the start.
    most_n : float
        Force at which the sweep ends.
    rows : tuple of int or None
        Rows of the watched pixels; None for all.
    time_s : tuple of float
        Times of the frames in the window.
    log_ohm : tuple of ndarray, shape (watched rows, cols)
        ln of each pixel's resistance over its rest value, for each frame.
    gears_ma : tuple of float
        Servo current minus gear friction at the same width, while the hand moves; NaN if unknown.
    level : ndarray or None, shape (watched rows, cols)
        ln resistance over rest at constant speed; None before.
    slowed : bool
        Whether a faster sweep ended at the start of this one, whose disturbance must decay first.
    """

    rate: float
    end: float
    since_s: float
    begin: float = 0.0
    most_n: float = math.inf
    rows: tuple[int, ...] | None = None
    time_s: tuple[float, ...] = ()
    log_ohm: tuple[FloatArray, ...] = ()
    gears_ma: tuple[float, ...] = ()
    level: FloatArray | None = None
    slowed: bool = False

    def with_frame(self, time_s: float, *, log_ohm: FloatArray, gears_ma: float) -> Sweep:
        """Return the sweep with one more frame, and without frames older than the window."""
        level = self.level
        if level is None and time_s > self.since_s + TOUCH.steady_s + READING.now_s:
            recent = [
                ohm
                for at, ohm in zip(self.time_s, self.log_ohm, strict=True)
                if at > time_s - READING.now_s
            ]
            level = np.asarray(np.mean(recent, axis=0)) if recent else None
        first = sum(old < time_s - TOUCH.baseline_s for old in self.time_s)
        return replace(
            self,
            time_s=(*self.time_s[first:], time_s),
            log_ohm=(*self.log_ohm[first:], log_ohm),
            gears_ma=(*self.gears_ma[first:], gears_ma),
            level=level,
        )

    @property
    def is_frozen(self) -> bool:
        """Whether the latest frames are all equal."""
        last = [time_s > self.time_s[-1] - READING.now_s for time_s in self.time_s]
        many = max(READING.fewest_frames + 1, sum(last))
        latest = self.log_ohm[-many:]
        return len(latest) == many and all(np.array_equal(latest[0], one) for one in latest)

    def is_touching(self, current: CurrentLaw | None) -> bool:
        """Return whether a pixel or the servo current shows contact."""
        time_s = np.array(self.time_s)
        now = time_s > time_s[-1] - TOUCH.window_s
        before = time_s < time_s[-1] - READING.lag_s
        if self.slowed:
            before &= time_s > self.since_s + TOUCH.steady_s
        if current is not None and self._is_servo_pulling(current, now=now, before=before):
            return True
        steady = before & (time_s > self.since_s + TOUCH.steady_s)
        pixels = np.array(self.log_ohm)
        latest = pixels[now].mean(axis=0)
        # A slowly rising load also changes the recent readings. Therefore compare with the level of
        # this movement too, and with the rest value, because a movement only raises it.
        highest = 0.0 if self.level is None else np.maximum(self.level, 0.0)
        if bool(
            (
                latest < highest - max(TOUCH.threshold_sd * _noise(pixels), 2 * TOUCH.min_change)
            ).any()
        ):
            return True
        many = int(np.count_nonzero(now))
        if np.count_nonzero(steady) // many >= READING.fewest_frames:
            past = _means(pixels[steady], many)
            least = max(TOUCH.threshold_sd * _scatter(past), TOUCH.min_change)
            return bool((abs(latest - past.mean(axis=0)) > least).any())
        if np.count_nonzero(before) // many < READING.fewest_frames:
            return False
        past = _means(pixels[before], many)
        # The change common to all pixels is due to the movement.
        own = np.diff(past, axis=0)
        own = own - np.median(own, axis=(1, 2), keepdims=True)
        least = max(TOUCH.threshold_sd * float(np.sqrt(np.mean(own**2))), TOUCH.min_change)
        return bool((latest - past.max(axis=0) < -least).any())

    def _is_servo_pulling(
        self, current: CurrentLaw, *, now: NDArray[np.bool_], before: NDArray[np.bool_]
    ) -> bool:
        """Return whether the servo current has risen."""
        gears_ma = np.array(self.gears_ma)
        known = np.isfinite(gears_ma)
        now, before = now & known, before & known
        if not now.any() or np.count_nonzero(before) < READING.fewest_frames:
            return False
        more_ma = float(gears_ma[now].mean() - gears_ma[before].mean())
        variance = 1.0 / np.count_nonzero(now) + 1.0 / np.count_nonzero(before)
        noise_ma = CURRENT.single_sd * current.noise_ma * float(np.sqrt(variance))
        return more_ma > noise_ma + TOUCH.friction_error_fraction * abs(current.gears.mean_ma)


def _means(pixels: FloatArray, size: int) -> FloatArray:
    """Return means over groups of `size` frames; the oldest incomplete group is dropped."""
    blocks = pixels[pixels.shape[0] % size :]
    return np.asarray(blocks.reshape(-1, size, *pixels.shape[1:]).mean(axis=1))


def _noise(pixels: FloatArray) -> float:
    """Return the standard deviation of a pixel between frames, without slow changes."""
    if len(pixels) <= READING.fewest_frames:
        return TOUCH.min_change
    return float(np.sqrt(0.5 * np.median(np.diff(pixels, axis=0) ** 2) / _MEDIAN_SQUARE))


def _scatter(past: FloatArray) -> float:
    """Return the standard deviation pooled over the pixels, each about its own mean."""
    own = past - past.mean(axis=0)
    return float(np.sqrt(np.sum(own**2) / (own.size - own[0].size)))
