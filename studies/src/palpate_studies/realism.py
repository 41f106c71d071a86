"""Whether the twin is ever kinder than real recordings: scatter, creep, shapes and noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from palpate.arrays import FloatArray
from palpate.holds import read_holds
from palpate.twin.ranges import ranges_of
from palpate_studies.force_ladders import read_ladders
from palpate_studies.press_data import read_presses
from palpate_studies.realism_quantities import (
    SMALLEST_N,
    halves,
    hold_quantities,
    ladder_quantities,
    log_gains,
    press_quantities,
    together,
)
from palpate_studies.realism_twin import twin_ladder, twin_presses, twin_weights
from palpate_studies.report import StudyReport, Table, as_command
from palpate_studies.rows import LEVELS

SENSORS, PRESSES, HOLDS = 12, 8, 3
#: Levels whose resistance at rest is compared.
RESTING = (*LEVELS, "low-rest")
SUMMED, NEXT = "gain scatter, eight places", "gain from eight places to the next"
#: Quantity -> (source, what is compared of it). The twin's value should not be the smaller one.
COMPARED: dict[str, tuple[str, str]] = {
    "exponent": ("ladders", "sd"),
    "scatter of ln force": ("ladders", "median"),
    "ln force missed": ("ladders", "median"),
    "gain scatter": ("presses", "median"),
    SUMMED: ("presses", "median"),
    NEXT: ("presses", "median"),
    "creep, %": ("presses", "median"),
    "still to come, %": ("holds", "median"),
    "noise, %": ("holds", "median"),
    "relaxation error, %": ("holds", "median"),
    "relaxation error, % of rest": ("holds", "median"),
    "exponential error, %": ("holds", "median"),
    "exponential error, % of rest": ("holds", "median"),
}
MEANING = {
    "exponent": "of excess conductance in force, sensor by sensor",
    "scatter of ln force": "about the sensor's own power law, every weight placed again",
    "ln force missed": "by the power law of two other sensors",
    "gain scatter": "sd of ln conductance at equal force, place to place",
    SUMMED: "pressed together: drawn from all of a real sheet; the twin's eight pixels",
    NEXT: "difference / sqrt 2: real, one half of the sheet to the other; twin, placed again",
    "creep, %": "of conductance within 1 s of plateau, the force's share taken out",
    "still to come, %": "of the settled ohm value at 2.5 s",
    "noise, %": "of one sample on a settled hold",
    "relaxation error, %": "at 2.5 s, of the settled ohm value",
    "relaxation error, % of rest": "of the change still to come",
    "exponential error, %": "at 2.5 s, of the settled ohm value",
    "exponential error, % of rest": "of the change still to come",
}
Quantities = Mapping[str, FloatArray]


def report(
    *,
    ladders: Annotated[
        Path | None, typer.Option(help="Real ladders of weights.", metavar="CSV")
    ] = None,
    presses: Annotated[
        Path | None, typer.Option(help="Real presses with a load cell.", metavar="CSV")
    ] = None,
    holds: Annotated[
        list[Path] | None, typer.Option(help="Real holds in ohm; may be repeated.", metavar="FILE")
    ] = None,
    sensors: int = SENSORS,
) -> StudyReport:
    """Compare the twin's scatter, creep, shapes and noise with those of real recordings.

    Example: palpate study realism --ladders ladders.csv --presses presses.csv.gz --holds holds.csv
    """
    real = real_quantities(ladders=ladders, presses=presses, holds=holds or ())
    rest_ohm = [one.rest_ohm for one in read_ladders(ladders)] if ladders else []
    twin = {level: twin_quantities(level=level, sensors=sensors) for level in LEVELS}
    rows = [
        _compare(quantity, quantities[quantity], twin, file=name)
        for name, quantities in (real or {"": twin["lab"]}).items()
        for quantity in COMPARED
        if quantity in quantities
    ]
    return StudyReport(
        name="realism",
        title="The twin compared with real recordings",
        provenance=[*_provenance(sensors, given=bool(real)), *_at_rest(rest_ohm)],
        tables=[
            Table.of(
                f"{name or 'Twin'}: value compared (10 to 90 %)",
                [row for row in rows if row["file"] == name],
                {
                    "quantity": lambda row: f"{row['quantity']}: {MEANING[row['quantity']]}",
                    "compared": "{statistic}",
                    **({"n": "{n}", "real": "{real}"} if name else {}),
                    **{level: f"{{{level}}}" for level in LEVELS},
                },
            )
            for name in dict.fromkeys(row["file"] for row in rows)
        ],
        payload={
            "study": "realism",
            "origin": "twin",
            "compared": rows,
            "rest_ohm": {
                **({"real": _ends(rest_ohm) | {"sensors": len(rest_ohm)}} if rest_ohm else {}),
                **{level: _ends(ranges_of(level).rest_ohm_log) for level in RESTING},
            },
        },
    )


command = as_command(report)


def _compare(
    quantity: str, real: FloatArray, twin: Mapping[str, Quantities], *, file: str
) -> dict[str, Any]:
    """Return a quantity of real recordings and of the twin; kinder lies below the real interval."""
    statistic = COMPARED[quantity][1]
    of = np.nanstd if statistic == "sd" else np.nanmedian
    drawn = np.random.default_rng(0).choice(real, size=(2000, real.size))
    lowest = float(np.quantile(of(drawn, axis=1), 0.05))

    def cell(values: FloatArray) -> str:
        low, high = np.nanquantile(values, [0.1, 0.9])
        return f"{of(values):.3g} ({low:.3g} to {high:.3g})"

    kinder = {level: bool(file and of(twin[level][quantity]) < lowest) for level in LEVELS}
    return {
        "file": file,
        "quantity": quantity,
        "statistic": statistic,
        "n": real.size,
        "real": cell(real),
        **{level: cell(twin[level][quantity]) + " kinder" * kinder[level] for level in LEVELS},
        "kinder": kinder,
    }


def real_quantities(
    *, ladders: Path | None = None, presses: Path | None = None, holds: Sequence[Path] = ()
) -> dict[str, Quantities]:
    """Return the quantities of each file given."""
    found: dict[str, Quantities] = {}
    if ladders is not None:
        found[ladders.name] = ladder_quantities(
            [
                (one.load_n[loaded], one.rest_ohm / one.resistance_ohm[loaded] - 1.0)
                for one in read_ladders(ladders)
                for loaded in [one.load_n > SMALLEST_N]
            ]
        )
    if presses is not None:
        pressed = read_presses(presses)
        gains = log_gains(pressed)
        found[presses.name] = {
            **press_quantities(pressed),
            SUMMED: together(gains),
            NEXT: halves(gains),
        }
    for path in holds:
        found[path.name] = hold_quantities(read_holds(path))
    return found


def twin_quantities(*, level: str, sensors: int = SENSORS) -> dict[str, FloatArray]:
    """Return the same quantities of the twin."""
    pressed = [twin_presses(sensor, level=level, count=PRESSES) for sensor in range(sensors)]
    one, summed = ([p for pair in pressed for p in pair[part]] for part in (0, 1))
    gains = np.array(list(log_gains(summed).values()))
    return {
        **ladder_quantities([twin_ladder(sensor, level=level) for sensor in range(sensors)]),
        **press_quantities(one),
        SUMMED: np.std(gains, axis=1, ddof=1),
        NEXT: np.abs(np.diff(gains, axis=1)).ravel() / np.sqrt(2),
        **hold_quantities(
            [h for sensor in range(sensors) for h in twin_weights(sensor, level=level, count=HOLDS)]
        ),
    }


def _provenance(sensors: int, *, given: bool) -> list[str]:
    lines = [
        f"Simulated: {sensors} sensors of each level, {PRESSES} presses and {HOLDS} holds of each, "
        "read with 16 bit so that the converter adds nothing. Real: the files named.",
        "`field` is meant to be no kinder than the real recordings; its ranges were set and "
        "widened by this comparison, so agreement shows nothing about an estimator. `lab` "
        "scatters as the paper's Tables 2 to 6 do and is kinder than these recordings in many "
        "rows: results at `lab` alone are no promise for a sensor outside such a setup.",
        "Real presses visit places of a sheet that is one pixel: our pixels, one per press, stand "
        "for the places, and their sum for eight places pressed at once. Real places keep their "
        "gain from one repeat to the next (to about 0.1) and neighbours are alike, so half a "
        "sheet differs from the other half by more than eight independent places would. The twin "
        "draws its places again for each grasp, which a thing that is placed again in a gripper, "
        "and not moved by half a sheet, does not bring; weights placed again at one place "
        "(ladders) scatter less on the real sheets than on `field`.",
        "Kinder: the twin's median (or sd) lies below the bootstrap 90 % interval of the real one.",
    ]
    if not given:
        lines.append("No real recordings were given (--ladders, --presses, --holds): twin alone.")
    return lines


def _ends(values: Sequence[float]) -> dict[str, float]:
    return {"low": min(values), "high": max(values)}


def _at_rest(rest_ohm: Sequence[float]) -> list[str]:
    if not rest_ohm:
        return []
    low, high = (end / 1000 for end in ranges_of("field").rest_ohm_log)
    return [
        f"At rest these {len(rest_ohm)} real sensors of the ladders have "
        f"{min(rest_ohm) / 1000:.1f} to {max(rest_ohm) / 1000:.1f} kohm, `field` has {low:g} to "
        f"{high:g}: there the reference resistor fits. The level `low-rest` is for one that does "
        "not."
    ]
