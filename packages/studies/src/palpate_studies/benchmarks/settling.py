"""Speed of the settling predictors, compared with curve_fit on one hold at a time."""

from __future__ import annotations

import warnings
from functools import partial
from itertools import count

import numpy as np
from scipy.optimize import OptimizeWarning, curve_fit

from palpate.arrays import FloatArray
from palpate.measurement import Status
from palpate.settling.predict import predict_settled
from palpate.signal.transient import WAIT_S
from palpate_studies.benchmarks.running import Measured, Ratio, command_of, side_by_side_s

CURVE_FIT = "scipy.optimize.curve_fit"
#: Method and holds per call -> required speed relative to curve_fit.
WANTED = {
    ("exponential", 10_000): 78.0,
    ("relaxation", 1): 1.0,
    ("relaxation", 10_000): 60.0,
}
NEW_GRID_WANTED = 1.0
#: Properties of the drawn holds.
SAMPLES, CUTOFF_S, NOISE_PERCENT = 30, 2.5, 0.03
NOTE = (
    f"Simulated holds: one exponential, {SAMPLES} samples in {CUTOFF_S:g} s on a shared grid, "
    f"noise {NOISE_PERCENT:g} %. Speed only; the accuracy on a sensor is not tested."
)


def measure(full: bool) -> Measured:
    """Time single holds, batches, and new sampling grids."""
    sizes = (1, 8, 10_000, 100_000) if full else (1, 8, 10_000)
    peer_holds = 2000 if full else 300
    time_s, holds = synthetic_holds(max(sizes))
    with warnings.catch_warnings():
        # curve_fit warns if it cannot estimate the covariance, which is not used here.
        warnings.simplefilter("ignore", OptimizeWarning)
        ratios = [
            _compare_on_known_grid(method, time_s=time_s, holds=holds[:size], peer_holds=peer_holds)
            for size in sizes
            for method in ("exponential", "relaxation")
        ]
        ratios.append(_compare_on_new_grid(holds[0]))
        agreement = _describe_agreement(peer_holds)
    scaled = f"curve_fit fits one hold at a time: timed on at most {peer_holds} holds and scaled."
    return ratios, [NOTE, scaled, agreement]


command = command_of("settling")


def synthetic_holds(n_holds: int, *, seed: int = 1) -> tuple[FloatArray, FloatArray]:
    """Return sampling times and single-exponential holds with noise, percent.

    Examples
    --------
    >>> time_s, holds = synthetic_holds(3)
    >>> time_s.shape, holds.shape
    ((30,), (3, 30))
    """
    rng = np.random.default_rng(seed)
    time_s = np.linspace(0.0, CUTOFF_S, SAMPLES)
    rate = np.exp(rng.uniform(np.log(0.4), np.log(4.0), (n_holds, 1)))
    holds = rng.uniform(5.0, 40.0, (n_holds, 1)) * np.exp(-rate * time_s)
    holds += rng.uniform(-72.0, -13.0, (n_holds, 1))
    holds += rng.normal(0.0, NOISE_PERCENT, holds.shape)
    return time_s, holds


def _compare_on_known_grid(
    method: str, *, time_s: FloatArray, holds: FloatArray, peer_holds: int
) -> Ratio:
    """Compare a method with curve_fit on a grid whose weights are cached."""
    size, some = len(holds), holds[:peer_holds]
    ours = partial(predict_settled, time_s, holds, cutoff_s=CUTOFF_S, method=method)
    ours()
    ours_s, theirs_s = side_by_side_s(
        ours, partial(_fit_each, time_s, some), repeats=100 if size < 100 else 3
    )
    return Ratio(
        what=f"{method}, known grid",
        size=size,
        of="holds",
        peer=CURVE_FIT,
        ours=ours_s,
        theirs=theirs_s * size / len(some),
        wanted=WANTED.get((method, size)),
    )


def _compare_on_new_grid(hold: FloatArray) -> Ratio:
    """Compare single holds that each have a new sampling grid."""
    time_s = np.linspace(0.0, CUTOFF_S, SAMPLES)
    stretch = (1 + 1e-6 * step for step in count(1))
    ours_s, theirs_s = side_by_side_s(
        lambda: predict_settled(time_s * next(stretch), hold, cutoff_s=2 * CUTOFF_S),
        partial(_fit_each, time_s, hold[None]),
        repeats=100,
    )
    return Ratio(
        what="relaxation, new grid",
        size=1,
        of="holds",
        peer=CURVE_FIT,
        ours=ours_s,
        theirs=theirs_s,
        wanted=NEW_GRID_WANTED,
    )


def _describe_agreement(n_holds: int) -> str:
    """Describe the difference between C and curve_fit's C for holds where both converge."""
    time_s, holds = synthetic_holds(n_holds, seed=2)
    since = time_s[time_s >= WAIT_S]
    theirs = np.array([fit_curve(since, hold[-since.size :]) for hold in holds])
    ours = predict_settled(time_s, holds, cutoff_s=CUTOFF_S, method="exponential")
    both = np.isfinite(theirs) & (ours.status == Status.OK)
    difference = np.abs(ours.value - theirs)[both] / np.abs(theirs[both])
    return (
        f"C of equation 2 on {both.sum()} of {n_holds} holds where both converge: median "
        f"relative difference {np.median(difference):.1e}, largest {difference.max():.1e}."
    )


def _equation_2(since: FloatArray, a: float, rate: float, c: float) -> FloatArray:
    curve: FloatArray = a * np.exp(-rate * since) + c
    return curve


def _fit_each(time_s: FloatArray, holds: FloatArray) -> None:
    inside = time_s >= WAIT_S
    for hold in holds:
        fit_curve(time_s[inside], hold[inside])


def fit_curve(since: FloatArray, hold: FloatArray) -> float:
    """Return C, or NaN if curve_fit does not converge."""
    try:
        found, _ = curve_fit(_equation_2, since, hold, p0=(hold[0] - hold[-1], 1.0, hold[-1]))
    except RuntimeError:
        return float("nan")
    return float(found[2])
