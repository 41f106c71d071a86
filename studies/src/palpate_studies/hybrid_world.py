"""A grasp made of recordings: a real fruit's curve, a real sheet's law and its relaxation.

The part that is ours is small, and is in this file: how a finger's force is shared among its
pixels, and that the answers of the sheet to several steps add up.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.clock import ManualClock
from palpate.sensor.array import ArrayLayout
from palpate.signal.circuit import ohm_to_volts, volts_to_counts
from palpate.twin.mechanics import Motion
from palpate.twin.world import OPEN_MM

#: A movement reaches the sheet in pieces of this length, seconds.
_TICK_S = 0.02
#: Concentration of the shares of a finger's pixels: even within about a factor of two.
_EVENNESS = 4.0
ADC_NOISE_COUNTS = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """Force over closing, from contact on, as recorded; beyond its end the force stays.

    Attributes
    ----------
    name, fruit : str
        Which recording, and of what.
    closing_mm, force_n : ndarray, shape (n,)
        Rising, from (0, 0).
    rupture_n : float
        Force at which it ruptured; infinite for what doesn't.
    """

    name: str
    fruit: str
    closing_mm: FloatArray
    force_n: FloatArray
    rupture_n: float = float("inf")


@dataclass(frozen=True, slots=True, kw_only=True)
class Lag:
    """How one hold settled.

    Attributes
    ----------
    since_s, share : ndarray, shape (n_times,)
        What share of its settled answer the sheet gives this long after a step.
    """

    since_s: FloatArray
    share: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedSheet:
    """A sheet as recorded.

    Attributes
    ----------
    rest_ohm : float
        Without load.
    load_n, log_fall : ndarray, shape (n_loads,)
        ln(rest / resistance) over load, rising, from (0, 0): a ladder of weights.
    scatter : float
        Standard deviation of ln resistance about that.
    lags : sequence of Lag
        Holds; each placement relaxes like one of them.
    """

    rest_ohm: float
    load_n: FloatArray
    log_fall: FloatArray
    scatter: float
    lags: Sequence[Lag]

    def static(self, load_n: FloatArray) -> FloatArray:
        """Return the settled ln(rest / resistance); beyond the ladder it goes on as its end."""
        inside = np.interp(load_n, self.load_n, self.log_fall)
        low, high = self.load_n[-3], self.load_n[-1]
        slope = (self.log_fall[-1] - self.log_fall[-3]) / np.log(high / low)
        return np.asarray(inside + slope * np.log(np.maximum(load_n, high) / high))


class RecordedWorld:
    """A stage (`palpate.twin.stage.Stage`) on which the recordings play.

    Parameters
    ----------
    sheet : RecordedSheet
        Of every pixel.
    layout : ArrayLayout
        Pixels and readout.
    seed : int
        Of what differs from placement to placement, and of noise.
    """

    gripper: Literal["rigid", "soft"] = "rigid"
    #: For the gripper's current, which no answer of the study rests on.
    level = "field"
    frame_rate_hz = 15.0
    oversampling = 1

    def __init__(self, sheet: RecordedSheet, *, layout: ArrayLayout, seed: int) -> None:
        self.sheet, self.layout = sheet, layout
        self.seed = self.sheet_seed = seed
        self.clock = ManualClock()
        self.watchers: list[Callable[[float], None]] = []
        self.peak_force_n = 0.0
        self._rng = np.random.default_rng([seed, 0])
        self._noise = np.random.default_rng([seed, 1])
        self._motion = Motion(start_s=0.0, from_mm=OPEN_MM, to_mm=OPEN_MM, rate_mm_per_s=1.0)
        self._now_s = 0.0
        self.place(None, size_mm=0.0)

    def place(self, curve: Curve | None, *, size_mm: float) -> None:
        """Put something between the open fingers that they touch at a width; or nothing."""
        self._curve, self._size_mm = curve, size_mm
        pixels = np.array(self.layout.finger_of_row).repeat(self.layout.cols)
        self._shares = np.empty(pixels.size)
        for finger in np.unique(pixels):
            mine = pixels == finger
            self._shares[mine] = self._rng.dirichlet(np.full(mine.sum(), _EVENNESS))
        self._gain = np.exp(self.sheet.scatter * self._rng.standard_normal(pixels.size))
        self._lag = self.sheet.lags[int(self._rng.integers(len(self.sheet.lags)))]
        self._settled = np.zeros(pixels.size)
        self._steps_s, self._steps = list[float](), list[FloatArray]()
        self.peak_force_n = 0.0

    # -- fingers ----------------------------------------------------------------------------------

    def now_s(self) -> float:
        """Return the clock's time, seconds."""
        return self.clock.now_s()

    def drive(self, target: float, *, rate: float, time_s: float | None = None) -> float:
        """Send the fingers to a width, mm and mm/s."""
        now_s = self._at(self.clock.now_s() if time_s is None else time_s)
        self._motion = Motion(
            start_s=now_s, from_mm=self._motion.width_mm(now_s), to_mm=target, rate_mm_per_s=rate
        )
        return target

    def halt(self, *, time_s: float | None = None) -> None:
        """Stop the fingers where they are."""
        now_s = self._at(self.clock.now_s() if time_s is None else time_s)
        width_mm = self._motion.width_mm(now_s)
        self._motion = Motion(start_s=now_s, from_mm=width_mm, to_mm=width_mm, rate_mm_per_s=1.0)

    def drive_value(self, time_s: float) -> float:
        """Return the present width, mm."""
        return self._motion.width_mm(self._at(time_s))

    def moving(self, time_s: float) -> bool:
        """Return whether the fingers are on their way."""
        return self._motion.end_s > self._at(time_s)

    # -- what is felt -----------------------------------------------------------------------------

    def force_n(self, time_s: float) -> float:
        """Return the force that the recording has at this closing, newtons."""
        if self._curve is None:
            return 0.0
        closing_mm = self._size_mm - self._motion.width_mm(time_s)
        return float(np.interp(closing_mm, self._curve.closing_mm, self._curve.force_n))

    def pixel_resistance_ohm(self, time_s: float) -> FloatArray:
        """Return the resistance of each pixel, shape (rows, cols)."""
        self._advance(time_s)
        fall = np.zeros(self._settled.size)
        if self._steps:
            since_s = time_s - np.array(self._steps_s)
            share = np.interp(since_s, self._lag.since_s, self._lag.share)
            fall = share @ np.array(self._steps)
        ohm = self.sheet.rest_ohm * np.exp(-fall)
        return np.asarray(ohm.reshape(self.layout.rows, self.layout.cols))

    def pixel_voltage_v(self, time_s: float) -> FloatArray:
        """Return the voltage at the converter's input for each pixel, shape (rows, cols)."""
        self._at(time_s)
        return self._volts(time_s)

    def scan(self, time_s: float) -> NDArray[np.int32]:
        """Return one scan without the firmware, shape (rows, cols)."""
        noise = ADC_NOISE_COUNTS * self._noise.standard_normal((self.layout.rows, self.layout.cols))
        volts = self._volts(time_s)
        counts = volts_to_counts(volts, divider=self.layout.divider, noise_counts=noise)
        return np.asarray(counts, dtype=np.int32)

    def _volts(self, time_s: float) -> FloatArray:
        return ohm_to_volts(self.pixel_resistance_ohm(time_s), divider=self.layout.divider)

    def _at(self, time_s: float) -> float:
        """Let the watchers see what comes before, and the sheet feel the way there."""
        for watcher in self.watchers:
            watcher(time_s)
        self._advance(time_s)
        return time_s

    def _advance(self, time_s: float) -> None:
        while self._now_s < min(time_s, self._motion.end_s):
            self._now_s = min(self._now_s + _TICK_S, time_s, self._motion.end_s)
            self._feel(self._now_s)
        self._now_s = max(self._now_s, time_s)

    def _feel(self, time_s: float) -> None:
        force_n = self.force_n(time_s)
        self.peak_force_n = max(self.peak_force_n, force_n)
        # The scatter is one of the conductance that the load adds.
        settled = np.log1p(self._gain * np.expm1(self.sheet.static(force_n * self._shares)))
        if not np.array_equal(settled, self._settled):
            self._steps_s.append(time_s)
            self._steps.append(settled - self._settled)
            self._settled = settled
