"""Rest values from frames without load, and their place in a calibration."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from palpate.calibration import BlockPairs, Calibration, ForcePairs, RestValues
from palpate.errors import CalibrationError
from palpate.sensor.array import ArrayLayout
from palpate.sensor.findings import pixel_name
from palpate.sensor.frame_columns import FrameColumns
from palpate.sensor.rest_baseline import check_unloaded, rest_baseline


def compute_rest(
    frames: FrameColumns, *, layout: ArrayLayout, known_ohm: NDArray[np.float64] | None = None
) -> RestValues:
    """Compute the rest values from frames without load.

    `known_ohm`: earlier rest values, used to detect a load on the sensor.

    Raises `CalibrationError` if the sensor is loaded or moved, or a pixel is open or short.
    """
    ohm, median_ohm = frames.ohm(layout=layout), frames.rest_ohm(layout=layout)
    rest = rest_baseline(ohm)
    if known_ohm is not None:
        try:
            check_unloaded(rest.rest_ohm, known_ohm=known_ohm)
        except CalibrationError as loaded:
            raise CalibrationError(
                f"{loaded} (--new); if there is no load, give --empty"
            ) from loaded
    is_dead = np.isnan(rest.rest_ohm) | np.isinf(median_ohm) | (median_ohm == 0)
    dead = [pixel_name(int(row), int(col)) for row, col in np.argwhere(is_dead)]
    if dead:
        raise CalibrationError(
            f"no rest value for {', '.join(dead)}: open or short; run `palpate doctor`"
        )
    return RestValues(
        ohm=tuple(map(tuple, rest.rest_ohm.round(3).tolist())),
        # Not a robust estimate, which is 0 if the noise is less than one count.
        spread_percent=tuple(
            map(tuple, (100.0 * ohm.std(axis=0) / rest.rest_ohm).round(4).tolist())
        ),
        frames=rest.frames,
    )


def replace_rest(
    earlier: Calibration | None, rest: RestValues, *, layout: ArrayLayout, simulated: bool
) -> Calibration:
    """Return the earlier calibration, or a new calibration, with these rest values."""
    if earlier is not None:
        # The age of a calibration is the age of its force readings, if it has any.
        made_at = earlier.made_at if earlier.force.force_n else format_now()
        return replace(earlier, rest=rest, made_at=made_at)
    return Calibration(
        sensor_id=layout.name,
        origin="simulated" if simulated else "hardware",
        layout=layout,
        rest=rest,
        force=ForcePairs(run=(), since_move_s=(), excess=(), relative_percent=(), force_n=()),
        block=BlockPairs(block_mm=(), width_mm=(), force_n=()),
        made_at=format_now(),
    )


def format_now() -> str:
    """Return the current date and time, ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="seconds")
