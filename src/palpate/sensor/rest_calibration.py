"""Rest values of a stretch of frames, and the calibration that they begin or renew."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from palpate.errors import CalibrationError
from palpate.sensor.array import ArrayLayout
from palpate.sensor.calibration import BlockPairs, Calibration, ForcePairs, RestValues
from palpate.sensor.findings import pixel_name
from palpate.sensor.health import FrameColumns
from palpate.signal.relative import refuse_load, rest_baseline


def rest_values(
    stretch: FrameColumns, *, layout: ArrayLayout, known_ohm: NDArray[np.float64] | None = None
) -> RestValues:
    """Return the rest values of a stretch.

    The earlier ones, `known_ohm`, show whether the sensor is loaded.

    Raises `CalibrationError` if something presses or moves, or a pixel is open or short.
    """
    ohm, middle_ohm = stretch.ohm(layout=layout), stretch.rest_ohm(layout=layout)
    rest = rest_baseline(ohm)
    if known_ohm is not None:
        try:
            refuse_load(rest.rest_ohm, known_ohm=known_ohm)
        except CalibrationError as loaded:
            raise CalibrationError(f"{loaded} (--new); if nothing does, give --empty") from loaded
    useless = np.isnan(rest.rest_ohm) | np.isinf(middle_ohm) | (middle_ohm == 0)
    dead = [pixel_name(int(row), int(col)) for row, col in np.argwhere(useless)]
    if dead:
        raise CalibrationError(
            f"no rest value for {', '.join(dead)}: open or short; run `palpate doctor`"
        )
    return RestValues(
        ohm=tuple(map(tuple, rest.rest_ohm.round(3).tolist())),
        # The plain deviation: a robust one is 0 where the noise is within a count.
        spread_percent=tuple(
            map(tuple, (100.0 * ohm.std(axis=0) / rest.rest_ohm).round(4).tolist())
        ),
        frames=rest.frames,
    )


def with_rest(
    earlier: Calibration | None, rest: RestValues, *, layout: ArrayLayout, simulated: bool
) -> Calibration:
    """Return the earlier calibration, or a new one, with these rest values."""
    if earlier is not None:
        # The date is what its age is judged by: that of the force readings, where there are any.
        made_at = earlier.made_at if earlier.force.force_n else now_text()
        return replace(earlier, rest=rest, made_at=made_at)
    return Calibration(
        sensor_id=layout.name,
        origin="simulated" if simulated else "hardware",
        layout=layout,
        rest=rest,
        force=ForcePairs(run=(), since_move_s=(), excess=(), relative_percent=(), force_n=()),
        block=BlockPairs(block_mm=(), width_mm=(), force_n=()),
        made_at=now_text(),
    )


def now_text() -> str:
    """Return the date and time, ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="seconds")
