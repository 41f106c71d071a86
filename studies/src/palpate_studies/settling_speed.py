"""How fast the settled value is predicted, and how near curve_fit ours is, in one run."""

from __future__ import annotations

import importlib.util
import platform
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import scipy
import typer
from scipy.optimize import OptimizeWarning, curve_fit

from palpate.arrays import FloatArray
from palpate.commands.options import JsonOption
from palpate.settling.predict import METHODS, method_named, predict_settled
from palpate.settling.result import Status
from palpate.settling.streaming import SettlingStream
from palpate.signal.transient import WAIT_S
from palpate_studies.report import OutOption, StudyReport, Table
from palpate_studies.settling_growth import FLOORS, draw, growth

SAMPLES = 30
CUTOFF_S = 2.5
NOISE_PERCENT = 0.03


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """How much to measure.

    Attributes
    ----------
    sizes : tuple of int
        Holds per call.
    repeats : tuple of int
        Calls per size; their median counts.
    peer_holds : int
        Holds that the peers, which take one at a time, are timed on; more are scaled up from these.
    growth : tuple of int
        Holds per call at which time and memory are compared with each other and the floors.
    """

    sizes: tuple[int, ...]
    repeats: tuple[int, ...]
    peer_holds: int
    growth: tuple[int, ...]


FULL = Plan(
    sizes=(1, 8, 10_000, 1_000_000),
    repeats=(300, 200, 9, 1),
    peer_holds=2000,
    growth=(1000, 10_000, 100_000, 1_000_000, 10_000_000),
)
QUICK = Plan(sizes=(1, 8, 1000), repeats=(50, 50, 5), peer_holds=200, growth=(1000, 10_000))


def synthetic_holds(n_holds: int, *, seed: int = 1) -> tuple[FloatArray, FloatArray]:
    """Return sampling times and single-exponential holds with noise (simulated), percent."""
    rng = np.random.default_rng(seed)
    time_s = np.linspace(0.0, CUTOFF_S, SAMPLES)
    rate = np.exp(rng.uniform(np.log(0.4), np.log(4.0), (n_holds, 1)))
    holds = rng.uniform(5.0, 40.0, (n_holds, 1)) * np.exp(-rate * time_s)
    holds += rng.uniform(-72.0, -13.0, (n_holds, 1))
    holds += rng.normal(0.0, NOISE_PERCENT, holds.shape)
    return time_s, holds


def _equation_2(since: FloatArray, a: float, rate: float, c: float) -> FloatArray:
    curve: FloatArray = a * np.exp(-rate * since) + c
    return curve


def _by_curve_fit(since: FloatArray, hold: FloatArray) -> float:
    """Return C, or NaN where curve_fit gives up."""
    try:
        found, _ = curve_fit(_equation_2, since, hold, p0=(hold[0] - hold[-1], 1.0, hold[-1]))
    except RuntimeError:
        return float("nan")
    return float(found[2])


def _lmfit_fitter() -> Callable[[FloatArray, FloatArray], float] | None:
    """Return the same fit by lmfit, or None where it is not installed."""
    if importlib.util.find_spec("lmfit") is None:
        return None
    import lmfit

    model = lmfit.Model(_equation_2)

    def fit(since: FloatArray, hold: FloatArray) -> float:
        found = model.fit(hold, since=since, a=hold[0] - hold[-1], rate=1.0, c=hold[-1])
        return float(found.params["c"].value)

    return fit


def _median_s(call: Callable[[], object], *, repeats: int) -> float:
    taken = []
    for _ in range(repeats):
        start = time.process_time()
        call()
        taken.append(time.process_time() - start)
    return float(np.median(taken))


def _peer_s(fit: Callable[[FloatArray, FloatArray], float], holds: FloatArray) -> float:
    """Return seconds per hold of a fitter that takes one hold at a time."""
    time_s = np.linspace(0.0, CUTOFF_S, SAMPLES)
    inside = time_s >= WAIT_S
    since, windows = time_s[inside], holds[:, inside]
    start = time.process_time()
    for window in windows:
        fit(since, window)
    return (time.process_time() - start) / len(windows)


