"""How pressure-driven fingers close and give way, told by two rigid blocks of different size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from palpate.errors import CalibrationError
from palpate.estimate.stiffness import Give

#: Sizes of the blocks must differ by so much, mm.
_APART_MM = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Bend:
    """How pressure-driven fingers close, and how they give way."""

    #: How far they close per pressure while nothing is in the way.
    mm_per_kpa: float
    #: How far less under a force.
    give: Give

    @classmethod
    def fit(cls, pressure_kpa: ArrayLike, *, force_n: ArrayLike, block_mm: ArrayLike) -> Bend:
        """Fit to closings on rigid blocks of at least two sizes.

        Raises
        ------
        CalibrationError
            If the blocks are of one size, or the fingers don't close as the pressure rises.

        Examples
        --------
        >>> block_mm = np.repeat([40.0, 50.0], 5)
        >>> force_n = np.tile([0.5, 1.0, 2.0, 3.0, 4.0], 2)
        >>> bend = Bend.fit((74 - block_mm + 3.5 * force_n) / 1.4, force_n=force_n,
        ...     block_mm=block_mm)
        >>> round(bend.mm_per_kpa, 3), round(bend.give.slope_mm_per_n, 2)
        (1.4, 3.5)
        """
        pressure, force, block = (
            np.asarray(column, dtype=float) for column in (pressure_kpa, force_n, block_mm)
        )
        if not np.ptp(block) > _APART_MM:
            raise CalibrationError(
                "fingers driven by pressure: close them on rigid blocks of two sizes, at least "
                f"{_APART_MM:g} mm apart; one tells no millimetres"
            )
        design = np.column_stack([np.ones_like(force), -block, force, np.sqrt(force)])
        per_mm = float(np.linalg.lstsq(design, pressure, rcond=None)[0][1])
        if not per_mm > 0:
            raise CalibrationError(
                "fingers driven by pressure: a smaller block must be touched at a higher pressure"
            )
        give = Give.fit(force, width_mm=-pressure / per_mm, block_mm=block)
        return cls(mm_per_kpa=1.0 / per_mm, give=give)
