"""The observer of one calibrated sheet, on invented sheets whose creep is known exactly."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.errors import CalibrationError
from palpate.estimate.observer_sheet import SheetModel, SheetObserver, sheet_model_from_dict
from palpate.estimate.observer_sheet_fit import fit_sheet, without_current
from palpate.sensor.load_traces import LoadTraces, frames


def invented(
    seed: int,
    *,
    runs: int = 8,
    gain_sd: float = 0.05,
    ma: float = 12.0,
    gear_ma: float = 0.0,
    way_frames: int = 1,
) -> LoadTraces:
    """Staircases on a sheet: excess = gain F^1.2, half of it at once, half with 1 s.

    A step takes `way_frames`. On the way gears take all of their friction, at rest any part of it.
    """
    rng = np.random.default_rng(seed)
    columns: dict[str, list[object]] = {
        name: [] for name in ("run", "time_s", "excess", "width_mm", "current_ma", "force_n")
    }
    for run in range(runs):
        gain = np.exp(gain_sd * rng.standard_normal())
        force, width, next_s = float(rng.uniform(0.5, 5.0)), 40.0, 0.0
        slow, left, up, held = np.log(force), 0, True, 0.0
        for k in range(120):
            time_s = k / 15
            if time_s >= next_s and not left:
                up, left = force < 0.8 or (force < 8 and rng.random() < 0.55), way_frames
                dwell_s = float(np.exp(rng.uniform(np.log(0.3), np.log(3))))
                next_s = time_s + way_frames / 15 + dwell_s
            if left:
                force *= 1.6 ** ((1 if up else -1) / way_frames)
                width += (-1.0 if up else 1.0) / way_frames
                left -= 1
                # The last frame of a step is read at its end.
                held = (1.0 if up else -1.0) if left else float(rng.uniform(-1, 1))
            slow += (np.log(force) - slow) * (1 - np.exp(-1 / 15))
            felt = np.exp(1.2 * (0.5 * np.log(force) + 0.5 * slow)) * gain
            columns["run"].append(run)
            columns["time_s"].append(time_s)
            columns["excess"].append((felt * np.array([0.6, 0.4])).tolist())
            columns["width_mm"].append(width)
            noise_ma = 6 * rng.standard_normal()
            columns["current_ma"].append(ma * force + held * gear_ma + noise_ma)
            columns["force_n"].append(force)
    return LoadTraces(**columns)  # type: ignore[arg-type]


def followed(model: SheetModel, traces: LoadTraces) -> tuple[np.ndarray, float]:
    """Return errors of ln force, and coverage."""
    errors, covered = [], []
    for run in traces.runs():
        observer = SheetObserver(model)
        for one in frames(run):
            now = observer.step(
                one.time_s, one.excess, width_mm=one.width_mm, current_ma=one.current_ma
            )
            errors.append(np.log(now.value / one.force_n))
            covered.append(now.low <= one.force_n <= now.high)
    return np.array(errors), float(np.mean(covered))


@pytest.fixture(scope="module")
def guided() -> LoadTraces:
    return invented(1)


@pytest.fixture(scope="module")
def fitted(guided: LoadTraces) -> SheetModel:
    return fit_sheet(guided)


def test_memory_beats_the_static_law_by_half(guided: LoadTraces, fitted: SheetModel) -> None:
    # Placements with no gain of their own: what is left is the law, and memory.
    tested = invented(2, runs=4, gain_sd=0.0)
    sheet = without_current(fitted)
    errors, coverage = followed(sheet, tested)
    static, _ = followed(fit_sheet(guided, memory=False), tested)
    assert np.sqrt(np.mean(errors**2)) < 0.5 * np.sqrt(np.mean(static**2))
    assert coverage > 0.7


def test_current_settles_the_gain_of_a_contact() -> None:
    guided, tested = invented(3, gain_sd=0.5), invented(4, runs=4, gain_sd=0.5)
    model = fit_sheet(guided)
    both, _ = followed(model, tested)
    alone, _ = followed(without_current(model), tested)
    assert model.current is not None
    assert model.current.ma_per_n == pytest.approx(12.0, rel=0.05)
    assert np.median(np.abs(both)) < 0.5 * np.median(np.abs(alone))


def test_friction_of_the_gears_is_known_on_the_way() -> None:
    guided = invented(8, gain_sd=0.5, gear_ma=40.0, way_frames=4)
    tested = invented(9, gain_sd=0.5, gear_ma=40.0, way_frames=4)
    model = fit_sheet(guided)
    assert model.current is not None
    assert model.current.gear_ma == pytest.approx(40.0, rel=0.1)
    both, coverage = followed(model, tested)
    alone, _ = followed(without_current(model), tested)
    # By the second half of each run a few steps have been heard.
    late = [np.abs(errors.reshape(8, 120)[:, 60:]).mean() for errors in (both, alone)]
    assert late[0] < 0.5 * late[1]
    assert coverage > 0.7


def test_a_current_that_says_nothing_is_left_out() -> None:
    assert fit_sheet(invented(5, ma=0.0)).current is None


def test_telling_the_force_takes_the_gain_out(fitted: SheetModel) -> None:
    model = without_current(fitted)
    run = next(invented(6, runs=1, gain_sd=1.0).runs())
    observer = SheetObserver(model)
    seen = list(frames(run))
    before = [observer.step(one.time_s, one.excess, width_mm=one.width_mm) for one in seen[:60]]
    observer.tell(seen[59].force_n)
    now = observer.step(seen[60].time_s, seen[60].excess, width_mm=seen[60].width_mm)
    assert np.log(now.high / now.low) < np.log(before[-1].high / before[-1].low)
    assert now.value == pytest.approx(seen[60].force_n, rel=0.15)
    with pytest.raises(ValueError, match="above 0"):
        observer.tell(0.0)


def test_outside_the_calibrated_range_it_says_so(fitted: SheetModel) -> None:
    observer = SheetObserver(fitted)
    assert str(observer.step(0.0, [1.0, 1.0]).status) == "ok"
    assert str(observer.step(0.1, [900.0, 900.0]).status) == "saturated"


def test_model_goes_through_a_file_unchanged(fitted: SheetModel) -> None:
    model = fitted
    assert sheet_model_from_dict(model.as_dict()) == model
    with pytest.raises(CalibrationError, match="calibrate again"):
        sheet_model_from_dict({**model.as_dict(), "weights": list(model.weights[1:])})
    with pytest.raises(CalibrationError, match="gain_sd"):
        sheet_model_from_dict({k: v for k, v in model.as_dict().items() if k != "gain_sd"})


def test_unloading_not_seen_is_said(guided: LoadTraces, fitted: SheetModel) -> None:
    rising = LoadTraces(
        **{
            name: getattr(guided, name)
            for name in ("run", "time_s", "excess", "current_ma", "force_n")
        },
        width_mm=np.full(len(np.asarray(guided.run)), 40.0),
    )
    assert fitted.unloading_seen
    assert not fit_sheet(rising).unloading_seen


def test_too_few_placements_are_refused() -> None:
    with pytest.raises(CalibrationError, match="2 placements"):
        fit_sheet(invented(7, runs=2))


def test_a_reading_that_ignores_the_force_is_refused(guided: LoadTraces) -> None:
    rng = np.random.default_rng(0)
    noise = LoadTraces(
        **{name: getattr(guided, name) for name in ("run", "time_s", "width_mm", "current_ma")},
        excess=rng.uniform(0.5, 1.5, np.asarray(guided.excess).shape),
        force_n=guided.force_n,
    )
    with pytest.raises(CalibrationError, match="does not rise with the force"):
        fit_sheet(noise)
