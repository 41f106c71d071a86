"""Learn the observer of one sheet from guided traces: placements left out give its doubts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from scipy.stats import t as student_t

from palpate.errors import CalibrationError
from palpate.estimate.creep import FloatArray
from palpate.estimate.observer_fit import least_absolute
from palpate.estimate.observer_sheet import (
    MIDDLE_LOG_N,
    SHEET_TIMES_S,
    Current,
    SheetMemory,
    SheetModel,
    SheetObserver,
)
from palpate.sensor.load_traces import LoadTraces, frames

#: Exponents m of the sum over pixels that the fit chooses from: the inverse of a pixel's own.
EXPONENTS = (0.5, 0.65, 0.8, 1.0, 1.25)
#: Below this the sheet hardly answers: such frames teach its faint end only, newtons.
FAINT_N = 0.2
#: Fewer placements can't show how they differ.
FEWEST_RUNS = 4
#: Share of frames of falling force from which on unloading counts as seen.
_UNLOADING_SHARE = 0.05
_STILL_MM = 0.06


@dataclass(frozen=True, slots=True, kw_only=True)
class _Run:
    """One placement as terms, shape (exponents, frames, n_terms), and what was true."""

    trace: LoadTraces
    terms: FloatArray
    log_force: FloatArray
    force_n: FloatArray
    current_ma: FloatArray
    still: NDArray[np.bool_]


def fit_sheet(traces: LoadTraces, *, memory: bool = True) -> SheetModel:
    """Learn the observer of the sheet that the traces come from.

    Parameters
    ----------
    traces : LoadTraces
        At least four placements of the load cell, up and down with dwells.
    memory : bool
        False learns a static law by the same criterion: one exponent sum, no creep, no backlash.

    Raises
    ------
    CalibrationError
        If there are too few placements, the force never rises well above faint, or the reading
        does not rise with it.
    """
    times_s = SHEET_TIMES_S if memory else ()
    exponents = EXPONENTS if memory else (1.0,)
    runs = [_seen(run, exponents=exponents, times_s=times_s) for run in traces.runs()]
    runs = [run for run in runs if len(run.force_n) > 10]
    if len(runs) < FEWEST_RUNS:
        raise CalibrationError(
            f"force calibration: {len(runs)} placements with a force above {FAINT_N:g} N, at "
            f"least {FEWEST_RUNS} needed; place the load cell anew and repeat"
        )
    chosen, left = _best_exponent(runs)
    terms = np.concatenate([run.terms[chosen] for run in runs])
    log_force = np.concatenate([run.log_force for run in runs])
    if np.corrcoef(terms[:, 1], log_force)[0, 1] < 0.3:
        raise CalibrationError(
            "force calibration: the reading does not rise with the force; check the wiring, the "
            "divider's leg, that no pixel is saturated, and the unit of the reference (N)"
        )
    weights = _weights(runs, chosen)
    doubts = _doubts(runs, left)
    model = SheetModel(
        exponent=exponents[chosen],
        time_constants_s=times_s,
        weights=tuple(weights.tolist()),
        **doubts,
        tail=1.0,
        tail_with_current=1.0,
        range=(float(terms[:, 1].min()), float(terms[:, 1].max())),
        unloading_seen=_unloading_seen(traces),
        current=_current(runs) if memory else None,
    )
    return _with_tails(model, runs, chosen)


def without_current(model: SheetModel) -> SheetModel:
    """Return the model as if the servo reported no current."""
    return replace(model, current=None)


def _seen(run: LoadTraces, *, exponents: tuple[float, ...], times_s: tuple[float, ...]) -> _Run:
    memory = SheetMemory(exponents=exponents, time_constants_s=times_s)
    time_s, excess, width_mm = map(np.asarray, (run.time_s, run.excess, run.width_mm))
    force_n = np.asarray(run.force_n)
    steps = zip(time_s, excess, width_mm, strict=True)
    terms = np.stack([memory.step(float(t), x, width_mm=float(w)) for t, x, w in steps], axis=1)
    loaded = force_n > FAINT_N
    moved = np.abs(np.diff(width_mm, prepend=width_mm[0])) > _STILL_MM
    return _Run(
        trace=run,
        terms=terms[:, loaded],
        log_force=np.log(force_n[loaded]),
        force_n=force_n[loaded],
        current_ma=np.asarray(run.current_ma)[loaded],
        still=~moved[loaded],
    )


def _weights(runs: Sequence[_Run], chosen: int) -> FloatArray:
    design = np.concatenate([run.terms[chosen] for run in runs])
    target = np.concatenate([run.log_force for run in runs])
    return least_absolute(design, target, np.ones(len(target)))


def _best_exponent(runs: Sequence[_Run]) -> tuple[int, list[FloatArray]]:
    """Return the exponent that predicts left-out placements best, and the errors there."""
    every: list[list[FloatArray]] = []
    for chosen in range(len(runs[0].terms)):
        left = []
        for place, run in enumerate(runs):
            others = [*runs[:place], *runs[place + 1 :]]
            left.append(run.terms[chosen] @ _weights(others, chosen) - run.log_force)
        every.append(left)
    scores = [float(np.mean(np.abs(np.concatenate(left)))) for left in every]
    best = int(np.argmin(scores))
    return best, every[best]


def _doubts(runs: Sequence[_Run], left: Sequence[FloatArray]) -> dict[str, float]:
    """Return the scatter of gain, exponent and wandering error of ln force, and the floor in N.

    Each placement left out gives a line through its errors against ln force: its gain and exponent
    errors. What is left wanders; below a newton it is taken as an error in newtons.
    """
    gains, slopes, wandering = [], [], []
    for run, error in zip(runs, left, strict=True):
        away = run.log_force - MIDDLE_LOG_N
        ridge = np.diag([0.0, 0.05 * len(away)])
        design = np.column_stack([np.ones_like(away), away])
        gain, slope = np.linalg.solve(design.T @ design + ridge, design.T @ error)
        gains.append(gain)
        slopes.append(slope)
        wandering.append(error - gain - slope * away)
    own, force_n = np.concatenate(wandering), np.concatenate([run.force_n for run in runs])
    firm = force_n > 1
    if firm.sum() < 20:
        firm = np.ones_like(firm)
    faint = np.abs(np.expm1(np.clip(own[~firm], -3, 1))) * force_n[~firm]
    return {
        "gain_sd": max(float(np.sqrt(np.mean(np.square(gains)))), 0.01),
        "slope_sd": max(float(np.sqrt(np.mean(np.square(slopes)))), 0.01),
        "drift_sd": max(float(np.quantile(np.abs(own[firm]), 0.9)) / 1.645, 0.01),
        "floor_n": float(np.quantile(faint, 0.9)) / 1.645 if faint.size else 0.02,
    }


def _with_tails(model: SheetModel, runs: Sequence[_Run], chosen: int) -> SheetModel:
    """Scale the intervals by what the observer itself does on placements left out."""
    few = float(np.sqrt(student_t.ppf(0.95, len(runs) - 1) / norm.ppf(0.95)))
    plain = replace(model, tail=1.0, tail_with_current=1.0)
    tails = []
    for known in (without_current(plain), *([plain] if plain.current else [])):
        ratios = []
        for place, run in enumerate(runs):
            others = [*runs[:place], *runs[place + 1 :]]
            weights = tuple(_weights(others, chosen).tolist())
            ratios.append(_ratios(replace(known, weights=weights), run))
        at_90 = float(np.quantile(np.concatenate(ratios), 0.9))
        tails.append(max(at_90 * few, 0.5))
    return replace(model, tail=tails[0], tail_with_current=tails[-1])


def _ratios(model: SheetModel, run: _Run) -> FloatArray:
    """Return |error of ln force| over the observer's own half width, at every loaded frame."""
    observer, trace, found = SheetObserver(model), run.trace, []
    for frame in frames(trace):
        now = observer.step(
            frame.time_s, frame.excess, width_mm=frame.width_mm, current_ma=frame.current_ma
        )
        if frame.force_n > FAINT_N:
            wide = np.log(now.high / now.value)
            found.append(abs(np.log(now.value / frame.force_n)) / wide)
    return np.array(found)


