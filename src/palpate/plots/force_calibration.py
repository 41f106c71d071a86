"""Figure of a force calibration: readings over the reference, law and residuals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from palpate.arrays import FloatArray
from palpate.calibrate.force_law import predict_held_out
from palpate.calibration import Calibration
from palpate.force.force_law import ForceLaw
from palpate.force.of_calibration import HORIZON_S, is_made_by_weights
from palpate.force.weights_check import FEWEST_PLACEMENTS, predict_held_out_loads
from palpate.plots.style import BLUE, INK, ORANGE, log_axis, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def force_calibration_figure(calibration: Calibration) -> Figure:
    """Draw excess conductance over force, with the held-out error below.

    Raises
    ------
    CalibrationError
        If the force pairs are not sufficient for a law.
    MissingExtraError
        If matplotlib isn't installed.
    """
    with new_figure(rows=2, width_in=6.4, height_in=5.6) as (figure, axes):
        panel, below = axes[:, 0]
        pairs = calibration.force
        settled = np.isclose(pairs.since_move_s, max(pairs.since_move_s))
        excess, force_n = np.array(pairs.excess)[settled], np.array(pairs.force_n)[settled]
        panel.plot(force_n, excess, "o", ms=4, mec=INK, mfc="white", label="settled readings")
        law = calibration.force_law
        if law["law"] == ForceLaw.name:
            reading = np.geomspace(0.5 * min(pairs.excess), 2.0 * max(pairs.excess), 100)
            each = [ForceLaw.from_dict(law).force(one) for one in reading.tolist()]
            panel.plot([one.value for one in each], reading, color=ORANGE, lw=1.4, label="law")
            ends = ([one.low for one in each], [one.high for one in each])
            panel.fill_betweenx(reading, *ends, color=ORANGE, alpha=0.2, label="90 % interval")
        log_axis(panel.yaxis)
        below.sharex(panel)
        panel.set_ylabel("excess conductance")
        simulated = " (simulated)" if calibration.origin == "simulated" else ""
        panel.set_title(f"Force calibration of {calibration.sensor_id}{simulated}")
        panel.legend()
        residual_n, error_percent, unit_name = _residuals(calibration)
        below.axhline(0.0, color=INK, lw=0.8)
        below.plot(residual_n, error_percent, "o", ms=3, color=BLUE)
        log_axis(below.xaxis)
        panel.tick_params(which="both", labelbottom=False)
        below.set(xlabel="force (N)", ylabel=f"error of a\nheld-out {unit_name} (%)")
        return figure


def _residuals(calibration: Calibration) -> tuple[FloatArray, FloatArray, str]:
    """Return force, error (percent) and name of the held-out placements or loads."""
    pairs = calibration.force
    if pairs.pixel_excess and len(set(pairs.run)) >= FEWEST_PLACEMENTS:
        found = predict_held_out(calibration)
        settled = np.isclose(found.since_move_s, HORIZON_S)
        read_n, force_n = found.value_n[settled], found.force_n[settled]
        unit_name = "load" if is_made_by_weights(pairs) else "placement"
    else:
        settled = np.isclose(pairs.since_move_s, max(pairs.since_move_s))
        force_n, unit_name = np.array(pairs.force_n)[settled], "load"
        read_n = predict_held_out_loads(np.array(pairs.excess)[settled], force_n=force_n)
    return force_n, 100.0 * (read_n / np.maximum(force_n, 1e-3) - 1.0), unit_name
