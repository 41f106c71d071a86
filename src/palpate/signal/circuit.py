"""Conversion between ADC counts and ohm: the voltage divider of a pixel.

Counts can be the sum of several conversions (oversampling). A converter code represents the middle
of its step, because the ATmega2560's ideal first transition is half a step above zero (datasheet,
"ADC Accuracy Definitions").
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.arrays import FloatArray

#: The largest converters have 32 bits.
LARGEST_ADC_BITS = 32
#: Ohm and volt: no resistor of a divider or supply is larger.
_LARGEST_VALUE = 1e9


@dataclass(frozen=True, slots=True, kw_only=True)
class Divider:
    """The divider and converter of the readout, with the paper's defaults (Figure 2a).

    Attributes
    ----------
    reference_ohm : float
        The fixed resistor.
    supply_v : float
        Supply voltage, which is also the ADC's reference voltage.
    adc_bits : int
        Resolution of the converter.
    taxel_leg : {"upper", "lower"}
        Position of the pixel: between supply and ADC (upper), or between ADC and ground (lower).
    """

    reference_ohm: float = 4700.0
    supply_v: float = 5.0
    adc_bits: int = 10
    taxel_leg: Literal["upper", "lower"] = "upper"

    def __post_init__(self) -> None:
        if not 1 <= self.adc_bits <= LARGEST_ADC_BITS:
            raise ValueError(
                f"divider: adc_bits is {self.adc_bits}; it must be from 1 to {LARGEST_ADC_BITS}"
            )
        for name in ("reference_ohm", "supply_v"):
            value = getattr(self, name)
            if not 0 < value <= _LARGEST_VALUE:
                raise ValueError(
                    f"divider: {name} is {value:g}; it must be above 0 and at most "
                    f"{_LARGEST_VALUE:g}"
                )

    @property
    def full_scale(self) -> int:
        """Counts at the supply voltage: 2 ** adc_bits."""
        return int(2**self.adc_bits)

    @property
    def least_ohm(self) -> float:
        """Smallest resistance distinct from a short: half a step from the end of the range."""
        return self.reference_ohm * 1.5 / (self.full_scale - 1.5)

    @property
    def most_ohm(self) -> float:
        """Largest resistance distinct from an open circuit, as `least_ohm`."""
        return self.reference_ohm * (self.full_scale - 1.5) / 1.5


def resistance_ohm(counts: ArrayLike, *, divider: Divider, oversampling: int = 1) -> FloatArray:
    """Convert counts to the pixel's resistance.

    R = R_ref (N / c - 1) for a pixel in the upper leg and R = R_ref c / (N - c) in the lower leg,
    where c is the mean count of one conversion. If all conversions are at an end of the range, the
    result is inf for an open pixel and 0 for a short pixel.

    Source: ATmega2560 datasheet, "ADC Conversion Result".

    `counts`, shape (..., rows, cols): readings, summed over `oversampling` conversions.
    Raises `ValueError` if a reading is outside the converter's range.

    At mid-scale both legs have equal resistance:

    >>> resistance_ohm([[512, 256, 0]], divider=Divider(reference_ohm=10e3)).tolist()
    [[10000.0, 30000.0, inf]]
    """
    counts = np.asarray(counts, dtype=np.float64)
    top = oversampling * (divider.full_scale - 1)
    if counts.size and not (counts.min() >= 0 and counts.max() <= top):
        raise ValueError(
            f"counts from {counts.min():g} to {counts.max():g} exceed the valid range 0 to {top} "
            f"({divider.adc_bits} bits x {oversampling}); check the layout's divider"
        )
    at_ground, at_supply = counts == 0, counts == top
    fraction = counts / (oversampling * divider.full_scale)
    inside = np.where(at_ground | at_supply, 0.5, fraction)
    upper = divider.taxel_leg == "upper"
    ratio = (1.0 - inside) / inside if upper else inside / (1.0 - inside)
    ohm = np.where(at_ground if upper else at_supply, np.inf, divider.reference_ohm * ratio)
    return np.where(at_supply if upper else at_ground, 0.0, ohm)


def ohm_to_volts(taxel_ohm: ArrayLike, *, divider: Divider) -> FloatArray:
    """Return the voltage at the converter's input for a pixel's resistance (0 to inf).

    >>> ohm_to_volts([4700.0, float("inf"), 0.0], divider=Divider()).tolist()
    [2.5, 0.0, 5.0]
    """
    resistance = np.asarray(taxel_ohm, dtype=np.float64)
    across_reference = divider.reference_ohm / (divider.reference_ohm + resistance)
    upper = divider.taxel_leg == "upper"
    return divider.supply_v * (across_reference if upper else 1.0 - across_reference)


def volts_to_counts(
    volts: ArrayLike, *, divider: Divider, noise_counts: ArrayLike = 0.0
) -> NDArray[np.int32]:
    """Return the counts of one conversion, with noise added before rounding.

    >>> volts_to_counts([2.5, 5.0], divider=Divider()).tolist()
    [512, 1023]
    """
    ideal = np.asarray(volts) / divider.supply_v * divider.full_scale + np.asarray(noise_counts)
    counts: NDArray[np.int32] = np.clip(np.rint(ideal), 0, divider.full_scale - 1).astype(np.int32)
    return counts


def resolution_ohm(taxel_ohm: ArrayLike, *, divider: Divider) -> FloatArray:
    """Return the change of resistance for one count.

    The change is (R + R_ref)^2 / (R_ref N) in either leg. Relative to R it is smallest at
    R = R_ref.

    `taxel_ohm`: resistance of the pixel.

    >>> resolution_ohm(4700.0, divider=Divider()).round(2).item()
    18.36
    """
    resistance = np.asarray(taxel_ohm, dtype=np.float64)
    steps = divider.reference_ohm * divider.full_scale
    return np.asarray((resistance + divider.reference_ohm) ** 2 / steps)
