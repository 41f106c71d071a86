"""From ADC counts to ohm: the voltage divider that reads a pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True, kw_only=True)
class Divider:
    """The divider and converter of the readout (paper, Figure 2a; defaults are the paper's).

    Attributes
    ----------
    reference_ohm : float
        The fixed resistor.
    supply_v : float
        Supply, which is also the ADC's reference.
    adc_bits : int
        Width of the converter.
    taxel_leg : {"upper", "lower"}
        Whether the pixel lies between supply and ADC (upper) or between ADC and ground (lower).
    """

    reference_ohm: float = 4700.0
    supply_v: float = 5.0
    adc_bits: int = 10
    taxel_leg: Literal["upper", "lower"] = "upper"

    @property
    def full_scale(self) -> int:
        """Counts at the supply voltage: 2 ** adc_bits."""
        return int(2**self.adc_bits)
