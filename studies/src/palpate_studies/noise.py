"""Which filter against noise, mains pick-up and motor spikes, at what delay and what error."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from palpate.arrays import FloatArray
from palpate.commands.options import JsonOption
from palpate.settling.relaxation import Relaxation
from palpate.signal.relative import CONTACT_PERCENT
from palpate_studies.contact_events import lowpass, running_median
from palpate_studies.noise_signal import CleanHold, Disturbance, clean_hold, sampled_percent
from palpate_studies.notch import notch
from palpate_studies.report import OutOption, StudyReport, Table
from palpate_studies.twin_session import HOLD_S, LEVELS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DISTURBANCES = {
    "none": Disturbance(),
    "mains 50 Hz": Disturbance(mains_hz=50.0),
    "mains 60 Hz": Disturbance(mains_hz=60.0),
    "motor spikes": Disturbance(spikes=True),
    "60 Hz and spikes": Disturbance(mains_hz=60.0, spikes=True),
}
SENSORS, FAST_HZ, SLOW_HZ, CUTOFF_S = 4, 250.0, 15.0, 2.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Chain:
    """One way to filter: a resistor and capacitor before the converter, and software after it."""

    rate_hz: float = FAST_HZ
    rc_s: float = 0.0
    software: Callable[[FloatArray, FloatArray, float], FloatArray] = lambda time_s, x, hz: x


def _notched(values: FloatArray, rate_hz: float) -> FloatArray:
    """Take both mains frequencies out: a user need not know which one is at home."""
    once = notch(values, rate_hz=rate_hz, mains_hz=50.0)
    return notch(once, rate_hz=rate_hz, mains_hz=60.0)


CHAINS = {
    "250 Hz, no filter": Chain(),
    "250 Hz, RC 20 ms": Chain(rc_s=0.02),
    "250 Hz, RC 100 ms": Chain(rc_s=0.1),
    "250 Hz, median of 5": Chain(software=lambda time_s, x, hz: running_median(x, length=5)),
    "250 Hz, low pass 50 ms": Chain(
        software=lambda time_s, x, hz: lowpass(time_s, x, time_constant_s=0.05)
    ),
    "250 Hz, notch 50 and 60 Hz": Chain(software=lambda time_s, x, hz: _notched(x, hz)),
    "250 Hz, median of 5, notch": Chain(
        software=lambda time_s, x, hz: _notched(running_median(x, length=5), hz)
    ),
    "250 Hz, median of 5, low pass 50 ms": Chain(
        software=lambda time_s, x, hz: lowpass(
            time_s, running_median(x, length=5), time_constant_s=0.05
        )
    ),
    "15 Hz, no filter": Chain(rate_hz=SLOW_HZ),
    "15 Hz, RC 100 ms": Chain(rate_hz=SLOW_HZ, rc_s=0.1),
    "15 Hz, median of 5": Chain(
        rate_hz=SLOW_HZ, software=lambda time_s, x, hz: running_median(x, length=5)
    ),
}


def command(as_json: JsonOption = False, out: OutOption = None) -> None:
    """Compare hardware and software filters on simulated holds with pick-up and spikes.

    Example: palpate study noise --out reports
    """
    report().emit(as_json=as_json, out=out)


def report(*, sensors: int = SENSORS, chains: Mapping[str, Chain] = CHAINS) -> StudyReport:
    """Run the chains under every disturbance."""
    holds = {
        level: [clean_hold(sensor, level=level) for sensor in range(sensors)] for level in LEVELS
    }
    errors = {level: _errors(holds[level], chains) for level in LEVELS}
    tables = []
    for level in LEVELS:
        rows = [
            [name, f"{_delay_ms(holds[level][0], chain):.0f}"]
            + [
                f"{errors[level][name, what][0]:.2f} / {errors[level][name, what][1]:.1f}"
                for what in DISTURBANCES
            ]
            for name, chain in chains.items()
        ]
        tables.append(
            Table(
                title=f"Level {level}: RMS error of the held change (points) / error of the "
                f"value predicted at {CUTOFF_S:g} s (%), medians",
                columns=("chain", "delay, ms", *DISTURBANCES),
                rows=rows,
            )
        )
    return StudyReport(
        name="noise",
        title="Filters against noise, mains pick-up and motor spikes",
        provenance=[
            f"Simulated: {sensors} sensors per level, one hold each, 10 bit; pick-up of 50 mV and "
            "spikes of 0.5 V for 2 ms, 8 a second, on every wire. These sizes are assumptions; the "
            "paper has no such data (its future work).",
            "Delay: how much later contact (-10 %) is seen than without filter at 250 Hz. Errors "
            "are against the noise-free signal.",
            "At 15 Hz, 60 Hz mains is seen as a constant (60 is a multiple of 15), which the rest "
            "values take out as long as the rate is exact, and 50 Hz as 5 Hz, which no notch can "
            "separate from the signal; a capacitor before the converter or a higher rate can.",
        ],
        tables=tables,
        payload={
            "study": "noise",
            "origin": "twin",
            "levels": {
                level: [
                    {
                        "chain": chain,
                        "disturbance": what,
                        "rms_points": values[0],
                        "predicted_error_percent": values[1],
                    }
                    for (chain, what), values in errors[level].items()
                ]
                for level in LEVELS
            },
            "delay_ms": {name: _delay_ms(holds["lab"][0], chain) for name, chain in chains.items()},
        },
        figures={"noise": lambda: draw(holds["lab"][0])},
    )


def _run(
    clean: CleanHold, chain: Chain, disturbance: Disturbance, *, seed: int = 0
) -> tuple[FloatArray, FloatArray]:
    time_s, percent = sampled_percent(
        clean,
        disturbance=disturbance,
        rate_hz=chain.rate_hz,
        rc_s=chain.rc_s,
        rng=np.random.default_rng(seed),
    )
    return time_s, chain.software(time_s, percent, chain.rate_hz)


def _errors(
    holds: list[CleanHold], chains: Mapping[str, Chain]
) -> dict[tuple[str, str], tuple[float, float]]:
    found = {}
    for name, chain in chains.items():
        for what, disturbance in DISTURBANCES.items():
            pairs = [
                _error(clean, *_run(clean, chain, disturbance, seed=seed))
                for seed, clean in enumerate(holds)
            ]
            rms, missed = np.median(pairs, axis=0)
            found[name, what] = (float(rms), float(missed))
    return found


def _error(clean: CleanHold, time_s: FloatArray, percent: FloatArray) -> tuple[float, float]:
    """Return the RMS error from 2 s on, and the error of the settled value predicted at 2.5 s."""
    truth = clean.percent(clean.ohm, clean.time_s)
    held = time_s > 2.0
    rms = np.sqrt(np.mean((percent - np.interp(time_s, clean.time_s, truth))[held] ** 2))
    settled = float(truth[-1])
    seen = (time_s >= 0) & (time_s <= CUTOFF_S)
    # Prediction costs with the number of samples and gains nothing beyond this many.
    thin = slice(None, None, max(1, int(seen.sum() // 60)))
    estimate = Relaxation().predict(
        time_s[seen][thin], percent[seen][None, thin], horizon_s=HOLD_S, level=0.9
    )
    return float(rms), float(100 * abs(estimate.value.item() / settled - 1))


def _delay_ms(clean: CleanHold, chain: Chain) -> float:
    """Return how much later contact is seen than with no filter at 250 Hz."""
    seen = []
    for one in (chain, Chain()):
        time_s, percent = _run(clean, one, Disturbance())
        after = time_s > 0
        seen.append(time_s[after][np.argmax(percent[after] <= CONTACT_PERCENT)])
    return float(1000 * (seen[0] - seen[1]))


def draw(clean: CleanHold) -> Figure:
    """Draw one hold with mains and spikes through four chains."""
    from palpate.plots.style import BLUE, GREY, INK, new_figure

    shown = (
        "250 Hz, no filter",
        "250 Hz, RC 20 ms",
        "250 Hz, median of 5, notch",
        "15 Hz, no filter",
    )
    truth = clean.percent(clean.ohm, clean.time_s)
    with new_figure(rows=2, columns=2, width_in=9.0, height_in=5.6) as (figure, axes):
        for axis, name in zip(axes.flat, shown, strict=True):
            time_s, percent = _run(clean, CHAINS[name], DISTURBANCES["60 Hz and spikes"])
            axis.plot(time_s, percent, color=BLUE, lw=0.7, label="read")
            axis.plot(clean.time_s, truth, color=INK, lw=1, label="without noise")
            axis.axhline(CONTACT_PERCENT, color=GREY, ls="--", lw=1, label="contact")
            axis.set(
                xlim=(-1, 4),
                ylim=(-85, 40),
                xlabel="time from actuation (s)",
                ylabel="mean change (%)",
                title=f"simulated, 60 Hz and spikes: {name}",
            )
        axes[0, 0].legend(loc="upper right", ncols=3, fontsize=7)
    return figure
