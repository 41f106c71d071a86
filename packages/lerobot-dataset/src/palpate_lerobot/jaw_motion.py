"""How far a jaw may close, and whether its force agrees with its motion."""

from __future__ import annotations

from collections import deque

#: A reading may show the force of this much earlier: conversion, USB and lag of the sheet, seconds.
_LAG_S = 0.05
#: Span in which positions and readings are compared, seconds.
_SPAN_S = 1.0
#: Movement beyond play and noise, mm.
_MOVED_MM = 1.0
#: A contact ends when the jaw is open by this much more than at its begin, mm: more than produce
#: recovers while it is held.
_FREE_MM = 2.0


class JawMotion:
    """Positions of a jaw with the forces of its readings.

    Parameters
    ----------
    limit_n : float
        Limit of the force, N.
    n_per_unit : float
        Upper bound of the rise of the force per unit of closing.
    mm_per_unit : float
        Movement of the pad per unit of the position.

    Examples
    --------
    At 1 N and 0.5 N/mm, a limit of 3 N is 4 mm away from where the jaw was at the reading:

    >>> motion = JawMotion(limit_n=3.0, n_per_unit=0.5, mm_per_unit=1.0)
    >>> motion.move(40.0, now_s=0.0)
    >>> motion.move(39.0, now_s=0.1)
    >>> motion.feel(0.8, 1.0, at_s=0.06)
    >>> motion.most_closed
    36.0
    """

    def __init__(self, *, limit_n: float, n_per_unit: float, mm_per_unit: float) -> None:
        self._limit_n, self._n_per_unit = limit_n, n_per_unit
        self._moved, self._free = _MOVED_MM / mm_per_unit, _FREE_MM / mm_per_unit
        self._positions: deque[tuple[float, float]] = deque()
        #: Time, position, lower and upper limit of the force since the jaw last closed.
        self._felt: deque[tuple[float, float, float, float]] = deque()
        self._high_n = limit_n
        self._reading_s, self._reading_at = float("-inf"), 0.0
        self._touched: float | None = None
        self._widest = float("-inf")

    def move(self, position: float, *, now_s: float) -> None:
        """Add a position."""
        self._positions.append((now_s, position))
        while len(self._positions) > 1 and self._positions[1][0] < now_s - _SPAN_S:
            self._positions.popleft()
        self._widest = max(self._widest, position)
        if position < self._widest - self._moved:
            # It closes again: perhaps on something larger.
            self._widest = position
            if self.is_free:
                self._touched = None

    def feel(self, low_n: float, high_n: float | None, *, at_s: float) -> None:
        """Add a reading and its time; `high_n`: None if the force has no upper limit."""
        if at_s <= self._reading_s or not self._positions:
            return
        earlier = [one for time_s, one in self._positions if time_s <= at_s - _LAG_S]
        at = earlier[-1] if earlier else self._positions[0][1]
        self._reading_s, self._reading_at = at_s, at
        self._high_n = float("inf") if high_n is None else high_n
        if self._felt and at < self._felt[-1][1] - 0.1 * self._moved:
            self._felt.clear()
        self._felt.append((at_s, at, low_n, self._high_n))
        while self._felt[0][0] < at_s - _SPAN_S:
            self._felt.popleft()
        if low_n == 0.0:
            self._touched = None
        elif self._touched is None:
            self._touched = self._widest = at

    @property
    def most_closed(self) -> float:
        """The position at which the force could reach the limit, at most the present one."""
        present = self._positions[-1][1]
        room_n = max(self._limit_n - self._high_n, 0.0)
        return min(self._reading_at - room_n / self._n_per_unit, present)

    @property
    def is_touching(self) -> bool:
        """Whether the readings show a force."""
        return self._touched is not None

    @property
    def is_free(self) -> bool:
        """Whether the jaw is open by more than at the begin of the contact."""
        present = self._positions[-1][1] if self._positions else float("-inf")
        return self._touched is not None and present > self._touched + self._free

    def find_reversal(self) -> tuple[float, float] | None:
        """Return an earlier and the present force, N, if it rises as the jaw opens."""
        if not self._felt:
            return None
        _, at, low_n, _ = self._felt[-1]
        # A load from outside rises before the jaw opens, and falls as it does.
        is_rising = low_n == max(one for _, _, one, _ in self._felt)
        if not is_rising or low_n < 0.5 * self._limit_n:
            return None
        for _, before, _, before_n in self._felt:
            if at > before + self._moved and low_n > before_n:
                return before_n, low_n
        return None
