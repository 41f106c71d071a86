"""Relaxation of a held object: the fall of its force at a fixed deformation.

Nothing in the first second of a hold tells how much an object relaxes, so its fall r of ln force
from the answer to the horizon is a prior, normal and equal for all objects.
"""

from __future__ import annotations

import math
from dataclasses import replace

from palpate.measurement import Measurement

#: Mean and standard deviation of r from 0.4 to 20 s. Real holds: springs 0, silicone with carbon
#: black -0.04 to -0.1 (n = 55), a plant-based steak -0.11 to -0.15 (n = 12). Raw meat, -0.7, is
#: outside.
RELAXED, RELAXED_SD = -0.06, 0.06


def settle_force(force: Measurement, *, share: float) -> Measurement:
    """Return the force at the settling horizon, to which an unknown object relaxes at rest.

    `share`: the object's fraction of the deflection of object and hand together. A hand that gives
    way follows an object that relaxes, and the force falls by this fraction of the relaxation.

    >>> present = Measurement(value=2.0, low=1.8, high=2.2, unit="n", level=0.9)
    >>> settle_force(present, share=0.5)
    Measurement(1.941 N, 1.724 to 2.157, ok)
    """
    settled = force.scaled(math.exp(share * RELAXED), unit="n")
    settled = settled.widened(sd=share * RELAXED_SD * settled.middle)
    return replace(settled, low=max(settled.low, 0.0))
