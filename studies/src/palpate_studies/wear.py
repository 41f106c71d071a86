"""Wear of a sheet: how its answer to one reference load moved since the calibration."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from palpate.errors import CalibrationError

#: Beyond this change of the answer, or this much use since the last check, wear is worth a word.
ADVISED_PERCENT, ADVISED_CYCLES = 10.0, 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class WearTrack:
    """Answers to one reference load (a weight, a block at one width), in order of use.

    The answer falls fast while a sheet breaks in and slowly later, so the gain is taken as a
    straight line in ln(cycles + 1) between checks, and as constant after the last one: wear that
    nobody looked at is not guessed.

    Examples
    --------
    >>> track = WearTrack.started(cycles=0, excess=10.0).checked(cycles=500, excess=8.0)
    >>> round(track.corrected(8.0, cycles=900), 6)
    10.0
    >>> track.advice(cycles=900)
    'the reference load reads -20 % since the calibration: calibrate force again'
    """

    #: Grasps made before each check, rising.
    cycles: tuple[int, ...]
    #: Settled excess conductance of the reference load, the geometric mean of several grasps where
    #: placing it scatters; the first is that of the calibration.
    excess: tuple[float, ...]

    @classmethod
    def started(cls, *, cycles: int, excess: float) -> WearTrack:
        """Return a track that begins at the calibration."""
        return cls(cycles=(), excess=()).checked(cycles=cycles, excess=excess)

    def checked(self, *, cycles: int, excess: float) -> WearTrack:
        """Return the track with one more check.

        Raises
        ------
        CalibrationError
            If the reading shows no load, or the use counted runs backwards.
        """
        if not (np.isfinite(excess) and excess > 0):
            raise CalibrationError("wear check: the reference load reads as no load; is it there?")
        if self.cycles and cycles < self.cycles[-1]:
            raise CalibrationError(
                f"wear check: {cycles} cycles after a check at {self.cycles[-1]}; "
                "the count must rise"
            )
        return replace(self, cycles=(*self.cycles, cycles), excess=(*self.excess, excess))

    def corrected(self, excess: float, *, cycles: int) -> float:
        """Return what an excess conductance would have been at the calibration."""
        log_gain = np.interp(np.log1p(cycles), np.log1p(self.cycles), np.log(self.excess))
        return float(excess * np.exp(np.log(self.excess[0]) - log_gain))

    def advice(self, *, cycles: int) -> str:
        """Return what to do, or nothing."""
        change = 100.0 * (self.excess[-1] / self.excess[0] - 1.0)
        if abs(change) > ADVISED_PERCENT:
            return (
                f"the reference load reads {change:+.0f} % since the calibration: "
                "calibrate force again"
            )
        since = cycles - self.cycles[-1]
        if since > ADVISED_CYCLES:
            return f"{since} grasps since the last check: read the reference load again"
        return ""
