"""Samples: a frame's counts as pixel resistance, relative change and excess conductance.

Grasps, readings of a rig, views, calibrations and exports take a `Sample`, or the `PixelSignals` of
several frames, from a `SampleReader`. Code without a rest value (health checks, frames as a table)
calls `pixel_resistance_ohm`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.arrays import FloatArray
from palpate.sensor.array import ArrayLayout, Frame
from palpate.signal.circuit import resistance_ohm
from palpate.signal.crosstalk import unmix_floating, unmix_held

#: A pixel whose rest value is this many steps of the converter above zero is never open.
_REST_STEPS = 5
#: Largest fall of a stored relative change, whose converter is unknown.
_FULL_CHANGE_PERCENT = -99.9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PixelSignals:
    """Signals of the pixels in one frame, or in several along leading axes.

    Arrays have shape (..., rows, cols) and are read-only. A pixel is *missing* without a rest
    value, *open* with a rest value and no reading, *saturated* beyond the converter's last step.

    Attributes
    ----------
    resistance_ohm : ndarray
        Without crosstalk: inf if open or hidden, 0 if short, NaN if no set of resistances explains
        the readings.
    change_percent : ndarray
        Change relative to rest (paper, equation 1); NaN for an open or missing pixel.
    excess : ndarray
        Conductance relative to rest, minus 1. Never infinite: a saturated pixel has the value of
        the converter's last step, a lower bound. NaN for an open or missing pixel.
    saturated, open, missing : ndarray of bool
        Masks of these pixels.
    lost : ndarray of bool
        Open pixels that have a reading at rest: a broken line, not a weak contact. Their load is
        unknown.
    """

    resistance_ohm: FloatArray
    change_percent: FloatArray
    excess: FloatArray
    saturated: NDArray[np.bool_]
    open: NDArray[np.bool_]
    missing: NDArray[np.bool_]
    lost: NDArray[np.bool_]

    def __post_init__(self) -> None:
        for array in (
            *(self.resistance_ohm, self.change_percent, self.excess),
            *(self.saturated, self.open, self.missing, self.lost),
        ):
            array.flags.writeable = False

    @property
    def has_saturated(self) -> bool:
        """Whether any pixel is saturated; a force is then a lower bound."""
        return bool(self.saturated.any())

    @property
    def has_lost(self) -> bool:
        """Whether any pixel has lost its reading; a force is then a lower bound."""
        return bool(self.lost.any())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sample(PixelSignals):
    """Signals of one frame; arrays have shape (rows, cols).

    Attributes
    ----------
    time_s : float
        Scan time of the frame.
    age_s : float or None
        Time from the scan to the reading; None if the present time is unknown.
    """

    time_s: float
    age_s: float | None = None


@dataclass(frozen=True, slots=True)
class SampleReader:
    """Converts frames of one sensor to samples.

    Parameters
    ----------
    layout : ArrayLayout
        Wiring, crosstalk and converter of the sensor.
    rest_ohm : array_like, shape (rows, cols), or None
        Rest values. A pixel with NaN, zero or infinity is missing; open at rest (infinity), its
        change is -100 % with any reading. None: all pixels are missing, only resistances are known.

    Examples
    --------
    >>> from palpate.sensor.array import ArrayLayout
    >>> pad = ArrayLayout(name="pad", rows=1, cols=3, finger_of_row=(0,))
    >>> reader = SampleReader(pad, rest_ohm=[[4700.0, 4700.0, 4700.0]])
    >>> sample = reader.read(Frame(time_s=0.5, sequence=1, counts=[[768, 1023, 0]]), now_s=0.75)
    >>> sample.change_percent.round().tolist(), sample.excess.round().tolist()
    ([[-67.0, -100.0, nan]], [[2.0, 681.0, nan]])
    >>> sample.saturated.tolist(), sample.open.tolist(), sample.age_s
    ([[False, True, False]], [[False, False, True]], 0.25)
    """

    layout: ArrayLayout
    rest_ohm: ArrayLike | None = None

    def read(self, frame: Frame, *, now_s: float | None = None) -> Sample:
        """Return the sample of a frame, with its age at a present time."""
        ohm = pixel_resistance_ohm(
            frame.counts, layout=self.layout, oversampling=frame.oversampling
        )
        return Sample(
            **self._convert(ohm),
            time_s=frame.time_s,
            age_s=None if now_s is None else max(now_s - frame.time_s, 0.0),
        )

    def read_counts(
        self, counts: ArrayLike, *, oversampling: int | NDArray[np.integer[Any]] = 1
    ) -> PixelSignals:
        """Return the signals of counts, shape (..., rows, cols), as `pixel_resistance_ohm`."""
        ohm = pixel_resistance_ohm(counts, layout=self.layout, oversampling=oversampling)
        return PixelSignals(**self._convert(ohm))

    def read_ohm(self, resistance_ohm: ArrayLike) -> PixelSignals:
        """Return the signals of resistances, shape (..., rows, cols), of this sensor."""
        return PixelSignals(**self._convert(np.array(resistance_ohm, dtype=float)))

    def _convert(self, ohm: FloatArray) -> dict[str, NDArray[Any]]:
        rest = np.asarray(np.nan if self.rest_ohm is None else self.rest_ohm, dtype=float)
        least_ohm, most_ohm = self.layout.divider.least_ohm, self.layout.divider.most_ohm
        known = np.isfinite(rest) & (rest > 0)
        readable = known & np.isfinite(ohm)
        clipped = np.maximum(np.where(readable, ohm, 1.0), least_ohm)
        # An open pixel whose rest value is above the range, such as an FSR's, is at rest.
        at_rest = known & np.isposinf(ohm) & (rest > most_ohm)
        is_open, missing = known & ~readable & ~at_rest, ~known
        return {
            "resistance_ohm": ohm,
            "change_percent": relative_change_percent(ohm, rest_ohm=rest),
            "excess": np.where(readable, rest / clipped - 1.0, np.where(at_rest, 0.0, np.nan)),
            "saturated": readable & (ohm <= least_ohm),
            "open": is_open,
            "lost": is_open & (np.isnan(ohm) | (rest * _REST_STEPS < most_ohm)),
            # A copy, because the frames of a batch share the rest values.
            "missing": missing if missing.shape == ohm.shape else np.full(ohm.shape, missing),
        }


def pixel_resistance_ohm(
    counts: ArrayLike, *, layout: ArrayLayout, oversampling: int | NDArray[np.integer[Any]] = 1
) -> FloatArray:
    """Return the resistance of each pixel: inf if open or hidden, 0 if short.

    The result is NaN if no set of resistances explains the readings.

    `counts`, shape (..., rows, cols): readings, summed over `oversampling` conversions.
    `oversampling`: also an array with a number for each frame, shape (frames,).
    `layout`: provides the divider, the series resistance and the state of idle lines.
    Raises `ValueError` if the counts do not fit the layout's pixels or converter.

    Without the correction, four equal pixels behind two multiplexers read a quarter too low:

    >>> from palpate.sensor.array import ArrayLayout
    >>> bare = ArrayLayout(name="bare", rows=2, cols=2, finger_of_row=(0, 0), idle_lines="floating")
    >>> counts = [[582, 582], [582, 582]]
    >>> resistance_ohm(counts, divider=bare.divider)[0, 0].round().item()
    3569.0
    >>> pixel_resistance_ohm(counts, layout=bare)[0, 0].round().item()
    4759.0
    """
    counts = np.asarray(counts)
    if counts.shape[-2:] != (layout.rows, layout.cols):
        raise ValueError(
            f"counts of shape {counts.shape} are not frames of layout {layout.name} "
            f"({layout.rows} x {layout.cols})"
        )
    if not isinstance(oversampling, int):
        ohm = np.empty(counts.shape)
        for conversions in np.unique(oversampling):
            alike = oversampling == conversions
            ohm[alike] = pixel_resistance_ohm(
                counts[alike], layout=layout, oversampling=int(conversions)
            )
        return ohm
    reading = resistance_ohm(counts, divider=layout.divider, oversampling=oversampling)
    # The noise of a short pixel can put its reading below the resistance of the lines.
    ohm = np.maximum(reading - layout.line_ohm, 0.0)
    if layout.idle_lines == "floating":
        return unmix_floating(ohm)
    if layout.idle_lines == "held":
        return unmix_held(ohm, reference_ohm=layout.divider.reference_ohm + layout.line_ohm)
    return ohm


def relative_change_percent(resistance_ohm: ArrayLike, *, rest_ohm: ArrayLike) -> FloatArray:
    """Return 100 (R / R_rest - 1), percent (paper, equation 1).

    `resistance_ohm`, shape (..., rows, cols): readings; infinite (open) yields NaN.
    `rest_ohm`, shape (rows, cols): rest values; NaN or zero yields NaN.

    >>> relative_change_percent([[500.0, 1000.0]], rest_ohm=[[1000.0, 1000.0]]).tolist()
    [[-50.0, 0.0]]
    """
    resistance, rest = np.asarray(resistance_ohm, float), np.asarray(rest_ohm, float)
    usable = np.isfinite(resistance) & (rest > 0)
    ratio = np.where(usable, resistance, 1.0) / np.where(rest > 0, rest, 1.0)
    return np.where(usable, 100.0 * (ratio - 1.0), np.nan)


def excess_of_change(change_percent: ArrayLike) -> FloatArray:
    """Return the excess conductance of relative changes, which count as -99.9 % if larger.

    >>> excess_of_change([-50.0, 0.0]).tolist()
    [1.0, 0.0]
    """
    change = np.maximum(np.asarray(change_percent, float), _FULL_CHANGE_PERCENT)
    return np.asarray(1.0 / (1.0 + change / 100.0) - 1.0)


def change_of_excess(excess: ArrayLike) -> FloatArray:
    """Return the relative change, percent, of an excess conductance above -1.

    >>> change_of_excess([1.0, 0.0]).tolist()
    [-50.0, 0.0]
    """
    return np.asarray(100.0 * (1.0 / (1.0 + np.asarray(excess, float)) - 1.0))
