"""The check of the pixels' order: each is pressed, and must fall most.

The watch is fed frames and names the pixel to press next; it has no clock and no I/O, so a
recording of presses is judged as live ones are.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from palpate.arrays import FloatArray
from palpate.sensor.array import ArrayLayout
from palpate.sensor.findings import Finding, pixel_name
from palpate.signal.relative import relative_change_percent

PixelPlace: TypeAlias = tuple[int, int]

#: A press falls by twice the paper's contact threshold, with one pixel in the lead for a while.
_PRESSED_PERCENT, _HELD_S = -20.0, 0.25
#: Release: a rise to half of the press's depth. The sheet then creeps back, so the next
#: press is measured from its level a little later.
_RELEASED_SHARE, _CALM_S = 0.5, 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Press:
    """The requested pixel, and the one that fell most; None without one in time."""

    expected: PixelPlace
    answered: PixelPlace | None


class PressWatch:
    """Watches presses of one pixel after the other, row by row.

    `rest_ohm`, shape (rows, cols): rest values; inf or 0 for dead pixels, which are left out.
    `timeout_s`: how long a press is waited for.

    >>> watch = PressWatch(np.full((1, 2), 1000.0))
    >>> watch.next_place
    (0, 0)
    >>> for k in range(10):
    ...     watch.add_frame(0.1 * k, np.array([[1000.0, 300.0]]))
    >>> watch.presses
    (Press(expected=(0, 0), answered=(0, 1)),)
    """

    def __init__(self, rest_ohm: FloatArray, *, timeout_s: float = 20.0) -> None:
        usable = np.isfinite(rest_ohm) & (rest_ohm > 0)
        self._wanted: list[PixelPlace] = [(int(r), int(c)) for r, c in np.argwhere(usable)]
        self._base_ohm = np.where(usable, rest_ohm, np.nan)
        self._timeout_s = timeout_s
        self._presses: list[Press] = []
        self._since_s: float | None = None
        self._leader: PixelPlace | None = None
        self._leads_s = 0.0
        self._depth = 0.0
        self._calm_s: float | None = None

    @property
    def next_place(self) -> PixelPlace | None:
        """The pixel to press next; None when done or while a pixel is pressed."""
        waiting = self._leader is None or self._depth == 0.0
        return self._wanted[0] if self._wanted and waiting else None

    @property
    def is_done(self) -> bool:
        """Whether every pixel has had its turn."""
        return not self._wanted

    @property
    def presses(self) -> tuple[Press, ...]:
        """The presses recorded so far."""
        return tuple(self._presses)

    def add_frame(self, time_s: float, ohm: FloatArray) -> None:
        """Take a frame.

        `ohm`: shape (rows, cols).
        """
        if self.is_done:
            return
        self._since_s = time_s if self._since_s is None else self._since_s
        change = relative_change_percent(ohm, rest_ohm=self._base_ohm)
        change = np.where(np.isnan(change), 0.0, change)
        if self._depth < 0.0:
            self._await_release(time_s, change, ohm)
        else:
            self._await_press(time_s, change)

    def end_early(self) -> None:
        """Count the remaining presses as unanswered: the frames have ended."""
        self._presses += [Press(expected=pixel, answered=None) for pixel in self._wanted]
        self._wanted.clear()

    def _await_press(self, time_s: float, change: FloatArray) -> None:
        row, col = divmod(int(change.argmin()), change.shape[1])
        leader = (row, col) if change[row, col] <= _PRESSED_PERCENT else None
        if leader != self._leader:
            self._leader, self._leads_s = leader, time_s
        if leader is not None and time_s - self._leads_s >= _HELD_S:
            self._depth = float(change[row, col])
            self._presses.append(Press(expected=self._wanted.pop(0), answered=leader))
            self._since_s, self._calm_s = time_s, None
        elif self._since_s is not None and time_s - self._since_s > self._timeout_s:
            self._presses.append(Press(expected=self._wanted.pop(0), answered=None))
            self._since_s = time_s

    def _await_release(self, time_s: float, change: FloatArray, ohm: FloatArray) -> None:
        self._depth = min(self._depth, float(change.min()))
        if change.min() < _RELEASED_SHARE * self._depth:
            self._calm_s = None
        elif self._calm_s is None:
            self._calm_s = time_s
        overdue = self._since_s is not None and time_s - self._since_s > self._timeout_s
        calm = self._calm_s is not None and time_s - self._calm_s >= _CALM_S
        if calm or overdue:
            self._base_ohm = np.where(np.isnan(self._base_ohm), np.nan, ohm)
            self._depth, self._leader, self._since_s = 0.0, None, time_s


def order_findings(presses: Sequence[Press], *, layout: ArrayLayout) -> list[Finding]:
    """Return which pixels did not answer, and which answered for another.

    Whole rows or columns that answer for each other are named as such.

    >>> pair = ArrayLayout(name="pair", rows=2, cols=1, finger_of_row=(0, 1))
    >>> crossed = [Press(expected=(0, 0), answered=(1, 0)), Press(expected=(1, 0), answered=(0, 0))]
    >>> [(found.where, found.text) for found in order_findings(crossed, layout=pair)]
    [('row R0', 'answers as row R1'), ('row R1', 'answers as row R0')]
    """
    findings = [
        Finding("silent", "did not answer its press", pixel_name(*press.expected))
        for press in presses
        if press.answered is None
    ]
    answers = {p.expected: p.answered for p in presses if p.answered is not None}
    rows = _map_lines(answers, axis=0)
    cols = _map_lines(answers, axis=1)
    lines_alone = all(
        (rows.get(r, r), cols.get(c, c)) == answered for (r, c), answered in answers.items()
    )
    if lines_alone:
        findings += _line_findings("row R", rows)
        findings += _line_findings("column C", cols)
        return findings
    for expected, answered in answers.items():
        if expected != answered:
            text = f"answers as {pixel_name(*answered)}"
            findings.append(Finding("swapped", text, pixel_name(*expected)))
    return findings


def _map_lines(answers: dict[PixelPlace, PixelPlace], *, axis: int) -> dict[int, int]:
    """Return which line answers for which, where all of a line's pixels agree."""
    seen: dict[int, set[int]] = {}
    for expected, answered in answers.items():
        seen.setdefault(expected[axis], set()).add(answered[axis])
    return {line: others.pop() for line, others in seen.items() if len(others) == 1}


def _line_findings(name: str, lines: dict[int, int]) -> Iterator[Finding]:
    for line, answered in lines.items():
        if line != answered:
            yield Finding("swapped", f"answers as {name}{answered}", f"{name}{line}")
