"""Predictors of the settled value, compared with general fitters that take one hold at a time."""

from __future__ import annotations

import importlib.util
import warnings
from collections.abc import Callable
from functools import partial
from itertools import count

import numpy as np
from scipy.optimize import OptimizeWarning, curve_fit

from palpate.arrays import FloatArray
from palpate.settling.predict import METHODS, method_named, predict_settled
from palpate.settling.result import Status
from palpate.settling.streaming import SettlingStream
from palpate.signal.transient import WAIT_S
from palpate_studies.benchmarks.protocol import Measured, Ratio, side_by_side_s
from palpate_studies.benchmarks.running import command_of
from palpate_studies.benchmarks.synthetic import CUTOFF_S, NOTE, SAMPLES, synthetic_holds

CURVE_FIT, LMFIT = "scipy.optimize.curve_fit", "lmfit"
#: Method and holds per call -> how many times as fast as curve_fit it must be.
WANTED = {
    ("exponential", 10_000): 100.0,
    ("relaxation", 1): 1.0,
    ("relaxation", 10_000): 100.0,
}
NEW_GRID_WANTED = 1.0
PIXELS, RATE_HZ = 12, 15

Fitter = Callable[[FloatArray, FloatArray], float]


def measure(full: bool) -> Measured:
    """Time single holds, batches, grids never met before and a streaming update."""
    sizes = (1, 8, 10_000, 100_000) if full else (1, 8, 10_000)
    peer_holds = 2000 if full else 300
    time_s, holds = synthetic_holds(max(sizes))
    with warnings.catch_warnings():
        # curve_fit warns where a hold leaves its covariance open; only its parameters count here.
        warnings.simplefilter("ignore", OptimizeWarning)
        ratios = [
            _known_grid(method, peer, time_s=time_s, holds=holds[:size], peer_holds=peer_holds)
            for size in sizes
            for method in ("exponential", "relaxation")
            for peer in (CURVE_FIT, LMFIT)
        ]
        ratios += [_new_grid(holds[0]), _update()]
        agreement = _agreement(peer_holds)
    scaled = f"The peers take one hold at a time: timed on at most {peer_holds}, and scaled up."
    return Measured(ratios=ratios, notes=(NOTE, scaled, agreement))


command = command_of("settling")


def _known_grid(
    method: str, peer: str, *, time_s: FloatArray, holds: FloatArray, peer_holds: int
) -> Ratio:
    """Compare a method and a peer where all that depends on the grid alone is known already."""
    size, some = len(holds), holds[:peer_holds]
    ours = partial(predict_settled, time_s, holds, cutoff_s=CUTOFF_S, method=method)
    fit = by_curve_fit if peer == CURVE_FIT else _lmfit_fitter()
    ours()
    acts = [ours] if fit is None else [ours, partial(_fit_each, fit, time_s, some)]
    taken_s = side_by_side_s(*acts, repeats=100 if size < 100 else 3)
    return Ratio(
        what=f"{method}, known grid",
        size=size,
        of="holds",
        peer=peer,
        ours=taken_s[0],
        theirs=None if fit is None else taken_s[1] * size / len(some),
        wanted=WANTED.get((method, size)) if peer == CURVE_FIT else None,
        install="pip install lmfit",
    )


def _new_grid(hold: FloatArray) -> Ratio:
    """Compare single holds whose every sampling grid is met for the first time."""
    time_s = np.linspace(0.0, CUTOFF_S, SAMPLES)
    stretch = (1 + 1e-6 * step for step in count(1))
    ours_s, theirs_s = side_by_side_s(
        lambda: predict_settled(time_s * next(stretch), hold, cutoff_s=2 * CUTOFF_S),
        partial(_fit_each, by_curve_fit, time_s, hold[None]),
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


def _update() -> Ratio:
    """Compare one frame's update of all methods with one fit of each pixel."""
    stream = SettlingStream(channels=PIXELS, methods={name: method_named(name) for name in METHODS})
    rng, frames = np.random.default_rng(3), count()
    time_s, holds = synthetic_holds(PIXELS)

    def push() -> None:
        now_s = next(frames) / RATE_HZ
        stream.push(now_s, 20 * np.exp(-1.5 * now_s) - 60 + rng.normal(0, 0.1, PIXELS))

    ours_s, theirs_s = side_by_side_s(
        push, partial(_fit_each, by_curve_fit, time_s, holds), repeats=2 * SAMPLES
    )
    return Ratio(
        what="one streaming update, all methods",
        size=PIXELS,
        of="pixels",
        peer=CURVE_FIT,
        ours=ours_s,
        theirs=theirs_s,
    )


def _agreement(n_holds: int) -> str:
    """State how far C is from curve_fit's where that converges."""
    time_s, holds = synthetic_holds(n_holds, seed=2)
    since = time_s[time_s >= WAIT_S]
    theirs = np.array([by_curve_fit(since, hold[-since.size :]) for hold in holds])
    ours = predict_settled(time_s, holds, cutoff_s=CUTOFF_S, method="exponential")
    both = np.isfinite(theirs) & (ours.status == Status.OK)
    difference = np.abs(ours.value - theirs)[both] / np.abs(theirs[both])
    return (
        f"C of equation 2 on the {both.sum()} of {n_holds} holds where both converge: median "
        f"relative difference {np.median(difference):.1e}, largest {difference.max():.1e}."
    )


def _equation_2(since: FloatArray, a: float, rate: float, c: float) -> FloatArray:
    curve: FloatArray = a * np.exp(-rate * since) + c
    return curve


def _fit_each(fit: Fitter, time_s: FloatArray, holds: FloatArray) -> None:
    inside = time_s >= WAIT_S
    for hold in holds:
        fit(time_s[inside], hold[inside])


def by_curve_fit(since: FloatArray, hold: FloatArray) -> float:
    """Return C, or NaN where curve_fit gives up."""
    try:
        found, _ = curve_fit(_equation_2, since, hold, p0=(hold[0] - hold[-1], 1.0, hold[-1]))
    except RuntimeError:
        return float("nan")
    return float(found[2])


def _lmfit_fitter() -> Fitter | None:
    """Return the same fit by lmfit, or None where it is not installed."""
    if importlib.util.find_spec("lmfit") is None:
        return None
    import lmfit

    model = lmfit.Model(_equation_2)

    def fit(since: FloatArray, hold: FloatArray) -> float:
        found = model.fit(hold, since=since, a=hold[0] - hold[-1], rate=1.0, c=hold[-1])
        return float(found.params["c"].value)

    return fit
