"""The effect of actuation speed (section 2.2 of the paper) on the spike and on every predictor."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.commands.options import JsonOption
from palpate.settling.exponential import Exponential
from palpate.settling.percent import for_unit
from palpate.settling.recorded import Recorded
from palpate.settling.relaxation import Relaxation
from palpate.settling.result import SettlingMethod, Status
from palpate.signal.relative import mean_change, relative_change_percent
from palpate.twin.velostat import Sheet
from palpate_studies.equal_width import SEED
from palpate_studies.other_sheets import other_sheet
from palpate_studies.protocol.paired import paired_difference
from palpate_studies.report import OutOption, StudyReport, Table
from palpate_studies.twin_session import GAP_MM, HOLD_S, LEVELS, STILL_S, Session, drawn

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SPEEDS_MM_PER_S = (3.0, 6.0, 12.0, 25.0, 60.0)
SENSORS, REPEATS, OBJECT, CLOSURE_MM, CUTOFF_S = 6, 2, "dragonskin-10", 3.0, 2.5
METHODS: dict[str, SettlingMethod] = {
    "recorded": Recorded(),
    "exponential": Exponential(),
    "relaxation": Relaxation(),
}
#: From what the 2.5 s are counted.
CLOCKS = ("start of actuation", "end of actuation")


def command(
    second: Annotated[
        bool,
        typer.Option("--second", help="Sheets with a logarithmic law, play and even creep."),
    ] = False,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Close at five speeds on the twin and predict the settled value at 2.5 s.

    Example: palpate study speed --out reports
    """
    report(remade=other_sheet if second else None).emit(as_json=as_json, out=out)


def report(
    *,
    sensors: int = SENSORS,
    repeats: int = REPEATS,
    remade: Callable[[Sheet], Sheet] | None = None,
) -> StudyReport:
    """Make the holds and score the predictors at each speed; `remade` as in `World`."""
    curves = {
        (level, speed): np.concatenate(
            [
                holds(sensor, level=level, speed=speed, repeats=repeats, remade=remade)
                for sensor in range(sensors)
            ]
        )
        for level in LEVELS
        for speed in SPEEDS_MM_PER_S
    }
    scored = {key: _errors(values, speed=key[1]) for key, values in curves.items()}
    errors = {
        key: {way: one.error_percent for way, one in found.items()} for key, found in scored.items()
    }
    rows = []
    for speed in SPEEDS_MM_PER_S:
        for clock in CLOCKS:
            cells = [
                f"{np.median(errors[level, speed][clock, method]):.1f}"
                for level in LEVELS
                for method in METHODS
            ]
            peaks = [f"{np.median(curves[level, speed].max(axis=1)):+.0f}" for level in LEVELS]
            ours = [scored[level, speed][clock, "relaxation"] for level in LEVELS]
            believed = [f"{100 * np.mean(one.ok):.0f}" for one in ours]
            covered = [f"{100 * np.mean(one.covered):.0f}" for one in ours]
            rows.append(
                [
                    f"{speed:g}",
                    clock,
                    *cells,
                    " / ".join(believed),
                    " / ".join(covered),
                    " / ".join(peaks),
                ]
            )
    return StudyReport(
        name="speed",
        title="Actuation speed: spike, and error of the value predicted at 2.5 s",
        provenance=[
            f"Simulated: {sensors} sensors per level, {repeats} holds of {OBJECT} at each speed. "
            "The paper expects an effect (section 2.2) and prints no numbers.",
            "`ok`: share of holds for which ours reports that its interval can be believed; "
            "covered: share of all holds whose interval holds the truth (0.9). Where contact "
            "comes after the cut-off every figure is a guess, and `ok` should be 0.",
            f"Closing goes {GAP_MM + CLOSURE_MM:g} mm: at 3 mm/s it takes 3 s, longer than the "
            "paper's delay of 2.5 s from actuation, so nothing can be predicted then; counted from "
            "the end of the movement the speed matters little.",
        ],
        tables=[
            Table(
                title="Median |error| of the settled change, percent; highest spike, points",
                columns=(
                    "mm/s",
                    "2.5 s from",
                    *(f"{method}, {level}" for level in LEVELS for method in METHODS),
                    f"ours `ok`, %, {' / '.join(LEVELS)}",
                    f"ours covered, %, {' / '.join(LEVELS)}",
                    f"spike, {' / '.join(LEVELS)}",
                ),
                rows=rows,
            )
        ],
        payload={
            "study": "speed",
            "origin": "twin",
            "second_generator": remade is not None,
            "rows": [
                {
                    "level": level,
                    "speed_mm_per_s": speed,
                    "clock": clock,
                    "method": method,
                    "median_abs_error_percent": float(np.median(one.error_percent)),
                    "ok": float(np.mean(one.ok)),
                    "coverage": float(np.mean(one.covered))
                    if np.isfinite(one.covered).all()
                    else None,
                }
                for (level, speed), found in scored.items()
                for (clock, method), one in found.items()
            ],
            "compared": _compared(scored, sensors=sensors, repeats=repeats),
        },
        figures={"speed": lambda: draw(curves)},
    )


