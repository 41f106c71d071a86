"""Device time to host time, from the arrival times of frames."""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise
from operator import itemgetter

#: Device time per point of the fit, and points kept: one minute follows a warming resonator.
BUCKET_S = 0.5
BUCKETS = 120
#: Twice what a ceramic resonator may be off; anything above it is a stall, not drift.
LARGEST_DRIFT = 0.01


class DeviceClock:
    """Maps a board's clock to the host's, with offset and drift.

    A frame arrives late by a delay that varies but has a floor, so arrival minus device time is
    bounded below by the line of the fit. The smallest difference of each half second is
    kept for a minute; the line that lies below all of them, and closest to them, is the edge of
    their lower convex hull that spans their middle. Stalls of the host and bursts only lie above.
    The Mega's ceramic resonator has an error of up to 0.5 %, 5 ms in each second.

    `floor_s`: the known least delay (scan and transmission), which is subtracted.
    `not_before_s`: host time that was given out already: time never goes back, even where the line
        is moved.

    >>> clock = DeviceClock()
    >>> for k in range(400):
    ...     delay_s = 0.002 + 0.005 * (k % 3)
    ...     time_s = clock.to_host_s(10.0 + 0.01 * k, arrival_s=500 + 1.004 * 0.01 * k + delay_s)
    >>> round(time_s - (500 + 1.004 * 3.99), 6), round(clock.drift_ppm)
    (0.002, 4000)
    """

    def __init__(self, *, floor_s: float = 0.0, not_before_s: float = -math.inf) -> None:
        self._floor_s = floor_s
        self._latest_s = not_before_s
        self._points: deque[tuple[float, float]] = deque(maxlen=BUCKETS)
        self._bucket_end_s: float | None = None
        self._lowest = (0.0, 0.0)
        self._origin = (0.0, 0.0)
        self._slope = 0.0

    @property
    def drift_ppm(self) -> float:
        """Drift of the board's clock against the host's, parts per million."""
        return self._slope * 1e6

    def to_host_s(self, device_s: float, *, arrival_s: float) -> float:
        """Return the host time of `device_s`, learning from the arrival.

        `device_s`: the board's time, not wrapped, not decreasing.
        `arrival_s`: host time at which it was received.
        It is at most `arrival_s` less the known least delay.
        """
        offset_s = arrival_s - self._floor_s - device_s
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
        line_s = self._origin[1] + self._slope * (device_s - self._origin[0])
        if offset_s < line_s:
            self._origin = (device_s, offset_s)
            line_s = offset_s
        self._latest_s = max(self._latest_s, device_s + line_s)
        return self._latest_s

    def _fit(self) -> None:
        """Take the hull's edge below the middle of the points; one point gives no drift."""
        hull: list[tuple[float, float]] = []
        for point in self._points:
            while len(hull) > 1 and not _turns_left(hull[-2], hull[-1], point):
                hull.pop()
            hull.append(point)
        if len(hull) < 2:
            return
        middle_s = sum(device_s for device_s, _ in self._points) / len(self._points)
        (x0, y0), (x1, y1) = next(edge for edge in pairwise(hull) if edge[1][0] >= middle_s)
        slope = (y1 - y0) / (x1 - x0)
        if abs(slope) <= LARGEST_DRIFT:
            self._slope, self._origin = slope, (x1, y1)
        else:
            self._slope, self._origin = 0.0, min(hull, key=itemgetter(1))


def _turns_left(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    return (b[0] - a[0]) * (c[1] - a[1]) > (b[1] - a[1]) * (c[0] - a[0])
