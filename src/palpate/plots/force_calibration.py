"""The data of a force calibration: readings over the reference, and the law through them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from palpate.estimate.force_law import ForceLaw
from palpate.plots.style import INK, ORANGE, log_axis, new_figure
from palpate.sensor.calibration import Calibration

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def force_calibration_figure(calibration: Calibration) -> Figure:
    """Draw excess conductance over force, on logarithmic axes.

    Raises
    ------
    MissingExtraError
        If matplotlib isn't installed.
    """
    with new_figure(width_in=6.4, height_in=4.4) as (figure, axes):
        panel = axes[0, 0]
        pairs = calibration.force
        settled = np.isclose(pairs.since_move_s, max(pairs.since_move_s))
        panel.plot(
            np.array(pairs.force_n)[settled],
            np.array(pairs.excess)[settled],
            "o",
            ms=5,
            mec=INK,
            mfc="white",
            label="settled readings",
        )
        law = calibration.force_law
        if law["law"] == "power":
            reading = np.geomspace(float(law["range"][0]), float(law["range"][1]), 100)
            log_scale, exponent, offset = law["coefficients"]
            force_n = offset + np.exp(log_scale + exponent * np.log(reading))
            panel.plot(force_n, reading, color=ORANGE, lw=1.4, label="settled law")
        if law["law"] == ForceLaw.name:
            reading = np.geomspace(0.5 * min(pairs.excess), 2.0 * max(pairs.excess), 100)
            each = [ForceLaw.from_dict(law).force(one) for one in reading.tolist()]
            panel.plot([one.value for one in each], reading, color=ORANGE, lw=1.4, label="law")
            ends = ([one.low for one in each], [one.high for one in each])
            panel.fill_betweenx(reading, *ends, color=ORANGE, alpha=0.2, label="90 % interval")
        log_axis(panel.xaxis)
        log_axis(panel.yaxis)
        panel.set(xlabel="force (N)", ylabel="excess conductance, summed over pixels")
        simulated = " (simulated)" if calibration.origin == "simulated" else ""
        panel.set_title(f"Force calibration of {calibration.sensor_id}{simulated}")
        panel.legend()
        return figure
