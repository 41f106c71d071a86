"""Predictions for many holds, methods and cut-offs, and their errors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.arrays import FloatArray
from palpate.holds import Hold, find_recorded_value, measure_settled_value
from palpate.measurement import Status
from palpate.scoring.deciding import find_decision
from palpate.settling.percent import adapt_method
from palpate.settling.result import SettledEstimate, SettlingMethod

#: Maximum size of a batch. Adjacent holds usually have the same sampling grid and are predicted
#: together.
HOLDS_AT_A_TIME = 512
SAMPLES_AT_A_TIME = 500_000
#: Figures of a summary: property of a prediction, and statistic over its known values.
_FIGURES: Mapping[str, tuple[str, Any]] = {
    "median_abs_error_percent": ("error_percent", np.median),
    "mean_abs_error_percent": ("error_percent", np.mean),
    "p90_abs_error_percent": ("error_percent", lambda size: np.quantile(size, 0.9)),
    "median_error_of_remaining_percent": ("of_remaining_percent", np.median),
    "coverage": ("coverage", np.mean),
    "median_half_width_percent": ("half_width_percent", np.median),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Prediction:
    """Prediction for one hold, method and cut-off, with the true settled value.

    >>> row = Prediction(hold_id="a", method="recorded", cutoff_s=2.5, predicted=-48.0,
    ...     low=-53.0, high=-45.0, settled=-50.0, recorded=-40.0, status=Status.OK)
    >>> row.error_percent, row.of_remaining_percent, row.half_width_percent, row.coverage
    (4.0, 20.0, 8.0, 1.0)
    """

    #: File, hold, channel and unit; empty or None if unknown.
    source: str = ""
    hold_id: str
    channel: str | None = None
    unit: str | None = None
    #: Name of the method, given by the caller.
    method: str
    #: Time of the last sample that the prediction may use.
    cutoff_s: float
    #: Whether the interval became narrow enough; None for a given cut-off.
    decided: bool | None = None
    #: Predicted value at the horizon, with interval; NaN without samples or without interval.
    predicted: float
    low: float
    high: float
    #: Settled value (NaN if the hold ends before the horizon), and last sample at the cut-off.
    settled: float
    recorded: float
    #: Status of the prediction.
    status: Status

    @property
    def error_percent(self) -> float:
        """Signed error in % of the settled value; NaN if that is unknown or zero."""
        return _percent(self.predicted - self.settled, self.settled)

    @property
    def of_remaining_percent(self) -> float:
        """Absolute error in % of the remaining change, independent of unit and baseline."""
        return _percent(abs(self.predicted - self.settled), self.settled - self.recorded)

    @property
    def half_width_percent(self) -> float:
        """Half-width of the interval in % of the settled value."""
        return _percent((self.high - self.low) / 2, self.settled)

    @property
    def coverage(self) -> float:
        """1 if the interval contains the settled value, else 0; NaN if unknown."""
        if np.isnan(self.low + self.high + self.settled):
            return np.nan
        return float(self.low <= self.settled <= self.high)


def _percent(value: float, base: float) -> float:
    return 100 * value / abs(base) if abs(base) > 0 else np.nan


def predict_holds(
    holds: Iterable[Hold],
    *,
    methods: Mapping[str, SettlingMethod],
    cutoffs_s: Sequence[float],
    horizon_s: float,
    level: float,
    source: str = "",
) -> Iterator[Prediction]:
    """Yield predictions ordered by hold, method and cut-off.

    Holds are processed in batches, so memory does not grow with their number.

    `holds`: may be a stream.
    `methods`: methods by the name in the predictions.
    `horizon_s`, `level`: time of the predicted value, and nominal coverage of its interval.

    >>> from palpate.settling.baselines import Recorded
    >>> time_s = np.arange(0, 21, 0.5)
    >>> hold = Hold(hold_id="a", channel=None, time_s=time_s, values=100 - time_s)
    >>> [row] = predict_holds(
    ...     [hold], methods={"recorded": Recorded()}, cutoffs_s=[2.5], horizon_s=20.0, level=0.9
    ... )
    >>> row.predicted, row.settled
    (97.5, 80.25)
    """
    for batch in _batch(holds):
        estimates = {
            (name, cutoff_s): _predict_batch(batch, method, cutoff_s, horizon_s, level)
            for name, method in methods.items()
            for cutoff_s in cutoffs_s
        }
        for index, hold in enumerate(batch):
            for (name, cutoff_s), found in estimates.items():
                yield _pair(
                    hold,
                    found[index],
                    source=source,
                    method=name,
                    cutoff_s=cutoff_s,
                    horizon_s=horizon_s,
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
    """Yield each hold's first prediction with a narrow interval (`find_decision`).

    The cut-off is the decision time. Other parameters are as in `predict_holds`.
    """
    for hold in holds:
        for name, method in methods.items():
            found, cutoff_s, decided = None, horizon_s, False
            if hold.time_s[0] <= horizon_s:
                decision = find_decision(
                    hold.time_s,
                    hold.values,
                    method=adapt_method(method, unit=hold.unit),
                    half_width_percent=half_width_percent,
                    horizon_s=horizon_s,
                    level=level,
                )
                found, cutoff_s, decided = decision.estimate, decision.time_s, decision.decided
            yield _pair(
                hold,
                found,
                source=source,
                method=name,
                cutoff_s=cutoff_s,
                horizon_s=horizon_s,
                decided=decided,
            )


def _pair(
    hold: Hold,
    estimate: SettledEstimate | None,
    *,
    source: str,
    method: str,
    cutoff_s: float,
    horizon_s: float,
    decided: bool | None = None,
) -> Prediction:
    """Return an estimate with the hold's settled value; None is an estimate without samples."""
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
        settled=measure_settled_value(hold.time_s, hold.values, horizon_s=horizon_s),
        recorded=find_recorded_value(hold.time_s, hold.values, cutoff_s=cutoff_s),
        status=status,
    )


def summarise(predictions: Iterable[Prediction]) -> dict[str, float]:
    """Return the summary of one method and cut-off, as in `palpate settle --json`.

    A figure without known values is NaN.
    """
    rows = list(predictions)
    figures = {}
    for name, (attribute, statistic) in _FIGURES.items():
        values = np.abs([getattr(row, attribute) for row in rows])
        known = values[np.isfinite(values)]
        figures[name] = float(statistic(known)) if known.size else float("nan")
    return figures


def _batch(holds: Iterable[Hold]) -> Iterator[list[Hold]]:
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
    """Predict each hold of a batch, with one call per unit and grid."""
    grids: dict[tuple[str | None, bytes], list[int]] = {}
    windows: list[FloatArray] = []
    for index, hold in enumerate(batch):
        window_s = hold.time_s[: np.searchsorted(hold.time_s, cutoff_s, side="right")]
        windows.append(window_s)
        key = (hold.unit, window_s.tobytes())
        grids.setdefault(key, []).append(index)
    found: list[SettledEstimate | None] = [None] * len(batch)
    for indices in grids.values():
        time_s, hold = windows[indices[0]], batch[indices[0]]
        if not time_s.size:
            continue
        values = np.stack([batch[index].values[: time_s.size] for index in indices])
        adapted = adapt_method(method, unit=hold.unit)
        estimate = adapted.predict(time_s, values, horizon_s=horizon_s, level=level)
        for row, index in enumerate(indices):
            found[index] = estimate.hold(row)
    return found
