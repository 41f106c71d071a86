"""From a calibration to a plan: the laws that the controller reads by."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import CalibrationError
from palpate.estimate.force import PowerForceLaw
from palpate.estimate.stiffness import Give
from palpate.grasp.plan import Plan
from palpate.gripper.interface import Gripper
from palpate.sensor.calibration import Calibration, ForcePairs
from palpate.settling.relaxation import Relaxation

#: A step is read this long after its movement, in the calibration as in the grasp, because the
#: sheet lags and the two readings must lag alike.
DWELL_S = 0.4
#: When the sheet counts as settled (paper, section 2.2).
HORIZON_S = 20.0


def plan_grasp(calibration: Calibration, *, gripper: Gripper, **options: Any) -> Plan:
    """Plan a grasp with a calibrated sensor; `options` are fields of `Plan`.

    Raises
    ------
    CalibrationError
        If the calibration lacks what the grasp needs.
    """
    if gripper.limits.drive != "width":
        raise CalibrationError(
            "the gripper is driven by pressure, and the calibration's closings are widths; "
            "use a width-driven gripper"
        )
    early, settled = (
        PowerForceLaw.fit(excess, force_n=force_n)
        for excess, force_n in (
            pairs_at(calibration.force, since_move_s=since) for since in (DWELL_S, HORIZON_S)
        )
    )
    block = calibration.block
    return Plan(
        layout=calibration.layout,
        rest_ohm=calibration.rest_ohm,
        settled_law=settled,
        early_law=early,
        give=Give.fit(block.force_n, width_mm=block.width_mm, block_mm=block.block_mm),
        gripper=gripper.limits,
        settling=Relaxation(),
        dwell_s=DWELL_S,
        horizon_s=HORIZON_S,
        **options,
    )


def pairs_at(
    pairs: ForcePairs, *, since_move_s: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return excess and force of the pairs that were read so long after the movement."""
    chosen = np.isclose(pairs.since_move_s, since_move_s)
    return np.array(pairs.excess)[chosen], np.array(pairs.force_n)[chosen]
