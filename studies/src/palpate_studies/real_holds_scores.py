"""Scores of the real-holds study: by method and cut-off, by specimen, hold by hold, and why."""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.holds import Hold
from palpate.settling.evaluate import score_predictions
from palpate.settling.scoring import mean, settled_value, summarise
from palpate_studies.bootstrap import bootstrap_interval
from palpate_studies.held_out import CUTOFFS_S, MAIN_CUTOFF_S, OURS, FileResult
from palpate_studies.specimens import HORIZON_S

#: How many of the worst holds are shown.
WORST = 10


def summary_of(result: FileResult) -> list[dict[str, Any]]:
    """Return scores for each method and cut-off, with bootstrap intervals over units."""
    found = []
    for method in dict.fromkeys(p.method for p in result.predictions):
        for cutoff_s in CUTOFFS_S:
            rows = result.of(method, cutoff_s)
            scores = score_predictions(rows)
            units = [result.unit_of(row) for row in rows]
            entry: dict[str, Any] = {"method": method, "cutoff_s": cutoff_s, "holds": len(rows)}
            entry |= {name: _known(figure) for name, figure in summarise(scores).items()}
            size = np.abs(scores.error_percent)
            entry["median_abs_error_percent_interval"] = _span(
                bootstrap_interval(size, units, statistic=np.median)
            )
            entry["coverage_interval"] = _span(
                bootstrap_interval(scores.covered, units, statistic=np.mean)
            )
            found.append(entry)
    return found


def per_specimen(result: FileResult) -> list[dict[str, Any]]:
    """Return median errors of each specimen and method at the main cut-off."""
    found = []
    for specimen in dict.fromkeys(result.specimens.values()):
        for method in dict.fromkeys(p.method for p in result.predictions):
            rows = [
                row
                for row in result.of(method, MAIN_CUTOFF_S)
                if result.specimens[row.hold_id] == specimen
            ]
            figures = {name: _known(f) for name, f in summarise(score_predictions(rows)).items()}
            found.append({"specimen": specimen, "method": method, "holds": len(rows)} | figures)
    return found


def worst_holds(result: FileResult) -> list[dict[str, Any]]:
    """Return the holds that ours, uncalibrated, misses by most at the main cut-off, and why."""
    rows = result.of(OURS, MAIN_CUTOFF_S)
    scores = score_predictions(rows)
    order = np.argsort(-np.abs(np.nan_to_num(scores.error_percent)), kind="stable")[:WORST]
    return [
        {
            "hold_id": rows[index].hold_id,
            "channel": rows[index].channel,
            "specimen": result.specimens[rows[index].hold_id],
            "error_percent": _known(scores.error_percent[index]),
            "error_of_remaining_percent": _known(scores.of_remaining_percent[index]),
            "covered": bool(scores.covered[index] == 1),
            "status": str(rows[index].status),
            **_shape(result.holds[index]),
        }
        for index in order
    ]


def _shape(hold: Hold) -> dict[str, float | None]:
    """Return what may explain a miss, each in percent of the change from the first sample on.

    `rise_percent`: the largest rise above the running minimum inside the window, which a relaxation
    does not do. `to_come_percent`: the share of the whole change that comes after the cut-off.
    """
    settled = settled_value(hold.time_s, hold.values, horizon_s=HORIZON_S)
    window = hold.values[hold.time_s <= MAIN_CUTOFF_S]
    if not window.size or settled == window[0]:
        return {"rise_percent": None, "to_come_percent": None}
    falling = window if settled < window[0] else -window
    change = abs(settled - window[0])
    rise = float(np.max(falling - np.minimum.accumulate(falling)))
    return {
        "rise_percent": 100 * rise / change,
        "to_come_percent": float(100 * abs(settled - window[-1]) / change),
    }


def limits(result: FileResult) -> dict[str, float | None]:
    """Return what the errors at the main cut-off go with, over all holds of a file.

    `between_specimens_percent` is the share of the variance of the signed error that is due to
    specimens: what knowing the specimen could remove. The rank correlations show how far the size
    of the error follows the rise inside the window, and the change still to come.
    """
    from scipy.stats import spearmanr

    rows = result.of(OURS, MAIN_CUTOFF_S)
    error = score_predictions(rows).error_percent
    names = np.array([result.specimens[row.hold_id] for row in rows], dtype=object)
    means = np.array([mean(error[names == name]) for name in names])
    total = float(np.nansum((error - mean(error)) ** 2))
    between = 100 * float(np.nansum((means - mean(error)) ** 2)) / total if total > 0 else np.nan
    shapes = [_shape(hold) for hold in result.holds]
    found: dict[str, float | None] = {"between_specimens_percent": _known(between)}
    for name in ("rise_percent", "to_come_percent"):
        cause = np.array([np.nan if s[name] is None else s[name] for s in shapes], dtype=float)
        kept = np.isfinite(cause) & np.isfinite(error)
        varied = kept.sum() > 2 and np.ptp(cause[kept]) > 0 and np.ptp(np.abs(error[kept])) > 0
        rho = spearmanr(cause[kept], np.abs(error[kept])).statistic if varied else np.nan
        found[f"rank_correlation_with_{name}"] = _known(float(rho))
    return found


def _known(figure: float) -> float | None:
    return float(figure) if np.isfinite(figure) else None


def _span(ends: tuple[float, float]) -> list[float | None]:
    return [_known(end) for end in ends]
