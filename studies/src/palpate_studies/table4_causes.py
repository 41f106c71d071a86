"""Why the slope of force over relative change depends on the sheet, taken apart on the twin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError
from palpate.estimate.force import PowerForceLaw
from palpate.estimate.line_law import LineForceLaw


@dataclass(frozen=True, slots=True, kw_only=True)
class Pairs:
    """Grasps of one object on one sensor; arrays of shape (grasps,), pixels (grasps, pixels)."""

    force_n: FloatArray
    mean_percent: FloatArray
    pixel_percent: FloatArray
    excess: FloatArray


def force_window(pairs: dict[str, Pairs], *, sheets: Sequence[str]) -> tuple[float, float]:
    """Return the forces that every sheet reaches."""
    return (
        max(float(pairs[name].force_n.min()) for name in sheets),
        min(float(pairs[name].force_n.max()) for name in sheets),
    )


def cause_rows(sensors: Sequence[dict[str, Pairs]], *, sheets: Sequence[str]) -> dict[str, float]:
    """Return the ratio of the largest slope to the smallest, cause by cause; median sensor.

    One pixel instead of the mean takes the averaging away; the slope of a bent curve (quadratic in
    ln force) at one force of all takes the bend away; the exponent of the summed excess is what a
    power law has in place of a slope.
    """
    found: dict[str, list[float]] = {}
    for pairs in sensors:
        low, high = force_window(pairs, sheets=sheets)
        pixel = int(np.argmin(pairs[sheets[0]].pixel_percent.mean(axis=0)))
        ratios = {
            "mean change, each sheet over its own forces": _ratio(
                [_slope(pairs[n].mean_percent, pairs[n].force_n) for n in sheets]
            ),
            "one pixel's change, own forces": _ratio(
                [_slope(pairs[n].pixel_percent[:, pixel], pairs[n].force_n) for n in sheets]
            ),
            "mean change, local slope at one force of all": _ratio(
                [_local_slope(pairs[n], force_n=float(np.sqrt(low * high))) for n in sheets]
            ),
            "summed excess: exponent of the power law, own forces": _ratio(
                [_slope(np.log(pairs[n].excess), np.log(pairs[n].force_n)) for n in sheets]
            ),
        }
        for name, ratio in ratios.items():
            found.setdefault(name, []).append(ratio)
    return {name: float(np.median(values)) for name, values in found.items()}


def transfer_rows(
    sensors: Sequence[dict[str, Pairs]], *, sheets: Sequence[str], round_face: str
) -> dict[tuple[str, str, str], float]:
    """Return the median error of force, percent, of each law on what it was not fitted to."""
    splits = {
        ("same sheet, other grasps", "same sheet"): [([n], n) for n in sheets],
        ("one sheet", "the other sheets"): [([n], m) for n in sheets for m in sheets if m != n],
        ("three sheets", "the fourth"): [([m for m in sheets if m != n], n) for n in sheets],
        ("four sheets (flat)", "a ball (round)"): [(list(sheets), round_face)],
    }
    found = {}
    for (fitted, tested), pairs_of in splits.items():
        for law in ("line", "power"):
            missed = [_errors(law, pairs, on, to) for pairs in sensors for on, to in pairs_of]
            found[law, fitted, tested] = float(100 * np.median(np.concatenate(missed)))
    return found


def _errors(law: str, pairs: dict[str, Pairs], on: Sequence[str], to: str) -> FloatArray:
    """Return |relative error| of force; where object and test are one, odd grasps are left out."""
    step = 2 if list(on) == [to] else 1
    force = np.concatenate([pairs[name].force_n[::step] for name in on])
    tested = pairs[to].force_n[step - 1 :: step]
    kind, attribute = (LineForceLaw, "mean_percent") if law == "line" else (PowerForceLaw, "excess")
    reading = np.concatenate([getattr(pairs[name], attribute)[::step] for name in on])
    try:
        fitted = kind.fit(reading, force_n=force)
    except CalibrationError:
        return np.full(tested.size, np.inf)
    value = fitted.force_n(getattr(pairs[to], attribute)[step - 1 :: step]).value
    return np.asarray(np.abs(value / tested - 1))


def _slope(x: FloatArray, y: FloatArray) -> float:
    return float(np.polyfit(x, y, 1)[0])


def _local_slope(pairs: Pairs, *, force_n: float) -> float:
    """Return the slope of force over mean change at one force, N/%."""
    curve = np.polyfit(np.log(pairs.force_n), pairs.mean_percent, 2)
    percent_per_log = float(np.polyval(np.polyder(curve), np.log(force_n)))
    return force_n / percent_per_log


def _ratio(slopes: Sequence[float]) -> float:
    sizes = np.abs(slopes)
    return float(np.max(sizes) / np.min(sizes))
