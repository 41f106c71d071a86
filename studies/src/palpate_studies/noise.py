"""Which filter against noise, mains pick-up and motor spikes, at what delay and what error."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal import iirnotch, lfilter, lfilter_zi

from palpate.arrays import FloatArray
from palpate.settling.relaxation import Relaxation
from palpate.signal.relative import CONTACT_PERCENT
from palpate_studies.contact_events import running_median
from palpate_studies.noise_signal import CleanHold, Disturbance, clean_hold, sample_percent
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import LEVELS
from palpate_studies.twin_session import HOLD_S

DISTURBANCES = {
    "none": Disturbance(),
    "mains 50 Hz": Disturbance(mains_hz=50.0),
    "mains 60 Hz": Disturbance(mains_hz=60.0),
    "motor spikes": Disturbance(spikes=True),
    "60 Hz and spikes": Disturbance(mains_hz=60.0, spikes=True),
}
SENSORS, FAST_HZ, SLOW_HZ, CUTOFF_S = 4, 250.0, 15.0, 2.5
#: Frequency of a notch over its width: a wider notch rings for less time.
_QUALITY = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Chain:
    """One way to filter: a resistor and capacitor before the converter, and software after it."""

    rate_hz: float = FAST_HZ
    rc_s: float = 0.0
    #: Signal -> filtered signal.
    software: Callable[[FloatArray], FloatArray] = lambda x: x


def notch(values: FloatArray) -> FloatArray:
    """Take both mains frequencies out of a signal at 250 Hz, causally.

    Examples
    --------
    >>> hum = np.sin(2 * np.pi * 50 * np.arange(500) / FAST_HZ)
    >>> bool(abs(notch(3.0 + hum)[250:] - 3.0).max() < 1e-3)
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
    "250 Hz, notch 50 and 60 Hz": Chain(software=notch),
    "250 Hz, median of 5, notch": Chain(software=lambda x: notch(_median_of_5(x))),
    "15 Hz, no filter": Chain(rate_hz=SLOW_HZ),
    "15 Hz, RC 100 ms": Chain(rate_hz=SLOW_HZ, rc_s=0.1),
}


def report(*, sensors: int = SENSORS, chains: Mapping[str, Chain] = CHAINS) -> StudyReport:
    """Compare hardware and software filters on simulated holds with pick-up and spikes.

    Example: palpate study noise --out reports
    """
    holds = {
        level: [clean_hold(sensor, level=level) for sensor in range(sensors)] for level in LEVELS
    }
    delay_ms = {
        level: {name: _delay_ms(holds[level][0], chain) for name, chain in chains.items()}
        for level in LEVELS
    }
    rows: dict[str, list[dict[str, Any]]] = {
        level: [
            {"chain": name, "disturbance": what, **_errors(holds[level], chain, disturbance)}
            for name, chain in chains.items()
            for what, disturbance in DISTURBANCES.items()
        ]
        for level in LEVELS
    }
    return StudyReport(
        name="noise",
        title="Filters against noise, mains pick-up and motor spikes",
        provenance=[
            f"Simulated: {sensors} sensors per level, one hold each, 10 bit; pick-up of 50 mV and "
            "spikes of 0.5 V for 2 ms, 8 a second, on every wire. These sizes are assumptions; the "
            "paper has no such data (its future work).",
            "Delay: how much later contact (-10 %) is seen than without filter at 250 Hz. Errors "
            "are against the noise-free signal. A prediction starts at the contact.",
            "At 15 Hz, 60 Hz mains is seen as a constant (60 is a multiple of 15), which the rest "
            "values take out as long as the rate is exact, and 50 Hz as 5 Hz, which no notch can "
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
            "study": "noise",
            "origin": "twin",
            "levels": rows,
            "delay_ms": delay_ms["lab"],
        },
    )


command = as_command(report)


def _run(
    clean: CleanHold, chain: Chain, disturbance: Disturbance, *, seed: int = 0
) -> tuple[FloatArray, FloatArray]:
    time_s, percent = sample_percent(
        clean,
        disturbance=disturbance,
        rate_hz=chain.rate_hz,
        rc_s=chain.rc_s,
        rng=np.random.default_rng(seed),
    )
    return time_s, chain.software(percent)


def _errors(holds: list[CleanHold], chain: Chain, disturbance: Disturbance) -> dict[str, float]:
    """Return the RMS error from 2 s on and that of the value predicted at 2.5 s, medians."""
    pairs = []
    for seed, clean in enumerate(holds):
        time_s, percent = _run(clean, chain, disturbance, seed=seed)
        truth = clean.percent(clean.ohm, clean.time_s)
        touch_s = _find_touch_s(time_s, percent)
        held, seen = time_s > 2.0, (time_s >= touch_s) & (time_s <= CUTOFF_S)
        rms = np.sqrt(np.mean((percent - np.interp(time_s, clean.time_s, truth))[held] ** 2))
        # Prediction costs with the number of samples and gains nothing beyond this many.
        thin = slice(None, None, max(1, int(seen.sum() // 60)))
        estimate = Relaxation().predict(
            time_s[seen][thin], percent[seen][None, thin], horizon_s=HOLD_S, level=0.9
        )
        pairs.append((float(rms), 100 * abs(estimate.value.item() / float(truth[-1]) - 1)))
    rms_points, missed = np.median(pairs, axis=0)
    return {"rms_points": float(rms_points), "predicted_error_percent": float(missed)}


def _delay_ms(clean: CleanHold, chain: Chain) -> float:
    """Return how much later contact is seen than with no filter at 250 Hz."""
    seen = []
    for one in (chain, Chain()):
        time_s, percent = _run(clean, one, Disturbance())
        seen.append(_find_touch_s(time_s, percent))
    return 1000 * (seen[0] - seen[1])


def _find_touch_s(time_s: FloatArray, percent: FloatArray) -> float:
    after = time_s > 0
    return float(time_s[after][np.argmax(percent[after] <= CONTACT_PERCENT)])
