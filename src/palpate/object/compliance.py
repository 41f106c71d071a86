"""Compliance of the gripper (pads, fingers and servo), measured on rigid blocks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import nnls

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError

#: Force constants of pads that bottom out; their mixture fits any smoothly stiffening curve.
_PAD_FORCES_N = np.array([0.5, 1.0, 2.0, 4.0, 8.0])

#: Smallest stiffness of an object, and largest stiffness that is distinguishable from rigid, N/mm.
SOFTEST_N_PER_MM, STIFFEST_N_PER_MM = 0.02, 500.0
#: Sizes of the blocks must differ by at least this much, mm.
_APART_MM = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Compliance:
    """Deflection of the gripper itself under a force.

    deflection(F) = slope F + sum_i pad_i (1 - exp(-F / F_i)): a spring, and pads that bottom out.
    """

    #: Compliance of fingers and servo.
    slope_mm_per_n: float
    #: Travel of each pad term.
    pad_mm: tuple[float, ...]
    #: Reported width minus true opening, without force.
    zero_mm: float
    #: Scatter of the calibration about the curve.
    residual_mm: float
    #: Largest force of the calibration.
    largest_force_n: float

    @classmethod
    def fit(cls, force_n: ArrayLike, *, width_mm: ArrayLike, block_mm: ArrayLike) -> Compliance:
        """Fit the curve to closings on a rigid block of known size.

        `force_n`: shape (n,).
        `width_mm`: shape (n,).
        `block_mm`, shape (n,) or float: True size of the block.
        Raises `CalibrationError` if there are fewer than four readings, or the width doesn't fall
        as the force rises.

        >>> force = np.array([0.0, 2.0, 4.0, 8.0])
        >>> compliance = Compliance.fit(force, width_mm=40.0 - 0.2 * force, block_mm=40.0)
        >>> round(compliance.slope_mm_per_n, 6), compliance.deflection_mm(5.0).round(6).tolist()
        (0.2, 1.0)
        """
        force = np.asarray(force_n, dtype=float)
        width, block = np.asarray(width_mm, dtype=float), np.asarray(block_mm, dtype=float)
        closed: FloatArray = block - width
        if force.size < 4 or np.ptp(force) == 0 or np.polyfit(force, closed, 1)[0] <= 0:
            raise CalibrationError(
                "compliance calibration: at least 4 closings of rising force are needed, and the "
                "width must fall as the force rises; is the block rigid and the width in mm?"
            )
        pads = -np.expm1(-force[:, None] / _PAD_FORCES_N)
        # The zero may have either sign, so it has two columns; nnls keeps all travels positive.
        design = np.column_stack([force, pads, np.ones_like(force), -np.ones_like(force)])
        found = nnls(design, closed)[0]
        residual = closed - design @ found
        freedom = max(force.size - int(np.count_nonzero(found)), 1)
        return cls(
            slope_mm_per_n=float(found[0]),
            pad_mm=tuple(found[1:-2].tolist()),
            zero_mm=float(found[-1] - found[-2]),
            residual_mm=float(np.sqrt(residual @ residual / freedom)),
            largest_force_n=float(force.max()),
        )

    def deflection_mm(self, force_n: ArrayLike) -> FloatArray:
        """Return the gripper's deflection at forces of any shape, mm."""
        force = np.asarray(force_n, dtype=float)
        pads = -np.expm1(-force[..., None] / _PAD_FORCES_N) @ np.array(self.pad_mm)
        return np.asarray(self.slope_mm_per_n * force + pads)

    @property
    def stiffest_n_per_mm(self) -> float:
        """Slope of force over closure on a rigid object after the pads have bottomed out.

        It is an upper bound for every object, because the object adds compliance in series.
        """
        return 1.0 / max(self.slope_mm_per_n, 1e-3)


@dataclass(frozen=True, slots=True, kw_only=True)
class SoftFingerCompliance:
    """Closure and compliance of pressure-driven fingers."""

    #: Free travel per pressure.
    mm_per_kpa: float
    #: Deflection under force.
    compliance: Compliance

    @classmethod
    def fit(
        cls, pressure_kpa: ArrayLike, *, force_n: ArrayLike, block_mm: ArrayLike
    ) -> SoftFingerCompliance:
        """Fit to closings on rigid blocks of at least two sizes.

        Raises `CalibrationError` if the blocks have one size, or the fingers don't close with
        rising pressure.

        >>> block_mm = np.repeat([40.0, 50.0], 5)
        >>> force_n = np.tile([0.5, 1.0, 2.0, 3.0, 4.0], 2)
        >>> bend = SoftFingerCompliance.fit((74 - block_mm + 3.5 * force_n) / 1.4, force_n=force_n,
        ...     block_mm=block_mm)
        >>> round(bend.mm_per_kpa, 3), round(bend.compliance.slope_mm_per_n, 2)
        (1.4, 3.5)
        """
        pressure, force, block = (
            np.asarray(column, dtype=float) for column in (pressure_kpa, force_n, block_mm)
        )
        if not np.ptp(block) > _APART_MM:
            raise CalibrationError(
                "pressure-driven fingers: close them on rigid blocks of two sizes, at least "
                f"{_APART_MM:g} mm apart; one size does not determine the relation of "
                "pressure to width"
            )
        design = np.column_stack([np.ones_like(force), -block, force, np.sqrt(force)])
        per_mm = float(np.linalg.lstsq(design, pressure, rcond=None)[0][1])
        if not per_mm > 0:
            raise CalibrationError(
                "pressure-driven fingers: a smaller block must be touched at a higher pressure"
            )
        compliance = Compliance.fit(force, width_mm=-pressure / per_mm, block_mm=block)
        return cls(mm_per_kpa=1.0 / per_mm, compliance=compliance)