def _speed_rows(plan: Plan) -> list[dict[str, Any]]:
    """Time every method and peer at every size, the peers scaled up from `plan.peer_holds`."""
    peers = {"scipy.optimize.curve_fit": _by_curve_fit, "lmfit": _lmfit_fitter()}
    time_s, all_holds = synthetic_holds(max(*plan.sizes, plan.peer_holds))
    # curve_fit is timed on either side of ours: a machine busy for a while is busy for both.
    rows = []
    for size, repeats in zip(plan.sizes, plan.repeats, strict=True):
        holds = all_holds[0] if size == 1 else all_holds[:size]
        peer_holds = all_holds[: plan.peer_holds]
        found = {n: _peer_s(f, peer_holds) * size for n, f in peers.items() if f is not None}
        for method in METHODS:
            found[method] = _median_s(
                partial(predict_settled, time_s, holds, cutoff_s=CUTOFF_S, method=method),
                repeats=repeats,
            )
        again = _peer_s(_by_curve_fit, peer_holds) * size
        found["scipy.optimize.curve_fit"] = (found["scipy.optimize.curve_fit"] + again) / 2
        rows += [
            {
                "method": name,
                "holds": size,
                "seconds": seconds,
                "holds_per_s": size / seconds,
                "times_curve_fit": found["scipy.optimize.curve_fit"] / seconds,
                "scaled": name in peers and size > plan.peer_holds,
            }
            for name, seconds in found.items()
        ]
    return rows


def _agreement(plan: Plan) -> dict[str, Any]:
    """Compare C with curve_fit's on the holds where that converges."""
    time_s, holds = synthetic_holds(plan.peer_holds, seed=2)
    inside = time_s >= WAIT_S
    theirs = np.array([_by_curve_fit(time_s[inside], hold[inside]) for hold in holds])
    ours = predict_settled(time_s, holds, cutoff_s=CUTOFF_S, method="exponential")
    converged = np.isfinite(theirs)
    stands = converged & (ours.status == Status.OK)
    difference = np.abs(ours.value - theirs)[stands] / np.abs(theirs[stands])
    return {
        "holds": len(holds),
        "curve_fit_converged": int(converged.sum()),
        "compared": int(stands.sum()),
        "median_relative_difference": float(np.median(difference)),
        "p99_relative_difference": float(np.quantile(difference, 0.99)),
        "max_relative_difference": float(difference.max()),
    }


