"""Learn the observer of one sheet from guided traces: placements left out give its doubts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from scipy.stats import t as student_t

from palpate.errors import CalibrationError
from palpate.estimate.creep import CONTACT_EXCESS, FloatArray
from palpate.estimate.gear_friction import GearFriction
from palpate.estimate.observer_fit import least_absolute
from palpate.estimate.observer_sheet import MIDDLE_LOG_N, SheetModel, SheetObserver
from palpate.estimate.sheet_current import Current, fit_line
from palpate.estimate.sheet_memory import STILL_MM, SUMMED, SheetMemory, SheetReading
from palpate.estimate.sheet_reading_fit import FAINT_N, best_reading
from palpate.sensor.current_pairs import CurrentPairs
from palpate.sensor.load_traces import LoadTraces, frames

#: Log-spaced, from a frame of a slow readout to the length of a dwell's creep.
SHEET_TIMES_S = (0.1, 0.3, 1.0, 3.0, 10.0)
#: Where the law may bend: at these shares of the loaded frames.
_KNOTS = (0.15, 0.4, 0.65, 0.88)
#: Servo current is used where it leaves at most this share of the error on placements left out
#: of the fit.
_HELPS = 1.0
#: Fewer placements can't show how they differ.
FEWEST_RUNS = 4
#: Below this force errors count in newtons.
_FIRM_N = 1.0
#: Share of frames of falling force from which on unloading counts as seen.
_UNLOADING_SHARE = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class _Run:
    """The loaded frames of one placement as terms, shape (frames, n_terms), and what was true.

    `way` is 1 or -1 for frames on the way of a closing or an opening, 0 for others.
    """

    trace: LoadTraces
    terms: FloatArray
    log_reading: FloatArray
    force_n: FloatArray
    current_ma: FloatArray
    width_mm: FloatArray
    still: NDArray[np.bool_]
    stop: NDArray[np.int64]
    way: NDArray[np.int64]

    @property
    def log_force(self) -> FloatArray:
        """What the terms are to add up to."""
        return np.log(self.force_n)


def fit_sheet(traces: LoadTraces, *, memory: bool = True) -> SheetModel:
    """Learn the observer of the sheet that the traces come from.

    Parameters
    ----------
    traces : LoadTraces
        At least four placements of the load cell, up and down with dwells.
    memory : bool
        False learns a static law by the same criterion: the plain sum, no creep, no backlash.

    Returns
    -------
    SheetModel
        With servo current only where it made the errors on placements left out smaller.

    Raises
    ------
    CalibrationError
        If there are too few placements, the force never rises well above faint, or the reading
        does not rise with it.
    """
    return _fitted(traces, memory=memory)[0]


def fit_current(traces: LoadTraces) -> Current | None:
    """Return the line from servo current to force; None where the current does not follow it."""
    placements = [run for run in traces.runs() if (np.asarray(run.force_n) > FAINT_N).any()]
    runs = [_seen(run, reading=SUMMED, knots=(0.0,), times_s=()) for run in placements]
    return fit_line(runs, gears=_empty_hand(placements))


def without_current(model: SheetModel) -> SheetModel:
    """Return the model as if the servo reported no current."""
    return replace(model, current=None)


def _fitted(traces: LoadTraces, *, memory: bool) -> tuple[SheetModel, FloatArray, FloatArray]:
    """Return the model, and errors and truth of ln force on placements left out."""
    times_s = SHEET_TIMES_S if memory else ()
    placements = [run for run in traces.runs() if (np.asarray(run.force_n) > FAINT_N).sum() > 10]
    if len(placements) < FEWEST_RUNS:
        raise CalibrationError(
            f"force calibration: {len(placements)} placements with a force above {FAINT_N:g} N, "
            f"at least {FEWEST_RUNS} needed; place the load cell anew and repeat"
        )
    reading = best_reading(placements) if memory else SUMMED
    knots = _knots(placements, reading)
    runs = [_seen(run, reading=reading, knots=knots, times_s=times_s) for run in placements]
    log_reading, log_force = (
        np.concatenate([getattr(run, name) for run in runs])
        for name in ("log_reading", "log_force")
    )
    if not np.ptp(log_reading) > 0 or np.corrcoef(log_reading, log_force)[0, 1] < 0.3:
        raise CalibrationError(
            "force calibration: the reading does not rise with the force; check the wiring, the "
            "divider's leg, that no pixel is saturated, and the unit of the reference (N)"
        )
    rising = slice(1, 2 + len(knots) + len(times_s))
    folds = [_weights([*runs[:k], *runs[k + 1 :]], rising) for k in range(len(runs))]
    left = [run.terms @ other - run.log_force for run, other in zip(runs, folds, strict=True)]
    model = SheetModel(
        reading=reading,
        knots=knots,
        time_constants_s=times_s,
        weights=tuple(_weights(runs, rising).tolist()),
        **_doubts(runs, left),
        tail=1.0,
        tail_with_current=1.0,
        range=(float(log_reading.min()), float(log_reading.max())),
        unloading_seen=_unloading_seen(traces),
        current=fit_line(runs, gears=_empty_hand(placements)) if memory else None,
    )
    return _with_tails(model, runs, left, folds), np.concatenate(left), log_force


def _empty_hand(placements: Sequence[LoadTraces]) -> GearFriction | None:
    """Return what the gears took on the way to each placement, before anything was touched."""
    force_n, current_ma, width_mm = list[float](), list[float](), list[float]()
    movement: list[int] = []
    for number, run in enumerate(placements):
        at_mm = np.asarray(run.width_mm)
        closing = np.diff(at_mm, append=at_mm[-1]) < -STILL_MM
        free = closing & (np.cumsum(np.asarray(run.force_n) > FAINT_N) == 0)
        force_n += np.asarray(run.force_n)[free].tolist()
        current_ma += np.asarray(run.current_ma)[free].tolist()
        width_mm += at_mm[free].tolist()
        movement += [number] * int(free.sum())
    if not current_ma or not np.isfinite(current_ma).all():
        return None
    return GearFriction.fit(
        CurrentPairs(
            force_n=tuple(force_n),
            current_ma=tuple(current_ma),
            width_mm=tuple(width_mm),
            movement=tuple(movement),
        )
    )


def _knots(placements: Sequence[LoadTraces], reading: SheetReading) -> tuple[float, ...]:
    excess = np.concatenate([np.asarray(run.excess) for run in placements])
    loaded = np.concatenate([np.asarray(run.force_n) > FAINT_N for run in placements])
    log_reading = np.log(reading.of(excess[loaded]) + CONTACT_EXCESS)
    return tuple(float(knot) for knot in np.quantile(log_reading, _KNOTS))


def _seen(
    run: LoadTraces,
    *,
    reading: SheetReading,
    knots: tuple[float, ...],
    times_s: tuple[float, ...],
) -> _Run:
    memory = SheetMemory(reading, knots=knots, time_constants_s=times_s)
    terms, log_reading, ways = memory.run(
        np.asarray(run.time_s), np.asarray(run.excess), width_mm=np.asarray(run.width_mm)
    )
    loaded = np.asarray(run.force_n) > FAINT_N
    return _Run(
        trace=run,
        terms=terms[loaded],
        log_reading=log_reading[loaded],
        force_n=np.asarray(run.force_n)[loaded],
        current_ma=np.asarray(run.current_ma)[loaded],
        width_mm=np.asarray(run.width_mm)[loaded],
        still=(ways == 0)[loaded],
        stop=np.cumsum(ways != 0)[loaded],
        # A frame was on the way if the next one has moved on.
        way=np.where(ways == np.append(ways[1:], 0), ways, 0)[loaded],
    )


def _weights(runs: Sequence[_Run], rising: slice) -> FloatArray:
    """Return weights; force rises with the reading, and creep only ever adds to a reading."""
    design = np.concatenate([run.terms for run in runs])
    target = np.concatenate([run.log_force for run in runs])
    return least_absolute(design, target, _firmness(np.exp(target)), rising=rising)


def _firmness(force_n: FloatArray) -> FloatArray:
    """Return weights: of faint forces a logarithm says more of the threshold than of the law."""
    return np.asarray(force_n**2 / (force_n**2 + _FIRM_N**2))


def _doubts(runs: Sequence[_Run], left: Sequence[FloatArray]) -> dict[str, float]:
    """Return the scatter of gain, exponent and wandering error of ln force, and the floor in N.

    Each placement left out gives a line through its errors against ln force: its gain and exponent
    errors. What is left wanders; below a newton it is taken as an error in newtons.
    """
    gains, slopes, wandering = [], [], []
    for run, error in zip(runs, left, strict=True):
        away = run.log_force - MIDDLE_LOG_N
        weight = _firmness(run.force_n)
        ridge = np.diag([0.0, 0.05 * weight.sum()])
        design = np.column_stack([np.ones_like(away), away])
        scaled = design * weight[:, None]
        gain, slope = np.linalg.solve(scaled.T @ design + ridge, scaled.T @ error)
        gains.append(gain)
        slopes.append(slope)
        wandering.append(error - gain - slope * away)
    own, force_n = np.concatenate(wandering), np.concatenate([run.force_n for run in runs])
    firm = force_n > _FIRM_N
    if firm.sum() < 20:
        firm = np.ones_like(firm)
    faint = np.abs(np.expm1(np.clip(own[~firm], -3, 1))) * force_n[~firm]
    return {
        "gain_sd": max(float(np.sqrt(np.mean(np.square(gains)))), 0.01),
        "slope_sd": max(float(np.sqrt(np.mean(np.square(slopes)))), 0.01),
        "drift_sd": max(float(np.quantile(np.abs(own[firm]), 0.9)) / 1.645, 0.01),
        "floor_n": float(np.quantile(faint, 0.9)) / 1.645 if faint.size else 0.02,
    }


def _with_tails(
    model: SheetModel, runs: Sequence[_Run], left: Sequence[FloatArray], folds: Sequence[FloatArray]
) -> SheetModel:
    """Scale the intervals by what happened on placements left out."""
    few = float(np.sqrt(student_t.ppf(0.95, len(runs) - 1) / norm.ppf(0.95)))
    reach = float(norm.ppf(0.95))
    alone = [
        np.abs(error) / (reach * model.sd(run.log_force + error))
        for run, error in zip(runs, left, strict=True)
    ]
    # The doubts together say more or less than the errors that were seen: what current, which has
    # doubts of its own, is weighed against is what was seen.
    seen = max(float(np.quantile(np.concatenate(alone), 0.9)), 0.5)
    doubts = ("gain_sd", "slope_sd", "drift_sd", "floor_n")
    model = replace(model, **{name: seen * getattr(model, name) for name in doubts})
    tail = few
    if model.current is None:
        return replace(model, tail=tail, tail_with_current=tail)
    both, alone_n, both_n = [], [], []
    for run, error, weights in zip(runs, left, folds, strict=True):
        # The motor is as warm as where its line was fitted.
        here = replace(model.current, warmth_sd=0.0)
        left_out = replace(model, weights=tuple(weights.tolist()), current=here)
        ratio, error_n = _with_current(left_out, run)
        both.append(ratio)
        both_n.append(error_n)
        alone_n.append(np.exp(run.log_force + error) - run.force_n)
    if not _rms(both_n) < _HELPS * _rms(alone_n):
        return replace(model, current=None, tail=tail, tail_with_current=tail)
    with_current = max(float(np.quantile(np.concatenate(both), 0.9)) * few, 0.5)
    return replace(model, tail=tail, tail_with_current=with_current)


def _rms(errors: Sequence[FloatArray]) -> float:
    return float(np.sqrt(np.mean(np.square(np.concatenate(errors)))))


def _with_current(model: SheetModel, run: _Run) -> tuple[FloatArray, FloatArray]:
    """Return |error of ln force| over the observer's own half width, and the error in newtons."""
    observer, ratios, errors_n = SheetObserver(model), [], []
    for frame in frames(run.trace):
        now = observer.step(
            frame.time_s, frame.excess, width_mm=frame.width_mm, current_ma=frame.current_ma
        )
        if frame.force_n > FAINT_N:
            wide = np.log(now.high / now.value)
            ratios.append(abs(np.log(now.value / frame.force_n)) / wide)
            errors_n.append(now.value - frame.force_n)
    return np.array(ratios), np.array(errors_n)


def _unloading_seen(traces: LoadTraces) -> bool:
    falling = [np.diff(np.asarray(run.width_mm)) > STILL_MM for run in traces.runs()]
    share = np.concatenate(falling).sum() / max(
        sum((np.abs(np.diff(np.asarray(run.width_mm))) > STILL_MM).sum() for run in traces.runs()),
        1,
    )
    return bool(share > _UNLOADING_SHARE)
