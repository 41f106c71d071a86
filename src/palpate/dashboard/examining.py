"""The doctor on the page: the sensor judged by some seconds at rest."""

from __future__ import annotations

from palpate.dashboard.language import Message
from palpate.dashboard.messages import Examine
from palpate.dashboard.station import FRAME_TIMEOUT_S, Station
from palpate.errors import DeviceTimeoutError
from palpate.sensor.health import FrameColumns, Health, examine
from palpate.sensor.health_link import LinkEvents
from palpate.sensor.serial_array import SerialArray


def look_at(order: Examine, *, station: Station) -> Health:
    """Read frames for a while, with nothing on the sensor, and judge them.

    Raises
    ------
    DeviceError
        If the sensor is silent.
    """
    array, layout = station.watched(), station.rig.array.layout
    station.catch_up()
    before = station.link_events()
    taken = [array.read(timeout_s=FRAME_TIMEOUT_S)]
    while (lasted_s := taken[-1].time_s - taken[0].time_s) < order.duration_s:
        station.guide(Message("Leave the sensor alone"), share=lasted_s / order.duration_s)
        try:
            taken.append(array.read(timeout_s=FRAME_TIMEOUT_S))
        except DeviceTimeoutError:
            break
    after = station.link_events()
    board = station.rig.array
    identity = board.identity if isinstance(board, SerialArray) else None
    return examine(
        FrameColumns.of(taken),
        layout=layout,
        known_ohm=station.source().rest_ohm,
        asked_hz=None if identity is None else identity.rate_hz,
        events=LinkEvents(
            corrupt=after.corrupt - before.corrupt,
            late=after.late - before.late,
            restarts=after.restarts - before.restarts,
            drift_ppm=after.drift_ppm,
        ),
    )