def _compared(
    scored: Mapping[tuple[str, float], Mapping[tuple[str, str], Predicted]],
    *,
    sensors: int,
    repeats: int,
) -> list[dict[str, Any]]:
    """Return the error of ours less that of each rival on the same holds, by sensor."""
    of = [str(sensor) for sensor in range(sensors) for _ in range(repeats)]
    return [
        {
            "level": level,
            "speed_mm_per_s": speed,
            "clock": clock,
            "rival": rival,
            **paired_difference(
                found[clock, "relaxation"].error_percent, found[clock, rival].error_percent, of
            ).to_dict(),
        }
        for (level, speed), found in scored.items()
        for clock in CLOCKS
        for rival in METHODS
        if rival != "relaxation"
    ]


def holds(
    sensor: int,
    *,
    level: str,
    speed: float,
    repeats: int,
    remade: Callable[[Sheet], Sheet] | None = None,
) -> FloatArray:
    """Return mean changes from the start of actuation on, shape (repeats, times), at 15 Hz."""
    session, obj = Session(sensor, level=level, remade=remade), drawn(OBJECT, seed=SEED)
    session.place(obj)
    made = []
    for _ in range(repeats):
        session.close_to(obj.size_mm + GAP_MM)
        session.world.clock.sleep_s(STILL_S)
        rest_ohm = session.mean_ohm()
        session.close_to(obj.size_mm - CLOSURE_MM, speed_mm_per_s=speed)
        ohm = session.read(HOLD_S + _closing_s(speed) + 0.2)
        made.append(mean_change(relative_change_percent(ohm, rest_ohm=rest_ohm)))
        session.gripper.release()
        session.world.clock.sleep_s(HOLD_S)
    shortest = min(map(len, made))
    return np.array([values[:shortest] for values in made])


def _closing_s(speed: float) -> float:
    return (GAP_MM + CLOSURE_MM) / speed


def _times(values: FloatArray) -> FloatArray:
    return np.arange(1, values.shape[1] + 1) / 15.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Predicted:
    """One method on the holds of one speed; arrays of shape (holds,).

    Attributes
    ----------
    error_percent : ndarray
        |error| of the settled value.
    ok : ndarray of bool
        Whether the status is `ok`.
    covered : ndarray
        1 where the interval holds the truth, 0 where not, NaN without an interval.
    """

    error_percent: FloatArray
    ok: NDArray[np.bool_]
    covered: FloatArray


def _errors(values: FloatArray, *, speed: float) -> dict[tuple[str, str], Predicted]:
    """Return what came of each hold, by clock and method."""
    found, time_s = {}, _times(values)
    for clock, offset_s in zip(CLOCKS, (0.0, _closing_s(speed)), strict=True):
        after_s = time_s - offset_s
        settled = values[:, (after_s > HOLD_S - 0.5) & (after_s <= HOLD_S)].mean(axis=1)
        seen = (after_s >= 0) & (after_s <= CUTOFF_S)
        for name, method in METHODS.items():
            predicted = for_unit(method, "percent").predict(
                after_s[seen], values[:, seen], horizon_s=HOLD_S, level=0.9
            )
            low, high = (np.asarray(end, dtype=float) for end in (predicted.low, predicted.high))
            found[clock, name] = Predicted(
                error_percent=np.abs(100 * (np.asarray(predicted.value) / settled - 1)),
                ok=np.asarray(predicted.status) == Status.OK,
                covered=np.where(np.isfinite(low), (low <= settled) & (settled <= high), np.nan),
            )
    return found


def draw(curves: dict[tuple[str, float], FloatArray]) -> Figure:
    """Draw the first hold at each speed."""
    from palpate.plots.style import AMBER, BLUE, GREEN, INK, ORANGE, PURPLE, new_figure

    colours = (PURPLE, BLUE, GREEN, AMBER, ORANGE)
    with new_figure(columns=2, width_in=9.0, height_in=3.8) as (figure, axes):
        for axis, level in zip(axes[0], LEVELS, strict=True):
            for speed, colour in zip(SPEEDS_MM_PER_S, colours, strict=True):
                values = curves[level, speed]
                axis.plot(_times(values), values[0], color=colour, label=f"{speed:g} mm/s")
            axis.axvline(CUTOFF_S, color=INK, ls="--", lw=1, label="the paper's 2.5 s")
            axis.set(
                xlim=(0, 8),
                xlabel="time from actuation (s)",
                ylabel="mean relative change (%)",
                title=f"simulated, {level}, one sensor",
            )
        axes[0, 0].legend()
    return figure
