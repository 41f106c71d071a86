"""Predictions for many holds, methods and cut-offs, and how far off they are."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray
from palpate.holds import Hold, recorded_value, settled_value
from palpate.settling.deciding import find_decision
from palpate.settling.percent import for_hold
from palpate.settling.result import SettledEstimate, SettlingMethod, Status

#: Holds predicted together. Only holds on one sampling grid share work, and those are neighbours.
HOLDS_AT_A_TIME = 512
SAMPLES_AT_A_TIME = 500_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Prediction:
    """One hold, method and cut-off, with the value that the hold settled to."""

    #: Which hold of which file.
    source: str
    hold_id: str
    channel: str | None
    #: Unit of the values, where it is known.
    unit: str | None
    #: By the name that the caller gave it.
    method: str
    #: The prediction rests on samples up to this time alone.
    cutoff_s: float
    #: Whether the interval became narrow enough; None where the cut-off was given beforehand.
    decided: bool | None
    #: At the horizon; NaN where there is no sample before the cut-off or no interval.
    predicted: float
    low: float
    high: float
    #: What it settled to (NaN where the hold ends before), and the last sample at the cut-off.
    settled: float
    recorded: float
    #: Of the prediction.
    status: Status


def predict_holds(
    holds: Iterable[Hold],
    *,
    methods: Mapping[str, SettlingMethod],
    cutoffs_s: Sequence[float],
    horizon_s: float,
    level: float,
    source: str = "",
) -> Iterator[Prediction]:
    """Yield predictions in the order of holds, then methods, then cut-offs.

    Holds are taken in batches and let go, so memory does not grow with their number.

    `holds` may be a stream; `methods` are by the name to report.
    `horizon_s`, `level`: time of the value to predict, and the probability its interval is to
    cover.

    >>> from palpate.settling.baselines import Recorded
    >>> time_s = np.arange(0, 21, 0.5)
    >>> hold = Hold(hold_id="a", channel=None, time_s=time_s, values=100 - time_s)
    >>> [row] = predict_holds(
    ...     [hold], methods={"recorded": Recorded()}, cutoffs_s=[2.5], horizon_s=20.0, level=0.9
    ... )
    >>> row.predicted, row.settled
    (97.5, 80.25)
    """
    for batch in _batches(holds):
        estimates = {
            (name, cutoff_s): _predict_batch(batch, method, cutoff_s, horizon_s, level)
            for name, method in methods.items()
            for cutoff_s in cutoffs_s
        }
        for index, hold in enumerate(batch):
            settled = settled_value(hold.time_s, hold.values, horizon_s=horizon_s)
            for (name, cutoff_s), found in estimates.items():
                yield _prediction(
                    hold,
                    found[index],
                    source=source,
                    method=name,
                    cutoff_s=cutoff_s,
                    settled=settled,
                )


def decide_holds(
    holds: Iterable[Hold],
    *,
    methods: Mapping[str, SettlingMethod],
    half_width_percent: float,
    horizon_s: float,
    level: float,
    source: str = "",
) -> Iterator[Prediction]:
    """Yield the first prediction of each hold that is sure enough, by `deciding.find_decision`.

    The cut-off of each is its time of decision; the other parameters are those of `predict_holds`.
    """
    for hold in holds:
        settled = settled_value(hold.time_s, hold.values, horizon_s=horizon_s)
        for name, method in methods.items():
            found, cutoff_s, decided = None, horizon_s, False
            if hold.time_s[0] <= horizon_s:
                decision = find_decision(
                    hold.time_s,
                    hold.values,
                    method=for_hold(method, unit=hold.unit, loading_s=hold.loading_s),
                    half_width_percent=half_width_percent,
                    horizon_s=horizon_s,
                    level=level,
                )
                found, cutoff_s, decided = decision.estimate, decision.time_s, decision.decided
            yield _prediction(
                hold,
                found,
                source=source,
                method=name,
                cutoff_s=cutoff_s,
                settled=settled,
                decided=decided,
            )


def _prediction(
    hold: Hold,
    estimate: SettledEstimate | None,
    *,
    source: str,
    method: str,
    cutoff_s: float,
    settled: float,
    decided: bool | None = None,
) -> Prediction:
    """Pair an estimate with the value that the hold settled to; None means no sample at all."""
    value, low, high, status = np.nan, np.nan, np.nan, Status.TOO_SHORT
    if estimate is not None:
        value, low, high = (float(end) for end in (estimate.value, estimate.low, estimate.high))
        status = Status(str(estimate.status))
    return Prediction(
        source=source,
        hold_id=hold.hold_id,
        channel=hold.channel,
        unit=hold.unit,
        method=method,
        cutoff_s=cutoff_s,
        decided=decided,
        predicted=value,
        low=low,
        high=high,
        settled=settled,
        recorded=recorded_value(hold.time_s, hold.values, cutoff_s=cutoff_s),
        status=status,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Scores:
    """Predictions against settled values, hold by hold; NaN where a hold has no settled value."""

    #: Shape (n_holds,). (predicted - settled) / abs(settled).
    error_percent: FloatArray
    #: Shape (n_holds,). abs(predicted - settled) / abs(settled - recorded at the cut-off): what is
    #: still missing of the change that was still to come. It does not depend on unit or baseline.
    of_remaining_percent: FloatArray
    #: Shape (n_holds,). Half of the interval, in percent of abs(settled).
    half_width_percent: FloatArray
    #: Shape (n_holds,). 1 where the interval holds the settled value, 0 where not, NaN where either
    #: is unknown.
    covered: FloatArray


def score_values(
    predicted: ArrayLike,
    *,
    low: ArrayLike,
    high: ArrayLike,
    settled: ArrayLike,
    recorded: ArrayLike,
) -> Scores:
    """Score predictions, each of shape (n_holds,), against the values they were to predict.

    >>> ends = {"low": [98.0], "high": [110.0]}
    >>> scores = score_values([104.0], **ends, settled=[100.0], recorded=[120.0])
    >>> scores.error_percent.item(), scores.of_remaining_percent.item(), scores.covered.item()
    (4.0, 20.0, 1.0)
    """
    value, bottom, top, target, last = (
        np.asarray(array, dtype=np.float64) for array in (predicted, low, high, settled, recorded)
    )
    known = np.isfinite(bottom) & np.isfinite(top) & np.isfinite(target)
    return Scores(
        error_percent=_percent(value - target, np.abs(target)),
        of_remaining_percent=_percent(np.abs(value - target), np.abs(target - last)),
        half_width_percent=_percent((top - bottom) / 2, np.abs(target)),
        covered=np.where(known, (bottom <= target) & (target <= top), np.nan),
    )


def _percent(part: FloatArray, whole: FloatArray) -> FloatArray:
    share = np.full(part.shape, np.nan)
    np.divide(100 * part, whole, out=share, where=whole > 0)
    return share


def score_predictions(predictions: Sequence[Prediction]) -> Scores:
    """Score predictions, one entry for each."""
    return score_values(
        [p.predicted for p in predictions],
        low=[p.low for p in predictions],
        high=[p.high for p in predictions],
        settled=[p.settled for p in predictions],
        recorded=[p.recorded for p in predictions],
    )


def summarise(scores: Scores) -> dict[str, float]:
    """Return the summary that `palpate settle --json` prints for one method and cut-off.

    A figure that no hold gives is NaN.
    """
    size = np.abs(scores.error_percent)
    figures: dict[str, tuple[FloatArray, Callable[[FloatArray], Any]]] = {
        "median_abs_error_percent": (size, np.median),
        "mean_abs_error_percent": (size, np.mean),
        "p90_abs_error_percent": (size, partial(np.quantile, q=0.9)),
        "median_error_of_remaining_percent": (scores.of_remaining_percent, np.median),
        "coverage": (scores.covered, np.mean),
        "median_half_width_percent": (scores.half_width_percent, np.median),
    }
    return {
        name: float(figure(known)) if (known := values[np.isfinite(values)]).size else float("nan")
        for name, (values, figure) in figures.items()
    }


def _batches(holds: Iterable[Hold]) -> Iterator[list[Hold]]:
    batch: list[Hold] = []
    samples = 0
    for hold in holds:
        batch.append(hold)
        samples += len(hold.time_s)
        if len(batch) == HOLDS_AT_A_TIME or samples >= SAMPLES_AT_A_TIME:
            yield batch
            batch, samples = [], 0
    if batch:
        yield batch


def _predict_batch(
    batch: Sequence[Hold], method: SettlingMethod, cutoff_s: float, horizon_s: float, level: float
) -> list[SettledEstimate | None]:
    """Predict each hold of a batch, all those of one unit, loading and grid in one call."""
    grids: dict[tuple[str | None, float, bytes], list[int]] = {}
    windows: list[FloatArray] = []
    for index, hold in enumerate(batch):
        window_s = hold.time_s[: np.searchsorted(hold.time_s, cutoff_s, side="right")]
        windows.append(window_s)
        key = (hold.unit, hold.loading_s, window_s.tobytes())
        grids.setdefault(key, []).append(index)
    found: list[SettledEstimate | None] = [None] * len(batch)
    for indices in grids.values():
        time_s = windows[indices[0]]
        if not time_s.size:
            continue
        values = np.stack([batch[index].values[: time_s.size] for index in indices])
        hold = batch[indices[0]]
        suited = for_hold(method, unit=hold.unit, loading_s=hold.loading_s)
        estimate = suited.predict(time_s, values, horizon_s=horizon_s, level=level)
        for row, index in enumerate(indices):
            found[index] = estimate.hold(row)
    return found
