"""Detection limit of the sensor, and linearity over the force range."""

from __future__ import annotations

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError
from palpate.force.power_law import PowerForceLaw
from palpate.sensor.sample import relative_change_percent
from palpate.signal.relative import CONTACT_PERCENT, finger_means
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import LEVELS, running_median
from palpate_studies.twin_session import GAP_MM, STILL_S, Session, draw_named, grasps

SENSORS, SMOOTH = 6, 3
#: Duration of the noise measurement at rest, and the threshold in standard deviations: with normal
#: noise at 15 Hz it causes about one false contact per hour.
REST_S, FALSE_SD = 30.0, 4.2
#: Closing steps, mm, of one second each, on a soft face and on a soft ball.
STEP_MM, STEPS, DWELL_S = 0.04, 45, 1.0
FACES = {"flat (springs)": "springs-2", "round (ball)": "ball-33lbs"}
#: Linearity: closures on a stiff sheet, and the force spans of the fitted lines.
STIFF, CLOSURES_MM = "dragonskin-30", tuple(np.geomspace(0.3, 8.5, 18))
SPANS_N = (2.0, 5.0, 10.0, 20.0, 30.0)
LAWS = ("line in mean change", "line in summed excess", "power law in excess")


def report(*, sensors: int = SENSORS) -> StudyReport:
    """Find the weakest detectable force of simulated sensors, and their linearity up to 30 N.

    Example: palpate study detection-limit --out reports
    """
    limits = {
        (level, face): np.array(
            [find_weakest_n(sensor, name, level=level) for sensor in range(sensors)]
        )
        for level in LEVELS
        for face, name in FACES.items()
    }
    ranges = {
        level: [measure_range(sensor, level=level) for sensor in range(sensors)] for level in LEVELS
    }
    departures = {
        level: np.array([_departures_percent(*one) for one in ranges[level]]) for level in LEVELS
    }
    rules = ("the paper's -10 %", f"{FALSE_SD:g} sd of its own noise")
    return StudyReport(
        name="detection-limit",
        title="Weakest detectable force, and linearity over the range",
        provenance=[
            f"Simulated: {sensors} sensors per level, 15 Hz, 10 bit. The hand closes at "
            f"{STEP_MM:g} mm/s until the mean change of either finger (median of {SMOOTH} frames) "
            "falls below the threshold. The force is that of the simulated load cell.",
            "The paper has no such data; it names them as future work. The twin's force threshold "
            "per pixel is an assumed range (0.05-0.2 N at `lab`, 0-0.1 N at `field`), which is a "
            "lower bound of these figures.",
            "Linearity: settled readings on a stiff sheet. A line is fitted to all forces up to "
            "the span; the departure is its largest error in percent of the span. The power law is "
            "fitted to the same forces; its departure is the largest error in percent of the "
            "force, above a tenth of the span.",
        ],
        tables=[
            Table.of(
                "Weakest detectable force, N: median sensor",
                [
                    {"face": face, "threshold": rule}
                    | {level: float(np.nanmedian(limits[level, face][:, k])) for level in LEVELS}
                    for face in FACES
                    for k, rule in enumerate(rules)
                ],
            ),
            Table.of(
                "Departure from a law, percent: median sensor",
                [
                    {"law": law, "up_to_n": span_n}
                    | {level: float(np.nanmedian(departures[level][:, k, at])) for level in LEVELS}
                    for k, law in enumerate(LAWS)
                    for at, span_n in enumerate(SPANS_N)
                ],
            ),
        ],
        payload={
            "origin": "twin",
            "weakest_n": {f"{a}, {b}": _replace_nan(values) for (a, b), values in limits.items()},
            "median_n": {
                f"{level}, {face}": np.nanmedian(values, axis=0).tolist()
                for (level, face), values in limits.items()
            },
            "spans_n": list(SPANS_N),
            "departure_percent": {
                level: [_replace_nan(one) for one in departures[level]] for level in LEVELS
            },
        },
    )


command = as_command(report)


def find_weakest_n(sensor: int, name: str, *, level: str) -> tuple[float, float]:
    """Close in steps; return the force at which each threshold is first crossed."""
    session, obj = Session(sensor, level=level), draw_named(name)
    session.place(obj)
    session.close_to(obj.size_mm + GAP_MM)
    session.world.clock.sleep_s(STILL_S)
    rest = session.read(REST_S)
    rest_ohm, fingers = rest.mean(axis=0), session.world.layout.finger_of_row

    def lowest(ohm: FloatArray) -> FloatArray:
        """Return the smoothed mean change of the finger that falls more, per frame."""
        change = finger_means(
            relative_change_percent(ohm, rest_ohm=rest_ohm), finger_of_row=fingers
        )
        return np.asarray(running_median(change, length=SMOOTH)[SMOOTH - 1 :].min(axis=1))

    thresholds = (CONTACT_PERCENT, -FALSE_SD * float(np.std(lowest(rest))))
    seen = [np.nan, np.nan]
    for step in range(STEPS):
        session.close_to(obj.size_mm - STEP_MM * (step + 1))
        change, force_n = lowest(session.read(DWELL_S))[-1], session.cell.read_n()
        for index, threshold in enumerate(thresholds):
            if np.isnan(seen[index]) and change <= threshold:
                seen[index] = force_n
    return seen[0], seen[1]


def measure_range(sensor: int, *, level: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Grasp at each closure; return force, mean change and summed excess, sorted by force."""
    session, obj = Session(sensor, level=level, trial=1), draw_named(STIFF)
    widths = [obj.size_mm - closure_mm for closure_mm in CLOSURES_MM]
    readings = [at[0] for at in grasps(session, obj, widths_mm=widths, repeats=1)]
    readings.sort(key=lambda reading: reading.force_n)
    return (
        np.array([r.force_n for r in readings]),
        np.array([r.mean_percent for r in readings]),
        np.array([r.excess for r in readings]),
    )


def _departures_percent(
    force_n: FloatArray, percent: FloatArray, excess: FloatArray
) -> list[list[float]]:
    """Return departures in percent, shape (laws, spans); NaN if the power law can't be fitted."""
    rows: list[list[float]] = [[], [], []]
    for span_n in SPANS_N:
        inside = (force_n <= span_n) & (excess > 0)
        force = force_n[inside]
        for row, reading in zip(rows, (percent[inside], excess[inside]), strict=False):
            line = np.polyval(np.polyfit(reading, force, 1), reading)
            row.append(float(100 * np.max(np.abs(line - force)) / span_n))
        try:
            fitted = PowerForceLaw.fit(excess[inside], force_n=force).force_n(excess[inside]).value
            scored = force > 0.1 * span_n
            rows[2].append(float(100 * np.max(np.abs(fitted / force - 1)[scored])))
        except CalibrationError:
            rows[2].append(np.nan)
    return rows


def _replace_nan(values: FloatArray) -> list[list[float | None]]:
    """Replace NaN with None, for JSON."""
    return [[float(v) if np.isfinite(v) else None for v in row] for row in values]
