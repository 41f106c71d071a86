"""Conversion of device time to host time, from the arrival times of frames."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from operator import itemgetter

#: Device time per point of the fit, and number of points. One minute is short enough to track a
#: resonator during warm-up.
BUCKET_S = 0.5
MAX_BUCKETS = 120
#: Twice the tolerance of a ceramic resonator. A larger slope is a stall of the host, not drift.
MAX_DRIFT = 0.01
#: Smallest increase of the host time from one device time to the next.
_TICK_S = 1e-6


class DeviceClock:
    """Maps a board's clock to the host's clock, with offset and drift.

    The delay of a frame varies but has a minimum. Arrival time minus device time therefore has a
    linear lower bound. The clock retains the smallest difference of each half second for one
    minute. The fitted line is the edge of their lower convex hull at the middle of the minute: it
    is below all points and closest to them. Stalls of the host and bursts only add points above
    the line. The error of the Mega's ceramic resonator is up to 0.5 %, or 5 ms per second.

    `floor_s`: the known minimum delay (scan and transmission), which is subtracted.
    `not_before_s`: latest host time already returned. Time increases, even after the line has
        moved.

    >>> clock = DeviceClock()
    >>> for k in range(400):
    ...     delay_s = 0.002 + 0.005 * (k % 3)
    ...     arrival_s = 500 + 1.004 * 0.01 * k + delay_s
    ...     [time_s] = clock.convert_burst([10.0 + 0.01 * k], arrival_s=arrival_s)
    >>> round(time_s - (500 + 1.004 * 3.99), 6), round(clock.drift_ppm)
    (0.002, 4000)
    """

    def __init__(self, *, floor_s: float = 0.0, not_before_s: float = -math.inf) -> None:
        self._floor_s = floor_s
        self._latest_s = not_before_s
        self._points: deque[tuple[float, float]] = deque(maxlen=MAX_BUCKETS)
        self._bucket_end_s: float | None = None
        self._lowest = (0.0, 0.0)
        self._origin = (0.0, 0.0)
        self._slope = 0.0

    @property
    def drift_ppm(self) -> float:
        """Drift, parts per million; positive if the board's clock is slow."""
        return self._slope * 1e6

    def convert_burst(self, devices_s: Sequence[float], *, arrival_s: float) -> list[float]:
        """Return the host times of frames that arrived together, and update the fit.

        A result is at most `arrival_s` minus the known minimum delay, unless the line was higher
        before. The last of the frames has waited least. The fit uses it before the first is
        converted, so that the frames keep the distances of the board's clock.

        `devices_s`: the board's times, unwrapped and non-decreasing.
        `arrival_s`: host time of the arrival.
        """
        for device_s in devices_s:
            self._add(device_s, arrival_s - self._floor_s - device_s)
        hosts_s = []
        for device_s in devices_s:
            line_s = self._origin[1] + self._slope * (device_s - self._origin[0])
            self._latest_s = max(self._latest_s + _TICK_S, device_s + line_s)
            hosts_s.append(self._latest_s)
        return hosts_s

    def _add(self, device_s: float, offset_s: float) -> None:
        """Update the lower bound with the offset of one frame."""
        if self._bucket_end_s is None:
            self._origin = self._lowest = (device_s, offset_s)
            self._bucket_end_s = device_s + BUCKET_S
        elif device_s >= self._bucket_end_s:
            self._points.append(self._lowest)
            self._fit()
            self._lowest = (device_s, offset_s)
            self._bucket_end_s = device_s + BUCKET_S
        elif offset_s < self._lowest[1]:
            self._lowest = (device_s, offset_s)
        if offset_s < self._origin[1] + self._slope * (device_s - self._origin[0]):
            self._origin = (device_s, offset_s)

    def _fit(self) -> None:
        """Fit the line to the hull's edge at the middle; needs two points."""
        hull: list[tuple[float, float]] = []
        for point in self._points:
            while len(hull) > 1 and not _is_left_turn(hull[-2], hull[-1], point):
                hull.pop()
            hull.append(point)
        if len(hull) < 2:
            return
        middle_s = sum(device_s for device_s, _ in self._points) / len(self._points)
        (x0, y0), (x1, y1) = next(edge for edge in pairwise(hull) if edge[1][0] >= middle_s)
        slope = (y1 - y0) / (x1 - x0)
        if abs(slope) <= MAX_DRIFT:
            self._slope, self._origin = slope, (x1, y1)
        else:
            self._slope, self._origin = 0.0, min(hull, key=itemgetter(1))


def _is_left_turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    return (b[0] - a[0]) * (c[1] - a[1]) > (b[1] - a[1]) * (c[0] - a[0])
