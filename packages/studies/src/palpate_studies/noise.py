"""Compare filters against noise, mains pick-up and motor spikes in delay and error.

Disturbances are added to simulated holds before the converter, as at a robot's workplace.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal import iirnotch, lfilter, lfilter_zi

from palpate.arrays import FloatArray
from palpate.sensor.sample import relative_change_percent
from palpate.settling.relaxation import Relaxation
from palpate.signal.circuit import Divider, ohm_to_volts, resistance_ohm, volts_to_counts
from palpate.signal.relative import CONTACT_PERCENT, mean_change
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import LEVELS, running_median
from palpate_studies.twin_session import GAP_MM, HOLD_S, STILL_S, Session, draw_named

#: Rate of the simulated analogue signal, and rate of the twin's physics.
ANALOG_HZ, PHYSICS_HZ = 3000, 60
REST_S = 10.0
#: Amplitude of mains pick-up on the wires; rate, height and length of the spikes while the servo
#: holds: plausible for unshielded wires next to a servo, not measured.
MAINS_V, SPIKES_HZ, SPIKE_V, SPIKE_S = 0.05, 8.0, 0.5, 0.002
WHITE_V, ADC_NOISE_COUNTS = 0.002, 0.3
SENSORS, FAST_HZ, SLOW_HZ, CUTOFF_S = 4, 250.0, 15.0, 2.5
#: Quality factor of the notches: a wider notch rings for a shorter time.
_QUALITY = 2.0


#: Name -> frequency of the mains pick-up, Hz, and whether spikes are added.
DISTURBANCES = {
    "none": (0.0, False),
    "mains 50 Hz": (50.0, False),
    "mains 60 Hz": (60.0, False),
    "motor spikes": (0.0, True),
    "60 Hz and spikes": (60.0, True),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class CleanHold:
    """Rest and hold without noise.

    Attributes
    ----------
    time_s : ndarray, shape (times,)
        Times at `ANALOG_HZ`; the fingers start to close at 0.
    ohm : ndarray, shape (times, rows, cols)
        Resistances.
    divider : Divider
        Divider of the converter.
    """

    time_s: FloatArray
    ohm: FloatArray
    divider: Divider


def mean_percent(ohm: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return the mean relative change from the rest before the closing."""
    rest_ohm = np.median(ohm[time_s < -1.0], axis=0)
    return mean_change(relative_change_percent(ohm, rest_ohm=rest_ohm))


def simulate_clean_hold(sensor: int, *, level: str) -> CleanHold:
    """Simulate 10 s of rest and a 20 s hold of a silicone sheet."""
    session, obj = Session(sensor, level=level), draw_named("dragonskin-10")
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
    return CleanHold(
        time_s=fast_s, ohm=ohm.reshape(-1, layout.rows, layout.cols), divider=layout.divider
    )


def _disturb_v(time_s: FloatArray, disturbance: str, rng: np.random.Generator) -> FloatArray:
    """Return the voltage that a disturbance adds on every wire."""
    added, (mains_hz, has_spikes) = np.zeros(time_s.size), DISTURBANCES[disturbance]
    if mains_hz:
        phase = rng.uniform(0, 2 * np.pi)
        added += MAINS_V * np.sin(2 * np.pi * mains_hz * time_s + phase)
    if has_spikes:
        length = round(SPIKE_S * ANALOG_HZ)
        for start in np.flatnonzero(rng.random(time_s.size) < SPIKES_HZ / ANALOG_HZ):
            added[start : start + length] += rng.choice((-1.0, 1.0)) * SPIKE_V
    return added


@dataclass(frozen=True, slots=True, kw_only=True)
class Chain:
    """A filter chain: an RC low pass before the converter, and software after it."""

    rate_hz: float = FAST_HZ
    rc_s: float = 0.0
    #: Signal -> filtered signal.
    software: Callable[[FloatArray], FloatArray] = lambda x: x


def remove_mains(values: FloatArray) -> FloatArray:
    """Remove both mains frequencies from a signal at 250 Hz with causal filters.

    Examples
    --------
    >>> hum = np.sin(2 * np.pi * 50 * np.arange(500) / FAST_HZ)
    >>> bool(abs(remove_mains(3.0 + hum)[250:] - 3.0).max() < 1e-3)
    True
    """
    for mains_hz in (50.0, 60.0):
        numerator, denominator = iirnotch(mains_hz, _QUALITY, fs=FAST_HZ)
        start = lfilter_zi(numerator, denominator) * values[0]
        values = np.asarray(lfilter(numerator, denominator, values, zi=start)[0])
    return values


def _median_of_5(x: FloatArray) -> FloatArray:
    return running_median(x, length=5)


CHAINS = {
    "250 Hz, no filter": Chain(),
    "250 Hz, RC 20 ms": Chain(rc_s=0.02),
    "250 Hz, median of 5": Chain(software=_median_of_5),
    "250 Hz, notch 50 and 60 Hz": Chain(software=remove_mains),
    "250 Hz, median of 5, notch": Chain(software=lambda x: remove_mains(_median_of_5(x))),
    "15 Hz, no filter": Chain(rate_hz=SLOW_HZ),
    "15 Hz, RC 100 ms": Chain(rate_hz=SLOW_HZ, rc_s=0.1),
}


