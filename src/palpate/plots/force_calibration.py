"""What a force calibration saw: readings beside the reference, and the law through them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from palpate.errors import needing
from palpate.files import atomic_path
from palpate.sensor.calibration import Calibration


def save_force_calibration(calibration: Calibration, *, path: Path) -> None:
    """Draw excess conductance over force, on logarithmic axes, into a file.

    Raises
    ------
    MissingExtraError
        If matplotlib isn't installed.
    """
    with needing("a plot", extra="plots"):
        from matplotlib.figure import Figure
    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    panel = figure.subplots()
    pairs = calibration.force
    settled = np.isclose(pairs.since_move_s, max(pairs.since_move_s))
    panel.plot(
        np.array(pairs.force_n)[settled],
        np.array(pairs.excess)[settled],
        "o",
        ms=5,
        mec="#222222",
        mfc="white",
        label="settled readings",
    )
    law = calibration.force_law
    if law["law"] == "power":
        reading = np.geomspace(float(law["range"][0]), float(law["range"][1]), 100)
        log_scale, exponent, offset = law["coefficients"]
        force_n = offset + np.exp(log_scale + exponent * np.log(reading))
        panel.plot(force_n, reading, color="#D55E00", lw=1.4, label="settled law")
    panel.set(xscale="log", yscale="log", xlabel="force, N", ylabel="excess conductance, summed")
    simulated = " (simulated)" if calibration.origin == "simulated" else ""
    panel.set_title(f"Force calibration of {calibration.sensor_id}{simulated}", fontsize=10)
    panel.legend(frameon=False, fontsize=8)
    panel.spines[["top", "right"]].set_visible(False)
    with atomic_path(path) as partial:
        figure.savefig(partial, dpi=150, format=path.suffix.lstrip(".") or "png")