def _streaming_rows() -> list[dict[str, Any]]:
    """Time one update with all methods on, after 2 s and after 17 s of 15 frames a second."""
    rows = []
    rng = np.random.default_rng(3)
    for channels in (8, 12):
        for samples in (SAMPLES, 255):
            stream = SettlingStream(
                channels=channels, methods={name: method_named(name) for name in METHODS}
            )
            taken = []
            for step in range(samples):
                now_s = step / 15
                frame = 20 * np.exp(-1.5 * now_s) - 60 + rng.normal(0, 0.1, channels)
                start = time.process_time()
                stream.push(now_s, frame)
                taken.append(time.process_time() - start)
            recent = taken[-SAMPLES // 2 :]
            rows.append(
                {
                    "channels": channels,
                    "samples_in_history": samples,
                    "update_ms": float(np.median(recent)) * 1e3,
                }
            )
    return rows


def _machine() -> str:
    cpu_info = Path("/proc/cpuinfo")
    names = (
        [
            line.split(":", 1)[1].strip()
            for line in cpu_info.read_text().splitlines()
            if line.startswith("model name")
        ]
        if cpu_info.exists()
        else []
    )
    cpu = names[0] if names else platform.processor() or platform.machine()
    return (
        f"{cpu}, {len(names) or '?'} cores; Python {platform.python_version()}, "
        f"NumPy {np.__version__}, SciPy {scipy.__version__}"
    )


def command(
    quick: Annotated[
        bool, typer.Option("--quick", help="Smaller batches and fewer repeats: some seconds.")
    ] = False,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Measure speed, memory and agreement with other libraries.

    Example: palpate bench settling --quick
    """
    measure(QUICK if quick else FULL).emit(as_json=as_json, out=out)


def measure(plan: Plan) -> StudyReport:
    """Run the benchmark."""
    with warnings.catch_warnings():
        # curve_fit warns where a hold leaves its covariance open; only its parameters count here.
        warnings.simplefilter("ignore", OptimizeWarning)
        speed, agreement = _speed_rows(plan), _agreement(plan)
    streaming = _streaming_rows()
    grown = growth(plan.growth, holds=synthetic_holds, cutoff_s=CUTOFF_S)
    provenance = [
        f"Simulated holds: one exponential, {SAMPLES} samples in {CUTOFF_S:g} s on a shared grid, "
        f"noise {NOISE_PERCENT:g} %. Speed only; it shows nothing of accuracy on a sensor.",
        f"curve_fit and lmfit take one hold at a time: timed on {plan.peer_holds} holds and scaled "
        "to the size of each row.",
        f"Medians of {', '.join(map(str, plan.repeats))} calls per size, on one sampling grid: "
        f"what depends on the grid alone is worked out in the first call. {_machine()}.",
        "Processor time of this process: what else the machine does is not counted.",
    ]
    if not any(row["method"] == "lmfit" for row in speed):
        provenance.append("lmfit is not installed, so it is not timed: `pip install lmfit`.")
    return StudyReport(
        name="bench-settling",
        title="Speed of the settled-value predictors",
        provenance=provenance,
        tables=_tables(speed, agreement, streaming, grown),
        payload={
            "speed": speed,
            "agreement": agreement,
            "streaming": streaming,
            "growth": grown,
            "notes": provenance,
        },
        figures={"bench-settling": lambda: draw(grown)},
    )


def _tables(
    speed: Sequence[dict[str, Any]],
    agreement: dict[str, Any],
    streaming: Sequence[dict[str, Any]],
    grown: Sequence[dict[str, Any]],
) -> list[Table]:
    return [
        Table(
            title="Holds per second of processor time",
            columns=("holds", "method", "seconds", "holds/s", "x curve_fit"),
            rows=[
                (
                    f"{row['holds']:,}",
                    row["method"] + (" (scaled)" if row["scaled"] else ""),
                    f"{row['seconds']:.3g}",
                    f"{row['holds_per_s']:,.0f}",
                    f"{row['times_curve_fit']:.3g}",
                )
                for row in speed
            ],
        ),
        Table(
            title="Agreement of C with curve_fit, relative",
            columns=("holds", "curve_fit converged", "compared", "median", "p99", "largest"),
            rows=[
                (
                    *(str(agreement[key]) for key in ("holds", "curve_fit_converged", "compared")),
                    *(
                        f"{agreement[f'{key}_relative_difference']:.1e}"
                        for key in ("median", "p99", "max")
                    ),
                )
            ],
        ),
        Table(
            title="One streaming update, all methods on",
            columns=("pixels", "frames so far", "ms"),
            rows=[
                (str(r["channels"]), str(r["samples_in_history"]), f"{r['update_ms']:.2f}")
                for r in streaming
            ],
        ),
        Table(
            title="Growth of processor time and memory",
            columns=("holds", "method", "s", "x matrix product", "MB beyond input", "MB of result"),
            rows=[_grown(row, grown) for row in grown],
        ),
    ]


def _grown(row: dict[str, Any], grown: Sequence[dict[str, Any]]) -> tuple[str, ...]:
    [floor] = [
        one["seconds"]
        for one in grown
        if one["method"] == FLOORS[0] and one["holds"] == row["holds"]
    ]
    return (
        f"{row['holds']:,}",
        row["method"],
        f"{row['seconds']:.3g}",
        f"{row['seconds'] / floor:.1f}",
        *("" if row[n] is None else f"{row[n]:.1f}" for n in ("peak_beyond_input_mb", "result_mb")),
    )