def report(*, sensors: int = SENSORS, chains: Mapping[str, Chain] = CHAINS) -> StudyReport:
    """Compare hardware and software filters on simulated holds with pick-up and spikes.

    Example: palpate study noise --out reports
    """
    holds = {
        level: [simulate_clean_hold(sensor, level=level) for sensor in range(sensors)]
        for level in LEVELS
    }
    delay_ms = {
        level: {name: _contact_delay_ms(holds[level][0], chain) for name, chain in chains.items()}
        for level in LEVELS
    }
    rows: dict[str, list[dict[str, Any]]] = {
        level: [
            {"chain": name, "disturbance": what, **_errors(holds[level], chain, what)}
            for name, chain in chains.items()
            for what in DISTURBANCES
        ]
        for level in LEVELS
    }
    return StudyReport(
        name="noise",
        title="Filters against noise, mains pick-up and motor spikes",
        provenance=[
            f"Simulated: {sensors} sensors per level, one hold each, 10 bit; on every wire, 50 mV "
            "of mains pick-up and 8 spikes per second of 0.5 V and 2 ms. These values are "
            "assumptions; the paper has no such data and names it as future work.",
            "Delay: time from contact (-10 %) detected without a filter at 250 Hz to contact "
            "detected with the filter. Errors are relative to the noise-free signal. A prediction "
            "starts at the contact.",
            "At 15 Hz, 60 Hz mains aliases to a constant (60 is a multiple of 15), which the rest "
            "values cancel if the rate is exact. 50 Hz aliases to 5 Hz, which a notch cannot "
            "separate from the signal; a capacitor before the converter or a higher rate can.",
        ],
        tables=[
            Table.wide(
                f"Level {level}: RMS error of the held change (points) / error of the "
                f"value predicted at {CUTOFF_S:g} s (%), medians",
                [row | {"delay_ms": delay_ms[level][row["chain"]]} for row in rows[level]],
                {"chain": "{chain}", "delay, ms": "{delay_ms:.0f}"},
                over="disturbance",
                form="{rms_points:.2f} / {predicted_error_percent:.1f}",
            )
            for level in LEVELS
        ],
        payload={
            "origin": "twin",
            "levels": rows,
            "delay_ms": delay_ms["lab"],
        },
    )


command = as_command(report)


def sample_percent(
    clean: CleanHold, chain: Chain, disturbance: str, *, seed: int = 0
) -> tuple[FloatArray, FloatArray]:
    """Disturb, low-pass, convert and filter a hold; return times and mean change."""
    rng, divider = np.random.default_rng(seed), clean.divider
    volts = ohm_to_volts(clean.ohm, divider=divider)
    volts = volts + _disturb_v(clean.time_s, disturbance, rng)[:, None, None]
    volts = volts + WHITE_V * rng.standard_normal(volts.shape)
    if chain.rc_s > 0:
        keep = np.exp(-1 / (chain.rc_s * ANALOG_HZ))
        volts = lfilter([1 - keep], [1, -keep], volts, axis=0, zi=keep * volts[:1])[0]
    every = np.round(np.arange(0, len(volts) - 1, ANALOG_HZ / chain.rate_hz)).astype(int)
    noise = ADC_NOISE_COUNTS * rng.standard_normal(volts[every].shape)
    counts = volts_to_counts(
        np.clip(volts[every], 0.0, divider.supply_v), divider=divider, noise_counts=noise
    )
    time_s = clean.time_s[every]
    return time_s, chain.software(mean_percent(resistance_ohm(counts, divider=divider), time_s))


def _errors(holds: list[CleanHold], chain: Chain, disturbance: str) -> dict[str, float]:
    """Return the median RMS error after 2 s, and the median error of the prediction."""
    pairs = []
    for seed, clean in enumerate(holds):
        time_s, percent = sample_percent(clean, chain, disturbance, seed=seed)
        truth = mean_percent(clean.ohm, clean.time_s)
        touch_s = _find_touch_s(time_s, percent)
        held, seen = time_s > 2.0, (time_s >= touch_s) & (time_s <= CUTOFF_S)
        rms = np.sqrt(np.mean((percent - np.interp(time_s, clean.time_s, truth))[held] ** 2))
        # More than 60 samples slow the prediction down without improving it.
        thin = slice(None, None, max(1, int(seen.sum() // 60)))
        estimate = Relaxation().predict(
            time_s[seen][thin], percent[seen][None, thin], horizon_s=HOLD_S, level=0.9
        )
        pairs.append((float(rms), 100 * abs(estimate.value.item() / float(truth[-1]) - 1)))
    rms_points, missed = np.median(pairs, axis=0)
    return {"rms_points": float(rms_points), "predicted_error_percent": float(missed)}


def _contact_delay_ms(clean: CleanHold, chain: Chain) -> float:
    """Return the delay of contact detection relative to 250 Hz without a filter."""
    touch_s, plain_s = (
        _find_touch_s(*sample_percent(clean, one, "none")) for one in (chain, Chain())
    )
    return 1000 * (touch_s - plain_s)


def _find_touch_s(time_s: FloatArray, percent: FloatArray) -> float:
    after = time_s > 0
    return float(time_s[after][np.argmax(percent[after] <= CONTACT_PERCENT)])
