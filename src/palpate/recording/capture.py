"""From a live sensor into a recording, until told to stop."""

from __future__ import annotations

import math
from collections.abc import Callable

from palpate.clock import Clock
from palpate.errors import DeviceTimeoutError
from palpate.gripper.interface import GripperState
from palpate.recording.contents import Event, LoadCells
from palpate.recording.writer import RecordingWriter
from palpate.sensor.array import PressureArray

_TIMEOUT_S = 1.0


def capture(
    array: PressureArray,
    *,
    writer: RecordingWriter,
    clock: Clock,
    duration_s: float = math.inf,
    load_cells: Callable[[], LoadCells | None] = lambda: None,
    gripper: Callable[[], GripperState | None] = lambda: None,
    stopped: Callable[[], bool] = lambda: False,
    report: Callable[[str], None] = lambda _: None,
) -> int:
    """Record frames until the time is up, or it is stopped; return how many.

    A sensor that falls silent is waited for: it is said once, and becomes an event of the
    recording, as does its return. One that stays silent until the time is up is lost.

    Parameters
    ----------
    array : PressureArray
        An open sensor.
    writer : RecordingWriter
        Where the frames go.
    clock : Clock
        The sensor's clock.
    duration_s : float
        How long; forever by default.
    load_cells : callable
        Gives a reading of load cells if there is a new one.
    gripper : callable
        Gives the gripper's state, if there is one; recorded with each frame.
    stopped : callable
        Says whether to end, between frames: a recording is never cut within a message.
    report : callable
        Takes one line for the user.

    Raises
    ------
    DeviceError
        If the sensor is gone for good, or silent at the end.
    RecordingLostError
        If the file can't be written any more.
    """
    end_s = clock.now_s() + duration_s
    frames, silent = 0, False
    while (now_s := clock.now_s()) < end_s and not stopped():
        try:
            frame = array.read(timeout_s=min(_TIMEOUT_S, end_s - now_s))
        except DeviceTimeoutError as error:
            if not silent and clock.now_s() < end_s:
                silent = True
                writer.add(Event(time_s=clock.now_s(), name="silent", text=str(error)))
                report(str(error))
            continue
        if silent:
            silent = False
            writer.add(Event(time_s=frame.time_s, name="back"))
            report("frames come again")
        state = gripper()
        if state is not None:
            writer.add(state)
        writer.add(frame)
        frames += 1
        reading = load_cells()
        if reading is not None:
            writer.add(reading)
    if silent and not stopped():
        raise DeviceTimeoutError(
            f"the sensor was silent at the end: {frames} frames are recorded. Check cable and "
            "power, then run `palpate doctor`."
        )
    return frames
