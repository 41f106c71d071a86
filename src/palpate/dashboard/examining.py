"""The doctor on the page: the sensor judged by some seconds at rest."""

from __future__ import annotations

from palpate.dashboard.job_context import JobContext
from palpate.dashboard.orders import Examine
from palpate.errors import DeviceTimeoutError
from palpate.sensor.array import FRAME_TIMEOUT_S
from palpate.sensor.health import FrameColumns, Health, examine
from palpate.sensor.serial_array import SerialArray


def look_at(order: Examine, *, context: JobContext) -> Health:
    """Read frames for a while, with nothing on the sensor, and judge them.

    Raises
    ------
    DeviceError
        If the sensor is silent.
    """
    array, layout = context.watched(), context.rig.array.layout
    context.catch_up()
    before = context.link_events()
    taken = [array.read(timeout_s=FRAME_TIMEOUT_S)]
    while (lasted_s := taken[-1].time_s - taken[0].time_s) < order.duration_s:
        context.guide("Leave the sensor alone", share=lasted_s / order.duration_s)
        try:
            taken.append(array.read(timeout_s=FRAME_TIMEOUT_S))
        except DeviceTimeoutError:
            break
    board = context.rig.array
    identity = board.identity if isinstance(board, SerialArray) else None
    return examine(
        FrameColumns.of(taken),
        layout=layout,
        known_ohm=context.source().rest_ohm,
        asked_hz=None if identity is None else identity.rate_hz,
        events=context.link_events().since(before),
    )
