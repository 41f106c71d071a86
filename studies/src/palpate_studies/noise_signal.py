"""A simulated hold on its way to the converter, with the disturbances of a robot's workplace."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from palpate.arrays import FloatArray
from palpate.signal.circuit import ohm_to_volts, resistance_ohm, volts_to_counts
from palpate.signal.relative import mean_change, relative_change_percent
from palpate_studies.twin_session import GAP_MM, HOLD_S, STILL_S, Session, drawn

#: Rate at which the signal before the converter is made, and that of the twin's physics below it.
ANALOG_HZ, PHYSICS_HZ = 3000, 60
REST_S = 10.0
#: Amplitude of mains pick-up on the wires, spikes per second while the servo holds, their height
#: and length: plausible for unshielded wires next to a servo, not measured.
MAINS_V, SPIKES_HZ, SPIKE_V, SPIKE_S = 0.05, 8.0, 0.5, 0.002
WHITE_V, ADC_NOISE_COUNTS = 0.002, 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbance:
    """Noise added to the signal before the converter."""

    mains_hz: float = 0.0
    spikes: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class CleanHold:
    """Rest and hold without noise.

    Attributes
    ----------
    time_s : ndarray, shape (times,)
        At `ANALOG_HZ`; the fingers set out at 0.
    ohm : ndarray, shape (times, rows, cols)
        Resistances.
    session : Session
        Whose divider reads them.
    """

    time_s: FloatArray
    ohm: FloatArray
    session: Session

    def percent(self, ohm: FloatArray, time_s: FloatArray) -> FloatArray:
        """Return the mean relative change, the rest taken from before the closing."""
        rest_ohm = np.median(ohm[time_s < -1.0], axis=0)
        return mean_change(relative_change_percent(ohm, rest_ohm=rest_ohm))


def clean_hold(sensor: int, *, level: str) -> CleanHold:
    """Make 10 s of rest and 20 s of holding a silicone sheet."""
    session, obj = Session(sensor, level=level), drawn("dragonskin-10", seed=1)
    session.place(obj)
    session.close_to(obj.size_mm + GAP_MM)
    session.world.clock.sleep_s(STILL_S)
    start_s = session.world.clock.now_s()
    slow_s = np.arange(-REST_S, HOLD_S, 1 / PHYSICS_HZ)
    rows: list[FloatArray] = []
    for time_s in slow_s:
        now_s = start_s + REST_S + time_s
        session.world.clock.sleep_s(max(now_s - session.world.clock.now_s(), 0.0))
        if time_s >= 0 and len(rows) == np.searchsorted(slow_s, 0.0):
            session.close_to(obj.size_mm - 3.0)
        rows.append(session.world.pixel_resistance_ohm(session.world.clock.now_s()).ravel())
    fast_s = np.arange(slow_s[0], slow_s[-1], 1 / ANALOG_HZ)
    ohm = np.stack([np.interp(fast_s, slow_s, pixel) for pixel in np.array(rows).T], axis=1)
    layout = session.world.layout
    return CleanHold(time_s=fast_s, ohm=ohm.reshape(-1, layout.rows, layout.cols), session=session)


def sample_percent(
    clean: CleanHold,
    *,
    disturbance: Disturbance,
    rate_hz: float,
    rc_s: float,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Disturb, pass an RC low pass (none if `rc_s` is 0), convert; times and mean change."""
    divider = clean.session.world.layout.divider
    volts = ohm_to_volts(clean.ohm, divider=divider)
    volts = volts + _added_v(clean.time_s, disturbance, rng)[:, None, None]
    volts = volts + WHITE_V * rng.standard_normal(volts.shape)
    if rc_s > 0:
        keep = np.exp(-1 / (rc_s * ANALOG_HZ))
        start = keep * volts[:1]
        volts = lfilter([1 - keep], [1, -keep], volts, axis=0, zi=start)[0]
    every = np.round(np.arange(0, len(volts) - 1, ANALOG_HZ / rate_hz)).astype(int)
    noise = ADC_NOISE_COUNTS * rng.standard_normal(volts[every].shape)
    counts = volts_to_counts(
        np.clip(volts[every], 0.0, divider.supply_v), divider=divider, noise_counts=noise
    )
    time_s = clean.time_s[every]
    return time_s, clean.percent(resistance_ohm(counts, divider=divider), time_s)


def _added_v(time_s: FloatArray, disturbance: Disturbance, rng: np.random.Generator) -> FloatArray:
    added = np.zeros(time_s.size)
    if disturbance.mains_hz:
        phase = rng.uniform(0, 2 * np.pi)
        added += MAINS_V * np.sin(2 * np.pi * disturbance.mains_hz * time_s + phase)
    if disturbance.spikes:
        length = round(SPIKE_S * ANALOG_HZ)
        starts = np.flatnonzero(rng.random(time_s.size) < SPIKES_HZ / ANALOG_HZ)
        for start in starts:
            added[start : start + length] += rng.choice((-1.0, 1.0)) * SPIKE_V
    return added
