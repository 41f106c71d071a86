"""Effect of the actuation speed (section 2.2 of the paper) on every predictor."""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.arrays import FloatArray
from palpate.measurement import Status
from palpate.settling.baselines import Recorded
from palpate.settling.exponential import Exponential
from palpate.settling.percent import adapt_method, percent_to_ratio
from palpate.settling.relaxation import Relaxation
from palpate.settling.result import SettlingMethod
from palpate.signal.relative import mean_change
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import LEVELS
from palpate_studies.settling_pace import describe_pace, measure_pace
from palpate_studies.twin_session import GAP_MM, HOLD_S, Session, draw_named, stack_holds

SPEEDS_MM_PER_S = (3.0, 6.0, 12.0, 25.0, 60.0)
SENSORS, REPEATS, OBJECT, CLOSURE_MM, CUTOFF_S = 6, 2, "dragonskin-10", 3.0, 2.5
METHODS: dict[str, SettlingMethod] = {
    "recorded": Recorded(),
    "exponential": Exponential(),
    "relaxation": Relaxation(),
}
#: Origins of the 2.5 s.
CLOCKS = ("start of actuation", "end of actuation")


def report(*, sensors: int = SENSORS, repeats: int = REPEATS) -> StudyReport:
    """Close at five speeds on the twin and predict the settled value at 2.5 s.

    Example: palpate study speed --out reports
    """
    rows, paces = list[dict[str, Any]](), list[dict[str, Any]]()
    for level in LEVELS:
        for speed in SPEEDS_MM_PER_S:
            values = np.concatenate(
                [
                    measure_holds(sensor, level=level, speed=speed, repeats=repeats)
                    for sensor in range(sensors)
                ]
            )
            offsets_s = 0.0, _closing_time_s(speed)
            paces.append({"level": level, "speed_mm_per_s": speed, **_pace(values, offsets_s[1])})
            for clock, offset_s in zip(CLOCKS, offsets_s, strict=True):
                for name, method in METHODS.items():
                    hold_method = adapt_method(method, unit="percent")
                    rows.append(
                        {
                            "level": level,
                            "speed_mm_per_s": speed,
                            "clock": clock,
                            "method": name,
                            **_score(hold_method, values, offset_s),
                        }
                    )
    return StudyReport(
        name="speed",
        title="Actuation speed, and error of the value predicted at 2.5 s",
        provenance=[
            f"Simulated: {sensors} sensors per level, {repeats} holds of {OBJECT} at each speed. "
            "The paper expects an effect (section 2.2) and prints no numbers.",
            "`ok`: fraction of holds whose interval is reported as reliable; coverage: fraction of "
            "all holds whose interval (0.9) covers the truth. If contact occurs after the cut-off, "
            "every figure is a guess and `ok` should be 0.",
            f"The closing travel is {GAP_MM + CLOSURE_MM:g} mm. At 3 mm/s it takes 3 s, longer "
            "than the paper's delay of 2.5 s from actuation, so no prediction is possible then. "
            "Counted from the end of the movement, the speed has little effect.",
        ],
        tables=[
            Table.wide(
                "Median |error| of the settled change, percent (fraction `ok`)",
                [row | {"of": f"{row['method']}, {row['level']}"} for row in rows],
                {"mm/s": "{speed_mm_per_s:g}", "2.5 s from": "{clock}"},
                over="of",
                form="{median_abs_error_percent:.1f} ({ok:.2f})",
            ),
            Table.of("Pace of settling after the movement, 10, 50 and 90 % quantiles", paces),
        ],
        payload={"origin": "twin", "rows": rows, "pace": paces},
    )


command = as_command(report)


def measure_holds(sensor: int, *, level: str, speed: float, repeats: int) -> FloatArray:
    """Return mean changes from the start of actuation, shape (repeats, times), at 15 Hz."""
    session, obj = Session(sensor, level=level), draw_named(OBJECT)
    session.place(obj)
    width_mm, read_s = obj.size_mm - CLOSURE_MM, HOLD_S + _closing_time_s(speed) + 0.2
    return stack_holds(
        [
            mean_change(
                session.hold(obj.size_mm, width_mm=width_mm, read_s=read_s, speed_mm_per_s=speed)
            )
            for _ in range(repeats)
        ]
    )


def _closing_time_s(speed: float) -> float:
    return (GAP_MM + CLOSURE_MM) / speed


def _pace(values: FloatArray, offset_s: float) -> dict[str, Any]:
    """Return quantiles of the pace of the ratio to rest, counted from the end of the movement."""
    after_s = np.arange(1, values.shape[1] + 1) / 15.0 - offset_s
    seen = after_s > 0
    ratios = percent_to_ratio(values[:, seen])
    paces = [measure_pace(after_s[seen], ratio, horizon_s=HOLD_S) for ratio in ratios]
    return describe_pace(np.array(paces))


def _score(method: SettlingMethod, values: FloatArray, offset_s: float) -> dict[str, Any]:
    """Return the scores of a method on the holds of one speed."""
    after_s = np.arange(1, values.shape[1] + 1) / 15.0 - offset_s
    settled = values[:, (after_s > HOLD_S - 0.5) & (after_s <= HOLD_S)].mean(axis=1)
    seen = (after_s >= 0) & (after_s <= CUTOFF_S)
    predicted = method.predict(after_s[seen], values[:, seen], horizon_s=HOLD_S, level=0.9)
    error = np.abs(100 * (np.asarray(predicted.value) / settled - 1))
    low, high = (np.asarray(end, dtype=float) for end in (predicted.low, predicted.high))
    known = bool(np.isfinite(low).all())
    return {
        "median_abs_error_percent": float(np.median(error)),
        "ok": float(np.mean(np.asarray(predicted.status) == Status.OK)),
        "coverage": float(np.mean((low <= settled) & (settled <= high))) if known else None,
    }
