"""Force ceiling as a limit of single-pixel counts, checked by the board itself."""

from __future__ import annotations

import numpy as np

from palpate.calibration import Calibration
from palpate.errors import CalibrationError
from palpate.force.of_calibration import sheet_law_of
from palpate.grasp.safety import FORCE_CEILING_N
from palpate.sensor.array import ArrayLayout
from palpate.sensor.sample import SampleReader

#: Largest fraction of a finger's load on one of its pixels. With steady loads up to 80 N on the
#: twin, 11 of 13 objects at level `lab` reach the resulting limit, at 17 to 36 N. At level `field`,
#: with pixels that saturate, 7 objects reach it: one at 14 N, the others at 22 N or more.
_MAX_FRACTION = 0.5


def ceiling_counts(calibration: Calibration, *, force_n: float = FORCE_CEILING_N) -> int:
    """Return the counts of a single pixel above which a grip exceeds a force.

    The limit is the reading at which one pixel of each finger carries half of the finger's load,
    according to the law of the sheet. A load spread over more pixels reaches the limit at a
    larger force. The limit is therefore a backup: the host checks the force from all pixels first.

    Parameters
    ----------
    calibration : Calibration
        Of the sensor on this gripper.
    force_n : float
        Grip force, newtons.

    Returns
    -------
    int
        Counts per conversion, for `SetCeiling`. 0 (off) if the calibration has no force law, if
        counts fall under load (`taxel_leg` "lower"), or if no reading within the converter's range
        corresponds to that force.

    Examples
    --------
    >>> from palpate.twin.rig import calibrate_twin
    >>> calibration = calibrate_twin(seed=1, level="lab", apart_from="strawberry")
    >>> ceiling_counts(calibration, force_n=5.0), ceiling_counts(calibration)
    (502, 828)
    """
    layout, divider = calibration.layout, calibration.layout.divider
    pixel = ArrayLayout(
        name="pixel",
        rows=1,
        cols=1,
        finger_of_row=(0,),
        divider=divider,
        line_ohm=layout.line_ohm,
    )
    if divider.taxel_leg == "lower":
        return 0
    try:
        law = sheet_law_of(calibration)
    except CalibrationError:
        return 0
    counts = np.arange(1, divider.full_scale - 1)
    rest_ohm = np.asarray(calibration.rest_ohm)
    found = 0
    for row, col in np.argwhere(np.isfinite(rest_ohm)).tolist():
        excess = np.zeros((counts.size, *rest_ohm.shape))
        alone = SampleReader(pixel, rest_ohm[row, col]).read_counts(counts[:, None, None])
        excess[:, row, col] = np.maximum(alone.excess[:, 0, 0], 0.0)
        shown_n = layout.fingers / _MAX_FRACTION * law.read_settled(excess).force_n
        if not shown_n[-1] > force_n:
            return 0
        found = max(found, int(counts[np.argmax(shown_n > force_n)]))
    return found