def _unloading_seen(traces: LoadTraces) -> bool:
    falling = [np.diff(np.asarray(run.width_mm)) > _STILL_MM for run in traces.runs()]
    share = np.concatenate(falling).sum() / max(
        sum((np.abs(np.diff(np.asarray(run.width_mm))) > _STILL_MM).sum() for run in traces.runs()),
        1,
    )
    return bool(share > _UNLOADING_SHARE)


def _current(runs: Sequence[_Run]) -> Current | None:
    """Fit the servo's current to the force when still; None where it does not follow it."""
    current = np.concatenate([run.current_ma[run.still] for run in runs])
    force_n = np.concatenate([run.force_n[run.still] for run in runs])
    if not np.isfinite(current).all() or current.size < 20:
        return None
    design = np.column_stack([np.ones_like(force_n), force_n])
    zero_ma, ma_per_n = least_absolute(design, current, np.ones_like(current))
    if ma_per_n <= 0 or np.corrcoef(current, force_n)[0, 1] < 0.5:
        return None
    line = Current(zero_ma=float(zero_ma), ma_per_n=float(ma_per_n), sd_n=1.0, bias_n=0.0)
    errors = [line.force_n(run.current_ma[run.still]) - run.force_n[run.still] for run in runs]
    bias_n = float(np.sqrt(np.mean([np.mean(e) ** 2 for e in errors])))
    sd_n = float(np.sqrt(np.mean(np.concatenate([e - e.mean() for e in errors]) ** 2)))
    return replace(line, sd_n=sd_n, bias_n=bias_n)


#: Forces at which a calibration says what error to expect, newtons.
VERDICT_N = (1.0, 5.0, 10.0)
#: Frames within this ratio of such a force speak for it.
_NEAR = 1.4


def expected_error_percent(traces: LoadTraces, *, memory: bool = True) -> dict[str, float | None]:
    """Return the median error at 1, 5 and 10 N on placements left out of the fit, percent.

    None where no placement reached the force. Servo current is not used.
    """
    exponents, times_s = (EXPONENTS, SHEET_TIMES_S) if memory else ((1.0,), ())
    runs = [_seen(run, exponents=exponents, times_s=times_s) for run in traces.runs()]
    runs = [run for run in runs if len(run.force_n) > 10]
    error = np.abs(np.expm1(np.concatenate(_best_exponent(runs)[1])))
    log_force = np.concatenate([run.log_force for run in runs])
    return error_near(log_force, error)


def error_near(log_force: FloatArray, error: FloatArray) -> dict[str, float | None]:
    """Return the median relative error near 1, 5 and 10 N, percent; None where there is none."""
    found: dict[str, float | None] = {}
    for force_n in VERDICT_N:
        near = np.abs(log_force - np.log(force_n)) < np.log(_NEAR)
        found[f"{force_n:g}_n"] = float(100 * np.median(error[near])) if near.any() else None
    return found
