"""The object's own stiffness: pads, fingers and servo measured on a rigid block and taken out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import nnls

from palpate.errors import CalibrationError

FloatArray = NDArray[np.float64]

#: Forces over which a pad bottoms out; their mixture makes any curve that stiffens smoothly.
_PAD_FORCES_N = np.array([0.5, 1.0, 2.0, 4.0, 8.0])


@dataclass(frozen=True, slots=True, kw_only=True)
class Give:
    """How far the gripper itself gives way under a force.

    give(F) = slope F + sum_i pad_i (1 - exp(-F / F_i)): a spring, and pads that bottom out.
    """

    #: Fingers and servo.
    slope_mm_per_n: float
    #: Travel of each pad term.
    pad_mm: tuple[float, ...]
    #: Reported width minus the true opening, without force.
    zero_mm: float
    #: Scatter of the calibration about this curve.
    residual_mm: float
    #: Largest force of the calibration.
    largest_force_n: float

    @classmethod
    def fit(cls, force_n: ArrayLike, *, width_mm: ArrayLike, block_mm: ArrayLike) -> Give:
        """Fit the curve to closings on a rigid block of known size.

        Parameters
        ----------
        force_n : array_like, shape (n,)
            Grip force.
        width_mm : array_like, shape (n,)
            Width that the gripper reported.
        block_mm : array_like, shape (n,) or float
            True size of the block.

        Raises
        ------
        CalibrationError
            If there are fewer than four readings, or the width doesn't fall as the force rises.

        Examples
        --------
        >>> force = np.array([0.0, 2.0, 4.0, 8.0])
        >>> give = Give.fit(force, width_mm=40.0 - 0.2 * force, block_mm=40.0)
        >>> round(give.slope_mm_per_n, 6), give.give_mm(5.0).round(6).tolist()
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
        # The zero may have either sign, so it enters twice; nnls keeps every travel positive.
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

    def give_mm(self, force_n: ArrayLike) -> FloatArray:
        """Return how far the gripper gives way, mm, of the shape of the forces."""
        force = np.asarray(force_n, dtype=float)
        pads = -np.expm1(-force[..., None] / _PAD_FORCES_N) @ np.array(self.pad_mm)
        return np.asarray(self.slope_mm_per_n * force + pads)

    @property
    def stiffest_n_per_mm(self) -> float:
        """Slope of force over closure on a rigid object, once the pads have bottomed out.

        An upper bound for every object: whatever is gripped only makes the series softer.
        """
        return 1.0 / max(self.slope_mm_per_n, 1e-3)


#: Nothing softer is an object, and nothing stiffer can be told from rigid by such a gripper, N/mm.
SOFTEST_N_PER_MM, STIFFEST_N_PER_MM = 0.02, 500.0
