"""The twin measured as the real recordings were: ladders of loads, presses, holds."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from palpate.holds import Hold
from palpate.sensor.array import ArrayLayout
from palpate.signal.circuit import Divider
from palpate.signal.relative import excess_conductance
from palpate_studies.press_data import Press, Trace
from palpate_studies.realism_quantities import HORIZON_S, SMALLEST_N, Ladder
from palpate_studies.twin_session import SPEED_MM_PER_S, STILL_S, Session, drawn

#: A converter fine enough not to add to the sheet's own scatter.
FINE = ArrayLayout(
    name="fine", rows=4, cols=2, finger_of_row=(0, 0, 1, 1), divider=Divider(adc_bits=16)
)
#: Closures on springs that give about 0.5 to 12 N, and about 7 N; on a ball for holds.
LADDER_MM = tuple(np.geomspace(0.3, 4.2, 18))
PRESS_MM, WEIGHT_MM = 3.0, 2.5
#: The real ladders were read 5-15 s after loading.
LADDER_HOLD_S = 10.0
PRESS_S, PRESS_MM_PER_S = 2.0, 10.0


def twin_ladder(sensor: int, *, level: str) -> Ladder:
    """Load one sensor in steps, each seated again, and read it 10 s after loading."""
    session, springs = Session(sensor, level=level, layout=FINE), drawn("springs-8", seed=1)
    pairs = []
    for closure_mm in LADDER_MM:
        session.place(springs)
        width_mm = springs.size_mm - closure_mm
        reading = session.grasp(springs.size_mm, width_mm=width_mm, hold_s=LADDER_HOLD_S)
        pairs.append((reading.force_n, reading.excess))
    load, excess = np.array(pairs).T
    kept = (load > SMALLEST_N) & (excess > 0)
    return load[kept], excess[kept]


def twin_presses(sensor: int, *, level: str, count: int) -> tuple[list[Press], list[Press]]:
    """Press one sensor `count` times with a flat face, as one pixel and as all of them see it.

    A real indenter presses one place after another of a sheet that is a single pixel. Here the
    pixels stand for the places, one in each press; the sum over all of them averages places.
    """
    session, face = Session(sensor, level=level, layout=FINE, trial=1), drawn("springs-8", seed=1)
    one: list[Press] = []
    summed: list[Press] = []
    for number in range(count):
        session.place(face)
        trace_of = _press(session, face.size_mm)
        for found, pixels in ((one, [number % FINE.pixels]), (summed, range(FINE.pixels))):
            trace = trace_of(pixels)
            found.append(
                Press(
                    recording_id=str(sensor),
                    press=number,
                    trace=trace,
                    last_held=len(trace.time_s) - 1,
                )
            )
    return one, summed


def _press(session: Session, size_mm: float) -> Callable[[Sequence[int]], Trace]:
    """Press once; what is returned gives the trace of the sum over some of the pixels."""
    session.close_to(size_mm + 1.0)
    session.world.clock.sleep_s(STILL_S)
    rest_ohm = session.mean_ohm()
    session.close_to(size_mm - PRESS_MM, speed_mm_per_s=PRESS_MM_PER_S)
    ohm, cell, clock = [], [], []
    until_s = session.world.clock.now_s() + PRESS_S
    while session.world.clock.now_s() < until_s:
        ohm.append(session.read(1 / session.world.frame_rate_hz)[-1])
        cell.append(session.cell.read_n())
        clock.append(session.world.clock.now_s())
    excess = excess_conductance(ohm, rest_ohm=rest_ohm).reshape(len(ohm), -1)
    force_n = np.array(cell)

    def trace(pixels: Sequence[int]) -> Trace:
        return Trace(
            time_s=np.array(clock),
            excess=excess[:, list(pixels)].sum(axis=1),
            force_n=force_n,
            first=int(np.argmax(force_n > SMALLEST_N)),
            told=int(np.argmax(force_n >= 0.95 * force_n.max())),
            group=str(session.world.sheet_seed),
        )

    return trace


def twin_weights(sensor: int, *, level: str, count: int) -> list[Hold]:
    """Hold a ball for 20 s, `count` times; pixels in parallel, ohm, time 0 where the fingers stop.

    The real recordings begin there too: their loggers missed the contact, or were strained already.
    """
    session, ball = Session(sensor, level=level, layout=FINE, trial=2), drawn("ball-44lbs", seed=1)
    holds = []
    for number in range(count):
        session.place(ball)
        session.close_to(ball.size_mm + 1.0)
        session.world.clock.sleep_s(STILL_S)
        session.close_to(ball.size_mm - WEIGHT_MM)
        ohm = 1.0 / np.mean(1.0 / session.read(HORIZON_S + 1.0), axis=(1, 2))
        time_s = np.arange(len(ohm)) / session.world.frame_rate_hz
        peak = int(np.searchsorted(time_s, (1.0 + WEIGHT_MM) / SPEED_MM_PER_S))
        holds.append(
            Hold(
                hold_id=f"{sensor}_h{number:02}",
                channel=None,
                time_s=time_s[peak:] - time_s[peak],
                values=ohm[peak:],
            )
        )
    return holds
