"""Conversion of resistances to counts: sheet noise, crosstalk, divider and ADC."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.sensor.array import ArrayLayout
from palpate.signal.circuit import ohm_to_volts, volts_to_counts
from palpate.signal.crosstalk import floating_readings_ohm
from palpate.twin.velostat import Sheet

#: Time constants of the two slow noise components, seconds.
_SLOW_NOISE_S = np.array([[0.5], [10.0]])


class Readout:
    """Noise and conversion of one sheet; the slow noise is continuous between scans."""

    def __init__(
        self,
        *,
        sheet: Sheet,
        layout: ArrayLayout,
        oversampling: int,
        adc_noise_counts: float,
        seed: int,
        start_s: float,
    ) -> None:
        self._sheet, self._layout = sheet, layout
        self._oversampling, self._adc_noise_counts = oversampling, adc_noise_counts
        self._rng = np.random.default_rng([seed, 3])
        self._slow = self._rng.standard_normal((2, layout.pixels))
        self._last_s = start_s

    def sample_volts(self, pixel_ohm: FloatArray, *, time_s: float) -> FloatArray:
        """Return the voltages at the converter's input at a time, shape (rows, cols)."""
        step_s = max(time_s - self._last_s, 0.0)
        self._last_s = time_s
        keep = np.exp(-step_s / _SLOW_NOISE_S)
        fresh = self._rng.standard_normal((3, pixel_ohm.size))
        self._slow = keep * self._slow + np.sqrt(1.0 - keep**2) * fresh[:2]
        noise = self._sheet.white_noise * fresh[2] + self._sheet.slow_noise * (
            self._slow[0] + self._slow[1]
        )
        noisy = pixel_ohm * (1.0 + noise.reshape(pixel_ohm.shape))
        leaks = self._layout.idle_lines == "floating"
        seen = floating_readings_ohm(noisy) if leaks else noisy
        return ohm_to_volts(seen, divider=self._layout.divider)

    def sample_counts(self, pixel_ohm: FloatArray, *, time_s: float) -> NDArray[np.int32]:
        """Return the counts of one scan, summed over the conversions, shape (rows, cols)."""
        volts = self.sample_volts(pixel_ohm, time_s=time_s)
        noise = self._adc_noise_counts * self._rng.standard_normal(
            (self._oversampling, *volts.shape)
        )
        each = volts_to_counts(volts, divider=self._layout.divider, noise_counts=noise)
        counts: NDArray[np.int32] = np.add.reduce(each, axis=0, dtype=np.int32)
        return counts
